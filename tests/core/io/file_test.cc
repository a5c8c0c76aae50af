// Files on disk. Known: the bytes written, and what the kernel says of full disks, pipes and names.
#include "core/io/file.h"

#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <thread>
#include <vector>

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> NamesIn(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

TEST(File, WritesWholeAndReplaces) {
  const TemporaryFolder folder;
  const std::string bytes("a\0b\n", 4);
  for (auto* write : {&WriteFile, &WriteFileDurably}) {
    ASSERT_THAT(write(folder / "x", "older and longer"), IsOk());
    ASSERT_THAT(write(folder / "x", bytes), IsOk());
    EXPECT_EQ(*ReadFile(folder / "x"), bytes);
  }
  EXPECT_THAT(NamesIn(folder.path()), ElementsAre("x"));
}

TEST(File, LongestNameThatFileSystemsAllow) {
  const TemporaryFolder folder;
  const std::string name(255, 'n');
  ASSERT_THAT(WriteFile(folder / name, "x"), IsOk());
  EXPECT_THAT(NamesIn(folder.path()), ElementsAre(name));
}

// A limit on file size stands for a full disk: the kernel refuses to write further (EFBIG beside ENOSPC).
TEST(File, FullDiskLeavesOldFileAndNoTemporary) {
  const TemporaryFolder folder;
  ASSERT_THAT(WriteFile(folder / "x", "old"), IsOk());
  struct rlimit before = {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  struct rlimit tight = before;
  tight.rlim_cur = 1000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &tight), 0);
  const absl::Status plain = WriteFile(folder / "x", std::string(5000, 'n'));
  const absl::Status durable = WriteFileDurably(folder / "x", std::string(5000, 'n'));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, handler);
  EXPECT_THAT(plain, HasStatus(StatusCode::kResourceExhausted, HasSubstr("/x")));
  EXPECT_THAT(durable, HasStatus(StatusCode::kResourceExhausted, HasSubstr("/x")));
  EXPECT_EQ(Get(folder / "x"), "old");
  EXPECT_THAT(NamesIn(folder.path()), ElementsAre("x"));
}

TEST(File, NamesWhatIsMissing) {
  const TemporaryFolder folder;
  EXPECT_THAT(ReadFile(folder / "none"), HasStatus(StatusCode::kNotFound, HasSubstr("none")));
  EXPECT_THAT(WriteFile(folder / "none/x", "x"), HasStatus(StatusCode::kNotFound, HasSubstr("none/x")));
}

// A reader that opened the pipe in the ordinary way would wait for ever.
TEST(File, RefusesPipesAndFolders) {
  const TemporaryFolder folder;
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  EXPECT_THAT(ReadFile(folder / "pipe"), HasStatus(StatusCode::kInvalidArgument, HasSubstr("not a regular file")));
  EXPECT_THAT(ReadFile(folder.path()), HasStatus(StatusCode::kInvalidArgument, HasSubstr("not a regular file")));
  EXPECT_FALSE(FileExists(folder / "pipe"));
  EXPECT_FALSE(FileExists(folder.path()));
}

TEST(File, RefusesFilesOverTheLimit) {
  const TemporaryFolder folder;
  Put(folder / "x", "12345");
  EXPECT_THAT(ReadFile(folder / "x", 5), IsOk());
  EXPECT_THAT(ReadFile(folder / "x", 4), HasStatus(StatusCode::kResourceExhausted, HasSubstr("5 bytes, at most 4")));
}

// Writers of one name meet: one of them wins whole.
TEST(File, ConcurrentWritersDoNotMix) {
  const TemporaryFolder folder;
  std::vector<std::thread> writers;
  for (const char letter : {'a', 'b', 'c'}) {
    writers.emplace_back([&folder, letter] {
      for (int i = 0; i < 20; ++i) EXPECT_THAT(WriteFile(folder / "x", std::string(3000, letter)), IsOk());
    });
  }
  for (std::thread& writer : writers) writer.join();
  const std::string bytes = Get(folder / "x");
  EXPECT_EQ(bytes, std::string(3000, bytes[0]));
  EXPECT_THAT(NamesIn(folder.path()), ElementsAre("x"));
}

TEST(File, MakesFoldersWithTheirParents) {
  const TemporaryFolder folder;
  EXPECT_THAT(MakeFolder(folder / "a/b/c"), IsOk());
  EXPECT_THAT(MakeFolder(folder / "a/b/c/"), IsOk());
  EXPECT_TRUE(std::filesystem::is_directory(folder / "a/b/c"));
  Put(folder / "file", "x");
  EXPECT_THAT(MakeFolder(folder / "file"), HasStatus(StatusCode::kAlreadyExists, HasSubstr("file")));
  EXPECT_THAT(MakeFolder(""), HasStatus(StatusCode::kInvalidArgument, HasSubstr("empty")));
}

TEST(File, JoinsWithOneSlash) {
  EXPECT_EQ(JoinPath("a", "b"), "a/b");
  EXPECT_EQ(JoinPath("a/", "b"), "a/b");
  EXPECT_EQ(JoinPath("", "b"), "b");
  EXPECT_EQ(JoinPath("/", "b"), "/b");
}

}  // namespace
}  // namespace depthtween
