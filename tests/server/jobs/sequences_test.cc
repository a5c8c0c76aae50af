// Uploads, byte by byte: what arrives, what is refused, where an interrupted one goes on. Expected files are the bytes
// sent.
#include "server/jobs/sequences.h"

#include <random>

#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

std::string Hash(std::string_view bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.Finish();
}

class SequencesTest : public JobsFixture {
 protected:
  SequencesTest() {
    OpenStores(folder_ / "data");
    id_ = Take(sequences_->Create(kTenant, "", "")).id;
  }
  // An upload of files with this content, in this order.
  UploadRecord StartUpload(const std::vector<std::pair<std::string, std::string>>& files, bool hashed = true) {
    std::vector<UploadFile> manifest;
    for (const auto& [path, content] : files) {
      manifest.push_back(
          {.path = path, .size_bytes = static_cast<int64_t>(content.size()), .sha256 = hashed ? Hash(content) : ""});
      all_ += content;
    }
    return Take(sequences_->StartUpload(kTenant, id_, manifest, ""));
  }
  std::unique_ptr<UploadWriter> OpenUpload(const UploadRecord& upload) {
    return Take(sequences_->OpenUpload(kTenant, id_, upload.id));
  }
  static absl::Status Send(UploadWriter& writer, int64_t offset, std::string_view bytes) {
    return writer.Write(offset, bytes, Crc32c(bytes));
  }
  int64_t Committed(const UploadRecord& upload) {
    return Take(sequences_->GetUpload(kTenant, id_, upload.id)).committed_size;
  }
  std::string Content(const std::string& path) { return ReadText(directory_->SequenceFolder(id_) + "/" + path); }

  std::string id_;
  std::string all_;  // the bytes of the upload, in order
};

TEST_F(SequencesTest, OneStreamCarriesManyFiles) {
  const UploadRecord upload = StartUpload(
      {{"empty_first", ""}, {"rgb/0.png", "abc"}, {"x/empty", ""}, {"depth/0.png", "defgh"}, {"empty_last", ""}});
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, "ab"), IsOk());
  EXPECT_THAT(Send(*writer, 2, "cdef"), IsOk()) << "one message may span files";
  EXPECT_THAT(Send(*writer, 6, "gh"), IsOk());
  const UploadRecord finished = Take(writer->Finish());
  EXPECT_TRUE(finished.finished);
  EXPECT_EQ(finished.committed_size, 8);
  EXPECT_EQ(Content("rgb/0.png"), "abc");
  EXPECT_EQ(Content("depth/0.png"), "defgh");
  for (const char* path : {"empty_first", "x/empty", "empty_last"}) {
    EXPECT_TRUE(std::filesystem::exists(directory_->SequenceFolder(id_) + "/" + path)) << path;
  }
  EXPECT_THAT(sequences_->OpenUpload(kTenant, id_, upload.id), HasCode(absl::StatusCode::kFailedPrecondition));
}

TEST_F(SequencesTest, UploadOfNothingButEmptyFiles) {
  const UploadRecord upload = StartUpload({{"a", ""}, {"b", ""}});
  EXPECT_TRUE(Take(OpenUpload(upload)->Finish()).finished);
  EXPECT_TRUE(std::filesystem::exists(directory_->SequenceFolder(id_) + "/b"));
}

TEST_F(SequencesTest, WrongOffsetSaysWhereToGoOn) {
  const UploadRecord upload = StartUpload({{"a", "0123456789"}});
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, "0123"), IsOk());
  for (const int64_t offset : {0, 3, 5, -1}) {
    const absl::Status status = Send(*writer, offset, "x");
    EXPECT_THAT(status, HasReason(absl::StatusCode::kOutOfRange, "OFFSET_MISMATCH"));
    EXPECT_EQ(GetErrorInfo(status)->metadata["committed_size"], "4");
  }
  EXPECT_THAT(Send(*writer, 4, "4567890"), HasCode(absl::StatusCode::kOutOfRange)) << "more than was announced";
  EXPECT_THAT(writer->Finish(), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Take(writer->Close()).committed_size, 4);
}

