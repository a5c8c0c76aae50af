// Zip archives. The truth is Python's zipfile, which reads what we wrote and checks every CRC-32. Archives beyond 4 GiB
// are sparse files whose large members are zeros.
#include "server/http/zip_index.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

// What a command prints.
std::string OutputOf(const std::string& command) {
  FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  std::string text;
  char buffer[4096];
  for (size_t count = 0; (count = fread(buffer, 1, sizeof(buffer), pipe)) > 0;) text.append(buffer, count);
  return text + "exit " + std::to_string(pclose(pipe));
}

std::string Archive(const std::vector<std::pair<std::string, std::string>>& files) {
  std::string bytes;
  ZipIndex index;
  for (const auto& [name, content] : files) {
    const uint32_t crc = ExtendZipCrc32(0, content);
    bytes += ZipIndex::LocalHeader(name, static_cast<int64_t>(content.size())) + content +
             ZipIndex::Descriptor(static_cast<int64_t>(content.size()), crc);
    index.Add(name, static_cast<int64_t>(content.size()), crc);
    EXPECT_EQ(index.directory_offset(), static_cast<int64_t>(bytes.size()));
  }
  for (const ZipIndex::Entry& entry : index.entries()) bytes += index.CentralHeader(entry);
  bytes += index.End();
  EXPECT_EQ(index.size_bytes(), static_cast<int64_t>(bytes.size()));
  return bytes;
}

class ZipTest : public testing::Test {
 protected:
  std::string Write(const std::string& bytes) {
    std::ofstream(folder_ / "a.zip", std::ios::binary) << bytes;
    return folder_ / "a.zip";
  }
  // Tests all members, then runs `statement` with the archive as z.
  static std::string Python(const std::string& archive, const std::string& statement) {
    return OutputOf(
        "python3 -c 'import sys, zipfile; z = zipfile.ZipFile(sys.argv[1]); print(\"damaged:\", z.testzip()); " +
        statement + "' " + archive);
  }
  TemporaryFolder folder_;
};

TEST(ZipCrc32, IsThatOfIeee8023) {
  EXPECT_EQ(ExtendZipCrc32(0, "123456789"), 0xCBF43926U);
  EXPECT_EQ(ExtendZipCrc32(ExtendZipCrc32(0, "1234"), "56789"), 0xCBF43926U);
  EXPECT_EQ(ExtendZipCrc32(0, ""), 0U);
}

TEST_F(ZipTest, PythonReadsWhatIsWritten) {
  const std::string path =
      Write(Archive({{"depth/0.png", "one"}, {"depth/1.png", ""}, {"b", std::string(70'000, 'x')}}));
  const std::string read = Python(path, "print(z.namelist(), z.read(\"depth/0.png\"), len(z.read(\"b\")))");
  EXPECT_THAT(read, HasSubstr("damaged: None"));
  EXPECT_THAT(read, HasSubstr("['depth/0.png', 'depth/1.png', 'b'] b'one' 70000"));
  EXPECT_THAT(read, HasSubstr("exit 0"));
}

TEST_F(ZipTest, MayBeEmpty) { EXPECT_THAT(Python(Write(Archive({})), "print(z.namelist())"), HasSubstr("[]\nexit 0")); }

TEST_F(ZipTest, DamageIsSeen) {
  std::string bytes = Archive({{"a", "hello"}});
  bytes[bytes.find("hello")] ^= 1;
  EXPECT_THAT(Python(Write(bytes), ""), HasSubstr("damaged: a"));
}

// 65,535 is what a 16-bit field says when the count stands in the zip64 record.
TEST_F(ZipTest, HoldsMoreThan65535Files) {
  for (const int count : {65'534, 65'535, 70'000}) {
    std::vector<std::pair<std::string, std::string>> files;
    for (int i = 0; i < count; ++i) files.emplace_back(std::to_string(i), "");
    const std::string read = Python(Write(Archive(files)), "print(len(z.namelist()), \"files\", z.namelist()[-1])");
    EXPECT_THAT(read, HasSubstr("damaged: None"));
    EXPECT_THAT(read, HasSubstr(std::to_string(count) + " files " + std::to_string(count - 1)));
  }
}

// The large members are holes of a sparse file, and only the small ones are read: their offsets lie beyond 4 GiB.
TEST_F(ZipTest, GoesBeyond4GiB) {
  const std::string path = folder_ / "large.zip";
  const int file = open(path.c_str(), O_WRONLY | O_CREAT, 0600);
  ASSERT_GE(file, 0);
  int64_t at = 0;
  const auto put = [&](const std::string& bytes) {
    ASSERT_EQ(pwrite(file, bytes.data(), bytes.size(), at), static_cast<ssize_t>(bytes.size()));
    at += static_cast<int64_t>(bytes.size());
  };
  ZipIndex index;
  const int64_t sizes[] = {5, 0xFFFFFFFE, 7, 0xFFFFFFFF, 0x1'2345'6789, 9};
  for (const int64_t size : sizes) {
    const std::string name = std::to_string(size);
    const std::string content(size < 100 ? size : 0, 'x');
    const uint32_t crc = ExtendZipCrc32(0, content);
    put(ZipIndex::LocalHeader(name, size) + content);
    if (content.empty()) at += size;
    put(ZipIndex::Descriptor(size, crc));
    index.Add(name, size, crc);
    ASSERT_EQ(index.directory_offset(), at);
  }
  for (const ZipIndex::Entry& entry : index.entries()) put(index.CentralHeader(entry));
  put(index.End());
  close(file);
  EXPECT_EQ(index.size_bytes(), at);
  const std::string read = OutputOf(
      "python3 -c 'import sys, zipfile; z = zipfile.ZipFile(sys.argv[1]); "
      "print([i.file_size for i in z.infolist()]); print(z.read(\"5\"), z.read(\"7\"), z.read(\"9\"))' " +
      path);
  EXPECT_THAT(read, HasSubstr("[5, 4294967294, 7, 4294967295, 4886718345, 9]"));
  EXPECT_THAT(read, HasSubstr("b'xxxxx' b'xxxxxxx' b'xxxxxxxxx'"));
}

TEST(ZipIndex, FindsTheEntryOfAByte) {
  ZipIndex index;
  EXPECT_EQ(index.EntryAt(0), 0U);
  index.Add("a", 10, 0);
  const int64_t second = index.directory_offset();
  index.Add("b", 0, 0);
  EXPECT_EQ(index.EntryAt(0), 0U);
  EXPECT_EQ(index.EntryAt(second - 1), 0U);
  EXPECT_EQ(index.EntryAt(second), 1U);
  EXPECT_EQ(index.EntryAt(index.directory_offset() - 1), 1U);
  EXPECT_EQ(index.EntryAt(index.directory_offset()), 2U);
  EXPECT_EQ(index.EntryAt(index.size_bytes()), 2U);
}

}  // namespace
}  // namespace depthtween::server
