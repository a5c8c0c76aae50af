// Backups of a folder whose files the test wrote itself: what must be in the copy is what it wrote, and `sha256sum` of
// coreutils is the judge of the list.
#include "server/store/backup.h"

#include <sys/stat.h>

#include <algorithm>

#include "server/store/checksums.h"
#include "server/store/folder_blob_store.h"
#include "server/store/schema.h"
#include "server/store/sqlite.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class BackupTest : public testing::Test {
 protected:
  BackupTest() { Open(); }

  void Open() {
    directory_ = Take(DataDirectory::Open(data_));
    store_ = Take(OpenSqliteStore(directory_->DatabaseFile(), {}));
    blobs_ = MakeFolderBlobStore(*directory_);
    EXPECT_THAT(store_->SetFolderId(directory_->id()), IsOk());
  }
  void Close() {
    blobs_.reset();
    store_.reset();
    directory_.reset();
  }
  // A recording of the files "a" and "rgb/b" with these bytes, of which only the first `committed` are committed.
  std::string Upload(const std::string& a, const std::string& b, int64_t committed) {
    const std::string id = Take(store_->CreateSequence(kTenant, "", "")).id;
    const auto size = [](const std::string& text) { return static_cast<int64_t>(text.size()); };
    const UploadRecord upload = Take(store_->CreateUpload(
        kTenant, id, {{.path = "a", .size_bytes = size(a)}, {.path = "rgb/b", .size_bytes = size(b)}},
        /*room_bytes=*/1000, ""));
    EXPECT_THAT(blobs_->Write(id, "a", 0, a), IsOk());
    EXPECT_THAT(blobs_->Write(id, "rgb/b", 0, b), IsOk());
    EXPECT_THAT(store_->SetCommittedSize(upload.id, committed), IsOk());
    if (committed == size(a) + size(b)) {
      EXPECT_THAT(store_->FinishUpload(upload.id), IsOk());
    }
    return id;
  }
  // Every file below `folder`, by its path relative to it.
  static std::vector<std::string> FilesIn(const std::string& folder) {
    std::vector<std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.is_regular_file()) files.push_back(entry.path().string().substr(folder.size() + 1));
    }
    std::sort(files.begin(), files.end());
    return files;
  }

  TemporaryFolder folder_;
  const std::string data_ = folder_ / "data", to_ = folder_ / "backup", new_ = folder_ / "new";
  std::unique_ptr<DataDirectory> directory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<BlobStore> blobs_;
};

TEST_F(BackupTest, HoldsWhatIsCommittedAndNothingElse) {
  const std::string whole = Upload("first", "second", 11), half = Upload("third", "fourth", 7);
  WriteText(directory_->SequenceFolder(whole) + "/stray", "of nobody");
  WriteText(directory_->TaskFolder(1) + "/scratch", "x");
  // The server's lock is held all the time.
  const BackupSummary summary = Take(MakeBackup(data_, to_));
  EXPECT_EQ(summary.sequences, 2);
  EXPECT_EQ(summary.database_states, 1);
  EXPECT_THAT(summary.faults, IsEmpty());
  EXPECT_EQ(ReadText(to_ + "/sequences/" + whole + "/a"), "first");
  EXPECT_EQ(ReadText(to_ + "/sequences/" + whole + "/rgb/b"), "second");
  EXPECT_EQ(ReadText(to_ + "/sequences/" + half + "/rgb/b"), "fo") << "cut to what is committed";
  EXPECT_EQ(FilesIn(to_).size(), 7U);  // four files, marker, database, list
  EXPECT_EQ(summary.files, 6);
  EXPECT_EQ(std::system(("cd " + to_ + " && sha256sum --check --strict --quiet backup.sha256").c_str()), 0);

  EXPECT_EQ(Take(RestoreBackup(to_, new_)).folder_id, directory_->id());
  Close();
  std::vector<std::string> restored = FilesIn(to_);
  std::erase(restored, "backup.sha256");
  EXPECT_EQ(FilesIn(new_), restored);
  const auto directory = Take(DataDirectory::Open(new_));
  const auto store = Take(OpenSqliteStore(directory->DatabaseFile(), {}));
  EXPECT_EQ(Take(store->FolderId()), directory->id());
  EXPECT_EQ(Take(store->ListSequences(kTenant, {}, {})).items.size(), 2U);
  // The backup itself is a data folder, too.
  EXPECT_THAT(DataDirectory::Open(to_), IsOk());
}

