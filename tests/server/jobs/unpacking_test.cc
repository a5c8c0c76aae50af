// Folders before and after each step, with what a child could have left there. What must be there is written out.
#include "server/jobs/unpacking.h"

#include "server/store/files.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::UnorderedElementsAre;

class UnpackingTest : public testing::Test {
 protected:
  UnpackingTest() {
    std::filesystem::create_directories(sequence_);
    std::filesystem::create_directories(unpacked_ + "/rgb/deeper");
    WriteText(sequence_ + "/clip.zip", "PK");
    WriteText(unpacked_ + "/rgb.txt", "list");
    WriteText(unpacked_ + "/rgb/0.png", "");
    WriteText(unpacked_ + "/rgb/deeper/1.png", "one");
  }
  absl::StatusOr<UnpackedFiles> List(int max_files = 3, int64_t max_bytes = 7, const std::stop_token& stop = {}) {
    return ListUnpacked(unpacked_, archive_, max_files, max_bytes, stop);
  }

  const TemporaryFolder folder_;
  const std::string sequence_ = folder_ / "sequence", unpacked_ = folder_ / "unpacked";
  SequenceArchive archive_ = {.path = "clip.zip"};
};

TEST_F(UnpackingTest, FilesTakeTheArchivesPlace) {
  const UnpackedFiles found = Take(List());
  EXPECT_THAT(found.violations, IsEmpty());
  ASSERT_THAT(found.files, SizeIs(3));
  EXPECT_EQ(found.files[0].path, "rgb.txt");
  EXPECT_EQ(found.files[1].path, "rgb/0.png");
  EXPECT_EQ(found.files[2].path, "rgb/deeper/1.png");
  EXPECT_EQ(found.files[2].size_bytes, 3);
  EXPECT_TRUE(Matches(found.files[2], "one"));

  EXPECT_THAT(MoveUnpacked(unpacked_, sequence_), IsOk());
  EXPECT_THAT(NamesIn(unpacked_), IsEmpty());
  EXPECT_EQ(ReadText(sequence_ + "/rgb/deeper/1.png"), "one");
  archive_.unpacked = true;
  EXPECT_THAT(CleanSequence(sequence_, archive_), IsOk());
  EXPECT_THAT(NamesIn(sequence_), UnorderedElementsAre("rgb", "rgb.txt"));
}

TEST_F(UnpackingTest, BeforeTheFilesAreRecordedTheArchiveAloneCounts) {
  EXPECT_THAT(MoveUnpacked(unpacked_, sequence_), IsOk());
  EXPECT_THAT(CleanSequence(sequence_, archive_), IsOk());
  EXPECT_THAT(NamesIn(sequence_), ElementsAre("clip.zip"));
  EXPECT_THAT(CleanSequence(folder_ / "none", archive_), IsOk()) << "the sequence has been deleted";
}

// The child is a decoder of strangers' files that may have been taken over.
TEST_F(UnpackingTest, WhatAChildLeftIsNotTrusted) {
  EXPECT_THAT(List(2), HasStatus(absl::StatusCode::kResourceExhausted, HasSubstr("more than 2 files")));
  EXPECT_THAT(List(3, 6), HasStatus(absl::StatusCode::kResourceExhausted, HasSubstr("more than 6 bytes")));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THAT(List(3, 7, stop.get_token()), HasCode(absl::StatusCode::kCancelled));
  for (const char* name : {"clip.zip", "rgb/.hidden", "rgb/a?.png", "a/b/c/d/e/f"}) {
    const std::string path = unpacked_ + "/" + name;
    std::filesystem::create_directories(std::filesystem::path(path).parent_path());
    WriteText(path, "x");
    const UnpackedFiles found = Take(List());
    ASSERT_THAT(found.violations, SizeIs(1)) << name;
    EXPECT_EQ(found.violations[0].file, name);
    EXPECT_THAT(found.violations[0].status, HasCode(absl::StatusCode::kInvalidArgument));
    std::filesystem::remove(path);
  }
  std::filesystem::create_symlink("/etc/passwd", unpacked_ + "/link");
  EXPECT_THAT(List(), HasCode(absl::StatusCode::kInternal));
}

TEST_F(UnpackingTest, NothingIsMovedToWhereThereIsNoFolder) {
  EXPECT_THAT(MoveUnpacked(unpacked_, folder_ / "none"), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(List(), IsOk());
}

}  // namespace
}  // namespace depthtween::server
