// Recordings on disk. Which files belong to one, and their bytes, are what the test wrote.
#include "client/lib/local_sequence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"

namespace depthtween::client {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

void WriteRecording(const TemporaryFolder& folder) {
  folder.Write("rgb.txt", "# colour\n0.0 rgb/a.png\n\n0.1\trgb/b c.png\r\n");
  folder.Write("depth.txt", "0.0 depth/a.png\nno-name-on-this-line\n");
  folder.Write("camera.json", "{}");
  folder.Write("rgb/a.png", "red");
  folder.Write("rgb/b c.png", "");
  folder.Write("depth/a.png", "deep");
  folder.Write("gt/depth/a.png", "must stay at home");
}

std::vector<std::string> Paths(const LocalSequence& sequence) {
  std::vector<std::string> paths;
  for (const LocalFile& file : sequence.files) paths.push_back(file.path);
  return paths;
}

// The lists say what belongs to a recording; ground truth beside them does not.
TEST(FindSequence, FindsWhatTheListsNameAndNothingElse) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  const auto sequence = FindSequence(folder.path());
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_THAT(Paths(*sequence),
              ElementsAre("camera.json", "rgb.txt", "depth.txt", "rgb/a.png", "rgb/b c.png", "depth/a.png"));
}

// Editors on Windows put a mark before the text; names with blanks and letters of any language are names.
TEST(FindSequence, ReadsListsOfAnyEditorAndLanguage) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  folder.Write("rgb.txt", "\xEF\xBB\xBF# timestamp filename\n0.0 rgb/Bild \xC3\xBC \xE6\xB7\xB1 (1) 100% #1.png\n");
  folder.Write("rgb/Bild \xC3\xBC \xE6\xB7\xB1 (1) 100% #1.png", "red");
  const auto sequence = FindSequence(folder.path());
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_THAT(Paths(*sequence), ElementsAre("camera.json", "rgb.txt", "depth.txt",
                                            "rgb/Bild \xC3\xBC \xE6\xB7\xB1 (1) 100% #1.png", "depth/a.png"));
}

// Two of the files are deleted, so exactly those must be named.
TEST(FindSequence, NamesEveryMissingFile) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  std::filesystem::remove(folder / "camera.json");
  std::filesystem::remove(folder / "depth/a.png");
  const auto sequence = FindSequence(folder.path());
  EXPECT_TRUE(absl::IsNotFound(sequence.status()));
  EXPECT_THAT(std::string(sequence.status().message()),
              AllOf(HasSubstr("lacks 2 files: camera.json, depth/a.png"), Not(HasSubstr("rgb/a.png"))));
}

TEST(FindSequence, TakesAnArchiveAsItIs) {
  const TemporaryFolder folder;
  folder.Write("clips/hands.ZIP", "packed");
  folder.Write("clips/hands.txt", "text");
  auto sequence = FindSequence(folder / "clips/hands.ZIP");
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_THAT(Paths(*sequence), ElementsAre("hands.ZIP"));
  EXPECT_EQ(sequence->display_name, "hands.ZIP");
  EXPECT_EQ(sequence->size_bytes, 6);
  ASSERT_TRUE(HashFiles(*sequence, nullptr).ok());
  const auto bytes = ConcatenatedFiles(sequence->directory, sequence->files).Read(0, 100);
  ASSERT_TRUE(bytes.ok());
  EXPECT_EQ(*bytes, "packed");
  EXPECT_TRUE(absl::IsInvalidArgument(FindSequence(folder / "clips/hands.txt").status()));
}

// A hostile list must not make the client send files from elsewhere.
TEST(FindSequence, RefusesToLeaveTheFolder) {
  for (const char* name : {"../secret", "/etc/passwd", "rgb/../../secret"}) {
    const TemporaryFolder folder;
    WriteRecording(folder);
    folder.Write("depth.txt", std::string("0.0 ") + name + "\n");
    const auto sequence = FindSequence(folder.path());
    EXPECT_TRUE(absl::IsInvalidArgument(sequence.status())) << name;
    EXPECT_THAT(std::string(sequence.status().message()), HasSubstr(name));
  }
}

// What protobuf cannot carry as text must not be tried: in a list it is an error, in the folder's name it is escaped.
TEST(FindSequence, CopesWithNamesThatAreNoText) {
  const TemporaryFolder folder;
  folder.Write("rgb.txt", "0.0 rgb/\xFF.png\n");
  EXPECT_TRUE(absl::IsInvalidArgument(FindSequence(folder.path()).status()));

  const TemporaryFolder parent;
  for (const char* file : {"camera.json", "rgb.txt", "depth.txt"}) parent.Write(std::string("a\xFF/") + file, "");
  const auto sequence = FindSequence(parent / "a\xFF");
  ASSERT_TRUE(sequence.ok()) << sequence.status();
  EXPECT_EQ(sequence->display_name, "a\\xff");
}

// The same folder hashed twice is the same recording; one changed byte makes another.
TEST(HashFiles, FingerprintFollowsTheBytes) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  const auto fingerprint = [&] {
    auto sequence = FindSequence(folder.path());
    int64_t bytes_done = 0;
    EXPECT_TRUE(HashFiles(*sequence, [&](int64_t done) { bytes_done = done; }).ok());
    EXPECT_EQ(bytes_done, sequence->size_bytes);
    return sequence->fingerprint;
  };
  const std::string before = fingerprint();
  EXPECT_EQ(before.size(), 64U);
  EXPECT_EQ(fingerprint(), before);
  folder.Write("depth/a.png", "deeq");
  EXPECT_NE(fingerprint(), before);
}

// Reading any range of the concatenation gives what concatenating in memory gives, empty files included.
TEST(ConcatenatedFiles, ReadsAnyRangeAcrossFiles) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  const auto sequence = FindSequence(folder.path());
  std::string whole;
  for (const LocalFile& file : sequence->files) whole += folder.Read(file.path);
  ConcatenatedFiles files(sequence->directory, sequence->files);
  ASSERT_EQ(files.size_bytes(), static_cast<int64_t>(whole.size()));
  for (size_t offset = 0; offset <= whole.size(); ++offset) {
    for (const size_t count : {size_t{1}, size_t{7}, whole.size()}) {
      const auto bytes = files.Read(static_cast<int64_t>(offset), static_cast<int64_t>(count));
      ASSERT_TRUE(bytes.ok()) << bytes.status();
      EXPECT_EQ(*bytes, whole.substr(offset, count));
    }
  }
}

// A file cut after it was measured must be noticed, not padded.
TEST(ConcatenatedFiles, NoticesAFileThatBecameShorter) {
  const TemporaryFolder folder;
  WriteRecording(folder);
  const auto sequence = FindSequence(folder.path());
  folder.Write("depth/a.png", "de");
  ConcatenatedFiles files(sequence->directory, sequence->files);
  const auto bytes = files.Read(0, files.size_bytes());
  EXPECT_TRUE(absl::IsAborted(bytes.status()));
  EXPECT_THAT(std::string(bytes.status().message()), HasSubstr("depth/a.png"));
}

}  // namespace
}  // namespace depthtween::client