// Deleted just after the first file was copied: the backup is of the state without it.
TEST_F(BackupTest, ADeletionOnTheWayIsFollowed) {
  const std::string kept = Upload("first", "second", 11), deleted = Upload("third", "fourth", 11);
  bool done = false;
  const BackupSummary summary = Take(MakeBackup(data_, to_, {.on_copied = [&](const CopyProgress& progress) {
                                                  EXPECT_LE(progress.bytes, progress.bytes_total);
                                                  if (std::exchange(done, true)) return;
                                                  EXPECT_THAT(store_->DeleteSequence(kTenant, deleted), IsOk());
                                                  EXPECT_THAT(blobs_->Remove(deleted), IsOk());
                                                }}));
  EXPECT_EQ(summary.database_states, 2);
  EXPECT_EQ(summary.sequences, 1);
  EXPECT_THAT(summary.faults, IsEmpty());
  for (const std::string& file : FilesIn(to_)) EXPECT_EQ(file.find(deleted), std::string::npos) << file;
  EXPECT_EQ(ReadText(to_ + "/sequences/" + kept + "/rgb/b"), "second");
  EXPECT_THAT(RestoreBackup(to_, new_), IsOk());
}

TEST_F(BackupTest, ALostFileIsNamedAndTheRestIsKept) {
  const std::string id = Upload("first", "second", 11);
  fs::remove(directory_->SequenceFolder(id) + "/a");
  fs::resize_file(directory_->SequenceFolder(id) + "/rgb/b", 4);
  const BackupSummary summary = Take(MakeBackup(data_, to_));
  const std::string folder = "sequences/" + id + "/";
  EXPECT_THAT(summary.faults, ElementsAre(folder + "a is missing", folder + "rgb/b has 4 bytes, must have 6"));
  EXPECT_EQ(ReadText(to_ + "/" + folder + "rgb/b"), "seco");
  EXPECT_THAT(RestoreBackup(to_, new_), IsOk()) << "as good as it was";
}

TEST_F(BackupTest, ADamagedFileIsNamed) {
  const std::string id = Take(store_->CreateSequence(kTenant, "", "")).id;
  const UploadRecord upload =
      Take(store_->CreateUpload(kTenant, id, {{.path = "a", .size_bytes = 5}}, /*room_bytes=*/1000, ""));
  EXPECT_THAT(blobs_->Write(id, "a", 0, "first"), IsOk());
  const std::string file = directory_->SequenceFolder(id) + "/a";
  EXPECT_THAT(store_->SetCommittedSize(upload.id, 5, {Take(ChecksumOf(file, "a"))}), IsOk());
  EXPECT_THAT(Take(MakeBackup(data_, to_)).faults, IsEmpty());
  WriteText(file, "fisrt");
  EXPECT_THAT(Take(MakeBackup(data_, folder_ / "second")).faults,
              ElementsAre("sequences/" + id + "/a is damaged: its bytes are not those that were stored"));
}

