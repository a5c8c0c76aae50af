// Bytes and folders on the disk, checked by reading the files themselves.
#include "server/store/blob_store.h"

#include <atomic>
#include <thread>

#include "server/store/folder_blob_store.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Not;

class BlobStoreTest : public testing::Test {
 protected:
  TemporaryFolder folder_;
  std::unique_ptr<DataDirectory> directory_ = Take(DataDirectory::Open(folder_ / "data"));
  std::unique_ptr<BlobStore> blobs_ = MakeFolderBlobStore(*directory_);

  std::string Content(const std::string& path) { return ReadText(directory_->SequenceFolder("s") + "/" + path); }
};

TEST_F(BlobStoreTest, WritesWhereItIsToldAndEndsThere) {
  EXPECT_THAT(blobs_->Write("s", "rgb/0.png", 0, "hello world"), IsOk());
  EXPECT_THAT(blobs_->Write("s", "rgb/0.png", 6, "there"), IsOk());
  EXPECT_EQ(Content("rgb/0.png"), "hello there");
  // What an earlier attempt left beyond is gone.
  EXPECT_THAT(blobs_->Write("s", "rgb/0.png", 5, "!"), IsOk());
  EXPECT_EQ(Content("rgb/0.png"), "hello!");
  EXPECT_THAT(blobs_->MakeDurable(), IsOk());
  std::string read;
  EXPECT_THAT(blobs_->Read("s", "rgb/0.png", 5, [&](std::string_view piece) { read += piece; }), IsOk());
  EXPECT_EQ(read, "hello");
  EXPECT_THAT(blobs_->Read("s", "rgb/0.png", 7, [](std::string_view) {}), HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(blobs_->Read("s", "none", 1, [](std::string_view) {}), HasCode(absl::StatusCode::kNotFound));
}

TEST_F(BlobStoreTest, NeverLeavesItsFolder) {
  EXPECT_THAT(blobs_->Write("s", "../s2/x", 0, "x"), HasCode(absl::StatusCode::kInvalidArgument));
  // Not through a link either, should one ever get there.
  EXPECT_THAT(blobs_->Write("s", "a", 0, "a"), IsOk());
  std::filesystem::create_symlink("/tmp/elsewhere", directory_->SequenceFolder("s") + "/link");
  EXPECT_THAT(blobs_->Write("s", "link", 0, "x"), Not(IsOk()));
}

TEST_F(BlobStoreTest, OneFileIsRemovedWithTheFoldersThatItLeavesEmpty) {
  EXPECT_THAT(blobs_->Write("s", "rgb/a/b/0.png", 0, "x"), IsOk());
  EXPECT_THAT(blobs_->Write("s", "rgb/1.png", 0, "x"), IsOk());
  EXPECT_THAT(blobs_->RemoveFile("s", "rgb/a/b/0.png"), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder("s") + "/rgb/a"));
  EXPECT_EQ(Content("rgb/1.png"), "x");
  EXPECT_THAT(blobs_->RemoveFile("s", "rgb/a/b/0.png"), IsOk()) << "there is none";
  EXPECT_THAT(blobs_->RemoveFile("s", "rgb/1.png/x"), IsOk()) << "nor could there be one";
  EXPECT_THAT(blobs_->RemoveFile("s", "rgb/1.png"), IsOk());
  EXPECT_THAT(blobs_->Write("s", "rgb", 0, "a file now"), IsOk());
  EXPECT_THAT(blobs_->RemoveFile("s", "../s2/x"), HasCode(absl::StatusCode::kInvalidArgument));
}

// One thread makes and removes a folder by its only file, the other writes others there: no write may fail.
TEST_F(BlobStoreTest, AFolderThatGoesAwayHindersNoWrite) {
  std::atomic<bool> over = false;
  std::thread other([&] {
    while (!over) {
      EXPECT_THAT(blobs_->Write("s", "rgb/x/a", 0, "x"), IsOk());
      EXPECT_THAT(blobs_->RemoveFile("s", "rgb/x/a"), IsOk());
    }
  });
  for (int i = 0; i < 500; ++i) {
    EXPECT_THAT(blobs_->Write("s", "rgb/x/b", 0, "y"), IsOk());
    EXPECT_THAT(blobs_->RemoveFile("s", "rgb/x/b"), IsOk());
  }
  over = true;
  other.join();
}

TEST_F(BlobStoreTest, RemovedFilesAreGoneAtOnce) {
  EXPECT_THAT(blobs_->Write("s", "a/b", 0, "x"), IsOk());
  EXPECT_THAT(blobs_->Remove("s"), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder("s")));
  EXPECT_THAT(blobs_->Remove("s"), IsOk());
}