TEST_F(SequencesTest, WrongChecksumKeepsNothingOfTheMessage) {
  const UploadRecord upload = StartUpload({{"a", "0123456789"}});
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, "0123"), IsOk());
  EXPECT_THAT(writer->Write(4, "4567", Crc32c("4568")), HasReason(absl::StatusCode::kDataLoss, "CHECKSUM_MISMATCH"));
  EXPECT_EQ(Take(writer->Close()).committed_size, 4);
  EXPECT_THAT(Send(*writer, 4, "456789"), IsOk());
  EXPECT_THAT(writer->Finish(), IsOk());
  EXPECT_EQ(Content("a"), "0123456789");
}

TEST_F(SequencesTest, WrongHashKeepsNothingOfTheFile) {
  const UploadRecord upload = StartUpload({{"a", "0123"}, {"b", "4567"}, {"c", "89"}});
  auto writer = OpenUpload(upload);
  // Half of b is durable before the damage shows.
  EXPECT_THAT(Send(*writer, 0, "0123xx"), IsOk());
  EXPECT_THAT(writer->Close(), IsOk());
  EXPECT_EQ(Committed(upload), 6);
  const absl::Status status = Send(*writer, 6, "6789");
  EXPECT_THAT(status, HasReason(absl::StatusCode::kDataLoss, "CHECKSUM_MISMATCH"));
  EXPECT_EQ(GetErrorInfo(status)->metadata["path"], "b");
  EXPECT_EQ(Committed(upload), 4) << "a stays, b begins anew";
  writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 4, "456789"), IsOk());
  EXPECT_THAT(writer->Finish(), IsOk());
  EXPECT_EQ(Content("b"), "4567");
}

TEST_F(SequencesTest, NewerConnectionTakesOver) {
  const UploadRecord upload = StartUpload({{"a", "0123456789"}});
  auto older = OpenUpload(upload);
  EXPECT_THAT(Send(*older, 0, "0123xxx"), IsOk());
  auto newer = OpenUpload(upload);
  EXPECT_THAT(Send(*older, 7, "x"), HasReason(absl::StatusCode::kAborted, "TAKEN_OVER"));
  EXPECT_THAT(older->Close(), HasCode(absl::StatusCode::kAborted));
  // What the older one had not made durable is written anew.
  EXPECT_THAT(Send(*newer, 0, "01234"), IsOk());
  older.reset();
  EXPECT_THAT(Send(*newer, 5, "56789"), IsOk());
  EXPECT_THAT(newer->Finish(), IsOk());
  EXPECT_EQ(Content("a"), "0123456789");
}

TEST_F(SequencesTest, MessageOverTheLimitIsRefused) {
  const UploadRecord upload = StartUpload({{"a", std::string(2 << 20, 'x')}}, /*hashed=*/false);
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, std::string((1 << 20) + 1, 'x')),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(Send(*writer, 0, std::string(1 << 20, 'x')), IsOk());
}