// As before an update of the server, whose start changes the schema.
TEST_F(BackupTest, OfAnOlderVersionToo) {
  Close();
  for (const char* end : {"", "-wal", "-shm"}) fs::remove(data_ + "/" + kDatabaseName + end);
  const std::vector<std::string>& steps = SchemaSteps();
  EXPECT_THAT(Take(Database::Open(data_ + "/" + kDatabaseName))->Migrate({steps.begin(), steps.begin() + 3}), IsOk());
  EXPECT_THAT(MakeBackup(data_, to_), IsOk());
  Take(RestoreBackup(to_, new_));
  EXPECT_THAT(OpenSqliteStoreToRead(new_ + "/" + kDatabaseName), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(OpenSqliteStore(new_ + "/" + kDatabaseName, {}), IsOk());
  EXPECT_THAT(OpenSqliteStoreToRead(new_ + "/" + kDatabaseName), IsOk());
}

TEST_F(BackupTest, AChangedOrMissingByteFailsTheRestoreAndLeavesNothing) {
  const std::string id = Upload("first", "second", 11);
  Take(MakeBackup(data_, to_));
  const std::string file = "sequences/" + id + "/rgb/b";
  WriteText(to_ + "/" + file, "sEcond");
  absl::Status damaged = RestoreBackup(to_, new_).status();
  EXPECT_THAT(damaged, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(std::string(damaged.message()), HasSubstr(file));
  EXPECT_THAT(FilesIn(new_), IsEmpty());
  fs::remove(to_ + "/" + file);
  EXPECT_THAT(RestoreBackup(to_, new_), HasCode(absl::StatusCode::kDataLoss));
  WriteText(to_ + "/" + file, "second");
  EXPECT_THAT(RestoreBackup(to_, new_), IsOk());
  // A list that was cut short, and one that leads out of the folder.
  const std::string list = ReadText(to_ + "/backup.sha256");
  WriteText(to_ + "/backup.sha256", list.substr(0, list.rfind('#')));
  EXPECT_THAT(RestoreBackup(to_, folder_ / "new2"), HasCode(absl::StatusCode::kDataLoss));
  WriteText(to_ + "/backup.sha256", list.substr(0, list.rfind('#')) + std::string(64, '0') + "  a/../../x\n");
  EXPECT_THAT(RestoreBackup(to_, folder_ / "new2"), HasCode(absl::StatusCode::kDataLoss));
}

TEST_F(BackupTest, NothingIsWrittenOver) {
  Upload("first", "second", 11);
  Take(MakeBackup(data_, to_));
  EXPECT_THAT(MakeBackup(data_, to_), HasCode(absl::StatusCode::kAlreadyExists));
  EXPECT_THAT(RestoreBackup(to_, data_), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(RestoreBackup(data_, new_), HasCode(absl::StatusCode::kFailedPrecondition)) << "it is no backup";
  WriteText(new_ + "/mine", "x");
  EXPECT_THAT(RestoreBackup(to_, new_), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(FilesIn(new_), ElementsAre("mine"));
  // What an interrupted backup left is not taken for one, and not written into.
  fs::create_directory(folder_ / "other.partial");
  EXPECT_THAT(MakeBackup(data_, folder_ / "other"), HasCode(absl::StatusCode::kAlreadyExists));
  EXPECT_THAT(MakeBackup(data_, data_ + "/inside"), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(MakeBackup(new_, folder_ / "third"), HasCode(absl::StatusCode::kFailedPrecondition));
}

TEST_F(BackupTest, SharesWithAnEarlierOneWhatHasNotChanged) {
  const std::string first = Upload("first", "second", 11);
  Take(MakeBackup(data_, to_));
  const std::string second = Upload("third", "fourth", 11);
  const std::string next = folder_ / "next";
  const BackupSummary summary = Take(MakeBackup(data_, next, {.link_unchanged_from = to_}));
  EXPECT_EQ(summary.linked_files, 2);
  EXPECT_TRUE(fs::equivalent(to_ + "/sequences/" + first + "/rgb/b", next + "/sequences/" + first + "/rgb/b"));
  EXPECT_EQ(ReadText(next + "/sequences/" + second + "/a"), "third");
  EXPECT_THAT(RestoreBackup(next, new_), IsOk());
  // The earlier one is as it was.
  EXPECT_THAT(RestoreBackup(to_, folder_ / "new2"), IsOk());
}

TEST_F(BackupTest, AFullDiskIsAStatusAndLeavesNothing) {
  const SmallDisk disk("256k");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  const std::string id = Take(store_->CreateSequence(kTenant, "", "")).id;
  const std::string big(300 << 10, 'x');
  const UploadRecord upload = Take(store_->CreateUpload(
      kTenant, id, {{.path = "a", .size_bytes = static_cast<int64_t>(big.size())}}, /*room_bytes=*/1 << 20, ""));
  EXPECT_THAT(blobs_->Write(id, "a", 0, big), IsOk());
  EXPECT_THAT(store_->SetCommittedSize(upload.id, static_cast<int64_t>(big.size())), IsOk());
  EXPECT_THAT(MakeBackup(data_, disk.path() + "/backup"), HasCode(absl::StatusCode::kResourceExhausted));
  EXPECT_TRUE(fs::is_empty(disk.path()));
}

}  // namespace
}  // namespace depthtween::server