// A disk of one megabyte that is really full.
TEST(BlobStore, FullDiskIsAStatus) {
  const SmallDisk disk("1m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  const auto directory = Take(DataDirectory::Open(disk.path()));
  const auto blobs = MakeFolderBlobStore(*directory);
  EXPECT_THAT(blobs->Write("s", "a", 0, "before"), IsOk());
  EXPECT_THAT(blobs->Write("s", "b", 0, std::string(2 << 20, 'x')),
              HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  EXPECT_EQ(ReadText(directory->SequenceFolder("s") + "/a"), "before");
  EXPECT_LT(Take(blobs->FreeBytes()), 1 << 20);
}

TEST(DataDirectory, BelongsToOneProcess) {
  const TemporaryFolder folder;
  auto first = Take(DataDirectory::Open(folder / "data"));
  const auto second = DataDirectory::Open(folder / "data");
  EXPECT_THAT(second, HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(std::string(second.status().message()), HasSubstr(std::to_string(getpid())));
  first.reset();
  EXPECT_THAT(DataDirectory::Open(folder / "data"), IsOk());
}

// What was said with the status stays with it.
TEST(DataDirectory, KeepsItsPlaceToItself) {
  const TemporaryFolder folder;
  const auto directory = Take(DataDirectory::Open(folder / "data/"));
  EXPECT_EQ(directory->path(), folder / "data");
  const absl::Status told = directory->WithoutPath(
      BadField("f", absl::StrCat(directory->OutFolder("7"), "/a: is not ", directory->TaskFolder(3), "/b")));
  EXPECT_EQ(told.message(), "jobs/7/out/a: is not tasks/3/b");
  EXPECT_THAT(told, HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(directory->WithoutPath(absl::OkStatus()), IsOk());
  const std::string& path = directory->path();
  EXPECT_EQ(directory->WithoutPath(absl::InternalError("statvfs " + path + ": no")).message(),
            "statvfs the data folder: no");
  EXPECT_EQ(directory->WithoutPath(absl::InternalError("in " + path)).message(), "in the data folder");
  const std::string other = path + "2/x is not " + path + "-3";
  EXPECT_EQ(directory->WithoutPath(absl::InternalError(other)).message(), other);
}

TEST(DataDirectory, SweepsWhatAnEarlierProcessDiscarded) {
  const TemporaryFolder folder;
  EXPECT_THAT(DataDirectory::Open(folder / "data"), IsOk());
  WriteText(folder / "data/trash/old/file", "x");
  const auto directory = Take(DataDirectory::Open(folder / "data"));
  WriteText(directory->JobFolder("j") + "/out/file", "x");
  EXPECT_THAT(directory->Discard(directory->JobFolder("j")), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory->JobFolder("j")));
  // In the background: waited for without a deadline of its own, the test's time-out is the limit.
  while (!std::filesystem::is_empty(folder / "data/trash")) usleep(1000);
}

// A folder that somebody else uses may have folders of the same names. Nothing in it changes.
TEST(DataDirectory, RefusesAFolderOfSomebodyElse) {
  const TemporaryFolder folder;
  for (const char* file : {"jobs/1/a", "tasks/1/b", "trash/c", "sequences/s/d"}) folder.Write(file, "x");
  const auto opened = DataDirectory::Open(folder.path());
  EXPECT_THAT(opened, HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(std::string(opened.status().message()), HasSubstr("is not a data folder"));
  for (const char* file : {"jobs/1/a", "tasks/1/b", "trash/c", "sequences/s/d"}) EXPECT_TRUE(folder.Has(file)) << file;
  EXPECT_FALSE(folder.Has("lock"));
}

// The root of a file system of its own is empty but for one folder.
TEST(DataDirectory, KeepsItsIdWhereverItIsMoved) {
  const TemporaryFolder folder;
  folder.Write("data/lost+found/x", "");
  const std::string id = Take(DataDirectory::Open(folder / "data"))->id();
  EXPECT_EQ(id.size(), 32U);
  std::filesystem::rename(folder / "data", folder / "moved");
  EXPECT_EQ(Take(DataDirectory::Open(folder / "moved"))->id(), id);
  EXPECT_NE(Take(DataDirectory::Open(folder / "another"))->id(), id);
  folder.Write("moved/depthtween-data", "something else");
  EXPECT_THAT(DataDirectory::Open(folder / "moved"), HasCode(absl::StatusCode::kDataLoss));
}

TEST(DataDirectory, QuarantineKeepsForDays) {
  const TemporaryFolder folder;
  {
    const auto directory = Take(DataDirectory::Open(folder / "data"));
    WriteText(directory->JobFolder("j") + "/out/file", "x");
    const std::string kept = Take(directory->Quarantine(directory->JobFolder("j"), "jobs-j"));
    EXPECT_EQ(ReadText(kept + "/out/file"), "x");
    std::filesystem::rename(kept, folder / "data/quarantine/20200101T000000Z-jobs-j");
    WriteText(directory->JobFolder("j") + "/out/file", "y");
    EXPECT_THAT(directory->Quarantine(directory->JobFolder("j"), "jobs-j"), IsOk());
    folder.Write("data/quarantine/by-hand/file", "z");
  }
  const auto directory = Take(DataDirectory::Open(folder / "data"));
  while (folder.Has("data/quarantine/20200101T000000Z-jobs-j")) usleep(1000);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(directory->QuarantineFolder()), {}), 2);
  EXPECT_TRUE(folder.Has("data/quarantine/by-hand/file"));
}

}  // namespace
}  // namespace depthtween::server