// Cut at random bytes, with the process dying there: what was acknowledged is kept, what was not may be on the disk as
// garbage; the end is always the bytes sent. 10 runs with fixed seeds.
TEST_F(SequencesTest, UploadCutAtRandomBytesEndsWithTheSameFiles) {
  for (int seed = 0; seed < 10; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937 random(seed);
    all_.clear();
    id_ = Take(sequences_->Create(kTenant, "", "")).id;
    std::vector<std::pair<std::string, std::string>> files;
    for (int i = 0; i < 8; ++i) {
      std::string content(random() % 40, '\0');
      for (char& c : content) c = static_cast<char>(random());
      files.emplace_back("rgb/" + std::to_string(i), content);
    }
    const UploadRecord upload = StartUpload(files, /*hashed=*/seed % 2 == 0);
    while (Committed(upload) < upload.size_bytes) {
      const int64_t start = Committed(upload);
      {
        auto writer = OpenUpload(upload);
        int64_t offset = start;
        for (int message = 0; message < 3 && offset < upload.size_bytes; ++message) {
          const std::string_view piece = std::string_view(all_).substr(static_cast<size_t>(offset), 1 + random() % 30);
          ASSERT_THAT(Send(*writer, offset, piece), IsOk());
          offset += static_cast<int64_t>(piece.size());
        }
        ASSERT_EQ(Take(writer->Close()).committed_size, offset);
      }
      // Bytes that reached the disk and were never acknowledged.
      const size_t file = random() % files.size();
      int64_t file_start = 0;
      for (size_t i = 0; i < file; ++i) file_start += static_cast<int64_t>(files[i].second.size());
      const int64_t acknowledged = Committed(upload) - file_start;
      const auto size = static_cast<int64_t>(files[file].second.size());
      if (acknowledged < size) {
        const std::string path = directory_->SequenceFolder(id_) + "/" + files[file].first;
        WriteText(path,
                  files[file].second.substr(0, static_cast<size_t>(std::max<int64_t>(0, acknowledged))) + "garbage");
      }
      Close();
      OpenStores(folder_ / "data");
    }
    ASSERT_THAT(OpenUpload(upload)->Finish(), IsOk());
    for (const auto& [path, content] : files) EXPECT_EQ(Content(path), content) << path;
  }
}

TEST_F(SequencesTest, DeletedUploadLeavesNoFiles) {
  const UploadRecord kept = StartUpload({{"rgb/0.png", "01"}});
  auto finished = OpenUpload(kept);
  EXPECT_THAT(Send(*finished, 0, "01"), IsOk());
  EXPECT_THAT(finished->Finish(), IsOk());
  const UploadRecord upload = StartUpload({{"rgb/1.png", "23"}, {"depth/0.png", "45"}});
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, "234"), IsOk());
  EXPECT_THAT(sequences_->DeleteUpload(kTenant, id_, upload.id), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder(id_) + "/rgb/1.png"));
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder(id_) + "/depth"));
  // Whoever was writing it finds out, and what it had in hand makes no file.
  EXPECT_THAT(Send(*writer, 3, "5"), HasReason(absl::StatusCode::kAborted, "TAKEN_OVER"));
  EXPECT_THAT(writer->Close(), HasCode(absl::StatusCode::kAborted));
  writer.reset();
  EXPECT_THAT(sequences_->GetUpload(kTenant, id_, upload.id), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(sequences_->DeleteUpload(kTenant, id_, upload.id), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(sequences_->DeleteUpload(kTenant, id_, kept.id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Content("rgb/0.png"), "01");
  EXPECT_THAT(sequences_->Commit(kTenant, id_), IsOk());
}

// Killed between two steps of a deletion: the upload is at 0, whatever of its files is left, and goes on from there.
TEST_F(SequencesTest, AnUploadWhoseDeletionWasCutOffBeginsAnew) {
  for (const bool removed : {false, true}) {
    const std::string path = removed ? "a/1" : "a/0";
    all_.clear();
    const UploadRecord upload = StartUpload({{path, "0123"}});
    EXPECT_THAT(Send(*OpenUpload(upload), 0, "012"), IsOk());
    EXPECT_THAT(store_->RewindUpload(kTenant, id_, upload.id), IsOk());
    if (removed) {
      EXPECT_THAT(blobs_->RemoveFile(id_, path), IsOk());
    }
    Close();
    OpenStores(folder_ / "data");
    EXPECT_EQ(Committed(upload), 0);
    auto writer = OpenUpload(upload);
    EXPECT_THAT(Send(*writer, 0, "0123"), IsOk());
    EXPECT_THAT(writer->Finish(), IsOk());
    EXPECT_EQ(Content(path), "0123");
  }
}

TEST_F(SequencesTest, DeletedSequenceLeavesNoFiles) {
  const UploadRecord upload = StartUpload({{"a", "0123"}});
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, "0123"), IsOk());
  EXPECT_THAT(sequences_->Delete(kTenant, id_), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory_->SequenceFolder(id_)));
  EXPECT_THAT(writer->Finish(), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(sequences_->Get(kTenant, id_), HasCode(absl::StatusCode::kNotFound));
}

