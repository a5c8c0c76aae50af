// CRC-32C of "123456789" is 0xE3069283 by RFC 3720; damage is what the test writes over a byte.
#include "server/store/checksums.h"

#include <sys/stat.h>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

constexpr auto kBlock = static_cast<size_t>(kChecksumBlockBytes);

std::string Bytes(size_t size) {
  std::string bytes(size, '\0');
  for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 31 + i / 251);
  return bytes;
}

FileChecksum Whole(std::string_view bytes) {
  BlockChecksums checksums;
  checksums.Update(bytes);
  return checksums.Finish("name");
}

TEST(Checksums, AreThoseOfTheStandard) {
  const FileChecksum checksum = Whole("123456789");
  EXPECT_EQ(checksum.blocks, std::string("\x83\x92\x06\xE3", 4));
  EXPECT_EQ(checksum.size_bytes, 9);
  EXPECT_EQ(checksum.path, "name");
  EXPECT_EQ(Whole("").blocks, "");
}

TEST(Checksums, DoNotDependOnPieces) {
  for (const size_t size : {size_t{1}, kBlock - 1, kBlock, kBlock + 1, 3 * kBlock}) {
    const std::string bytes = Bytes(size);
    BlockChecksums pieces;
    for (size_t at = 0; at < size; at += 100'003) pieces.Update(std::string_view(bytes).substr(at, 100'003));
    const FileChecksum checksum = pieces.Finish("name");
    EXPECT_EQ(checksum.blocks, Whole(bytes).blocks) << size;
    EXPECT_EQ(checksum.blocks.size(), 4 * ((size + kBlock - 1) / kBlock)) << size;
    EXPECT_TRUE(Matches(checksum, bytes)) << size;
  }
}

TEST(Checksums, EveryFlippedBitShows) {
  const std::string bytes = Bytes(kBlock + 77);
  const FileChecksum checksum = Whole(bytes);
  for (const size_t at : {size_t{0}, kBlock - 1, kBlock, kBlock + 76}) {
    for (int bit = 0; bit < 8; ++bit) {
      std::string flipped = bytes;
      flipped[at] = static_cast<char>(flipped[at] ^ (1 << bit));
      EXPECT_FALSE(Matches(checksum, flipped)) << at;
      const size_t block = at / kBlock;
      EXPECT_FALSE(BlockMatches(checksum, static_cast<int64_t>(block), flipped.substr(block * kBlock, kBlock))) << at;
      EXPECT_TRUE(
          BlockMatches(checksum, static_cast<int64_t>(1 - block), flipped.substr((1 - block) * kBlock, kBlock)));
    }
  }
  EXPECT_FALSE(Matches(checksum, bytes.substr(1)));
  EXPECT_FALSE(Matches(checksum, bytes + "x"));
  EXPECT_FALSE(BlockMatches(checksum, 1, bytes.substr(kBlock, 76)));
  EXPECT_FALSE(BlockMatches(checksum, 2, ""));
}

TEST(Checksums, OfAFile) {
  const TemporaryFolder folder;
  const std::string bytes = Bytes(2 * kBlock + 5), file = folder / "file";
  folder.Write("file", bytes);
  const FileChecksum checksum = Take(ChecksumOf(file, "name"));
  EXPECT_EQ(checksum.blocks, Whole(bytes).blocks);
  for (const bool cold : {false, true}) EXPECT_THAT(CheckFile(file, checksum, nullptr, cold), IsOk());
  int64_t seen = 0;
  EXPECT_THAT(CheckFile(file, checksum, [&seen](int64_t more) { return (seen += more) < 2 * kChecksumBlockBytes; }),
              HasCode(absl::StatusCode::kCancelled));
  EXPECT_EQ(seen, 2 * kChecksumBlockBytes);

  std::string flipped = bytes;
  flipped[kBlock + 3] = static_cast<char>(flipped[kBlock + 3] ^ 1);
  folder.Write("file", flipped);
  const absl::Status damaged = CheckFile(file, checksum);
  EXPECT_THAT(damaged, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(std::string(damaged.message()), HasSubstr("between 262144 and 524288"));
  folder.Write("file", bytes.substr(1));
  EXPECT_THAT(CheckFile(file, checksum), HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(CheckFile(folder / "none", checksum), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(ChecksumOf(folder / "none", ""), HasCode(absl::StatusCode::kNotFound));
  // Nobody waits for the other end of a pipe, or follows a link.
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink(file, folder / "link");
  for (const char* name : {"pipe", "link"}) {
    EXPECT_THAT(ChecksumOf(folder / name, ""), HasCode(absl::StatusCode::kNotFound));
    EXPECT_THAT(CheckFile(folder / name, checksum), HasCode(absl::StatusCode::kNotFound));
  }
}

}  // namespace
}  // namespace depthtween::server