// The disk is really full: what was acknowledged before stays, and the upload goes on when there is room.
TEST_F(SequencesTest, FullDiskFailsTheUploadAndHarmsNothingElse) {
  const SmallDisk disk("3m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  Close();
  OpenStores(disk.path());
  id_ = Take(sequences_->Create(kTenant, "", "")).id;
  EXPECT_THAT(sequences_->StartUpload(kTenant, id_, {{.path = "big", .size_bytes = 4 << 20}}, ""),
              HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"))
      << "refused before bytes flow";
  const std::string megabyte(1 << 20, 'x');
  const UploadRecord upload = StartUpload({{"a", megabyte + megabyte}}, /*hashed=*/false);
  auto writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 0, megabyte), IsOk());
  EXPECT_THAT(writer->Close(), IsOk());
  const int64_t filler = Take(blobs_->FreeBytes()) - (256 << 10);
  WriteText(disk.path() + "/filler", std::string(static_cast<size_t>(filler), 'x'));
  EXPECT_THAT(Send(*writer, 1 << 20, megabyte), HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  EXPECT_EQ(Committed(upload), 1 << 20);
  EXPECT_THAT(sequences_->Get(kTenant, id_), IsOk());
  std::filesystem::remove(disk.path() + "/filler");
  writer = OpenUpload(upload);
  EXPECT_THAT(Send(*writer, 1 << 20, megabyte), IsOk());
  EXPECT_THAT(writer->Finish(), IsOk());
  EXPECT_EQ(Content("a"), megabyte + megabyte);
  writer.reset();
  Close();
}

// However an upload was cut, each complete file has the checksum of its bytes, and no other has one.
TEST_F(SequencesTest, ChecksumsAreThoseOfTheFiles) {
  std::string large(static_cast<size_t>(kChecksumBlockBytes) + 100, 'a');
  for (size_t i = 0; i < large.size(); i += 7) large[i] = static_cast<char>(i);
  for (const bool hashed : {false, true}) {
    if (hashed) {
      id_ = Take(sequences_->Create(kTenant, "", "")).id;
      all_.clear();
    }
    const UploadRecord upload = StartUpload({{"empty", ""}, {"first", "abc"}, {"large", large}, {"last", "x"}}, hashed);
    const auto size = static_cast<int64_t>(all_.size());
    int64_t sent = 0;
    for (const int64_t to : {int64_t{2}, int64_t{3}, int64_t{100}, kChecksumBlockBytes + 3, size - 1, size}) {
      auto writer = OpenUpload(upload);
      EXPECT_THAT(
          Send(*writer, sent, std::string_view(all_).substr(static_cast<size_t>(sent), static_cast<size_t>(to - sent))),
          IsOk());
      sent = to;
      EXPECT_THAT(writer->Close(), IsOk());
      const std::vector<FileChecksum> files = Take(store_->SequenceFiles(id_));
      EXPECT_EQ(files.size(), 1U + (to >= 3 ? 1 : 0) + (to >= size - 1 ? 1 : 0) + (to == size ? 1 : 0)) << to;
      for (const FileChecksum& file : files) EXPECT_TRUE(Matches(file, Content(file.path))) << file.path;
    }
    EXPECT_THAT(OpenUpload(upload)->Finish(), IsOk());
  }
}

}  // namespace
}  // namespace depthtween::server
