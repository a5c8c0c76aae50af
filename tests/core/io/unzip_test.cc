// Archives, good and hostile, built here byte by byte from PKWARE's APPNOTE, so that any field can be a lie. What must
// come out are the bytes that went in.
#include "core/io/unzip.h"

#include <sys/stat.h>

#include <map>
#include <optional>
#include <vector>

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;
using testing::SizeIs;

template <typename T>
void AppendRaw(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string DeflatedRaw(const std::string& bytes) {
  z_stream stream = {};
  EXPECT_EQ(deflateInit2(&stream, 6, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY), Z_OK);
  std::string packed(deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return packed;
}

// One entry; what is set overrides what would be true.
struct Zipped {
  std::string name, bytes;
  bool deflate = true;
  uint16_t flags = 0;
  std::optional<uint16_t> method;
  std::optional<uint32_t> mode, crc32, size, local_offset;
  std::optional<std::string> packed;
};

// An archive of these. With `wide`, sizes and offsets stand in zip64 fields.
std::string Archive(const std::vector<Zipped>& entries, bool wide = false, const std::string& comment = "") {
  constexpr uint32_t kSaturated = 0xffffffff;
  std::string archive, directory;
  for (const Zipped& entry : entries) {
    const std::string packed = entry.packed.value_or(entry.deflate ? DeflatedRaw(entry.bytes) : entry.bytes);
    const uint16_t method = entry.method.value_or(entry.deflate ? 8 : 0);
    const auto crc =
        entry.crc32.value_or(::crc32_z(0, reinterpret_cast<const Bytef*>(entry.bytes.data()), entry.bytes.size()));
    const auto size = entry.size.value_or(entry.bytes.size());
    const auto offset = entry.local_offset.value_or(archive.size());
    AppendRaw<uint32_t>(archive, 0x04034b50);
    for (const uint16_t field : {uint16_t{20}, entry.flags, method, uint16_t{0}, uint16_t{0x21}})
      AppendRaw(archive, field);
    for (const auto field : {crc, static_cast<uint32_t>(packed.size()), size}) AppendRaw<uint32_t>(archive, field);
    AppendRaw<uint16_t>(archive, entry.name.size());
    AppendRaw<uint16_t>(archive, 3);  // an extra field that the directory does not have
    archive += entry.name + "xyz" + packed;

    std::string extra;
    if (wide) {
      AppendRaw<uint16_t>(extra, 0x5455);  // a field of something else comes first
      AppendRaw<uint16_t>(extra, 1);
      extra += 't';
      AppendRaw<uint16_t>(extra, 1);
      AppendRaw<uint16_t>(extra, 24);
      for (const uint64_t field : {uint64_t{size}, uint64_t{packed.size()}, uint64_t{offset}}) AppendRaw(extra, field);
    }
    AppendRaw<uint32_t>(directory, 0x02014b50);
    AppendRaw<uint16_t>(directory, 3 << 8 | 20);  // made on Unix
    for (const uint16_t field : {uint16_t{20}, entry.flags, method, uint16_t{0}, uint16_t{0x21}}) {
      AppendRaw(directory, field);
    }
    AppendRaw<uint32_t>(directory, crc);
    AppendRaw<uint32_t>(directory, wide ? kSaturated : packed.size());
    AppendRaw<uint32_t>(directory, wide ? kSaturated : size);
    AppendRaw<uint16_t>(directory, entry.name.size());
    AppendRaw<uint16_t>(directory, extra.size());
    for (int i = 0; i < 3; ++i) AppendRaw<uint16_t>(directory, 0);
    AppendRaw<uint32_t>(directory, entry.mode.value_or(S_IFREG | 0644) << 16);
    AppendRaw<uint32_t>(directory, wide ? kSaturated : offset);
    directory += entry.name + extra;
  }
  const size_t directory_offset = archive.size();
  archive += directory;
  if (wide) {
    const size_t end64 = archive.size();
    AppendRaw<uint32_t>(archive, 0x06064b50);
    AppendRaw<uint64_t>(archive, 44);
    AppendRaw<uint32_t>(archive, 0);
    AppendRaw<uint64_t>(archive, 0);
    for (const uint64_t field : {entries.size(), entries.size(), directory.size(), directory_offset}) {
      AppendRaw(archive, field);
    }
    AppendRaw<uint32_t>(archive, 0x07064b50);
    AppendRaw<uint32_t>(archive, 0);
    AppendRaw<uint64_t>(archive, end64);
    AppendRaw<uint32_t>(archive, 1);
  }
  AppendRaw<uint32_t>(archive, 0x06054b50);
  AppendRaw<uint32_t>(archive, 0);
  for (int i = 0; i < 2; ++i) AppendRaw<uint16_t>(archive, wide ? 0xffff : entries.size());
  AppendRaw<uint32_t>(archive, wide ? kSaturated : directory.size());
  AppendRaw<uint32_t>(archive, wide ? kSaturated : directory_offset);
  AppendRaw<uint16_t>(archive, comment.size());
  return archive + comment;
}

class UnzipTest : public testing::Test {
 protected:
  absl::StatusOr<UnzipSummary> Run(const std::string& archive, const UnzipLimits& limits = {},
                                   const std::stop_token& stop = {}) {
    // A folder of its own for each, beside which nothing may appear.
    root_ = folder_ / std::to_string(++runs_);
    Put(root_ + "/clip.zip", archive);
    std::filesystem::create_directories(root_ + "/out");
    return Unzip(root_ + "/clip.zip", root_ + "/out", limits, stop, nullptr);
  }
  // What is in the folder, by path.
  std::map<std::string, std::string> Files() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root_ + "/out")) {
      if (entry.is_regular_file()) files[entry.path().lexically_relative(root_ + "/out")] = Get(entry.path());
    }
    return files;
  }
  // The one violation of an archive; nothing may be outside of the folder.
  FileViolation Violation(const std::string& archive, const UnzipLimits& limits = {}) {
    const absl::StatusOr<UnzipSummary> summary = Run(archive, limits);
    EXPECT_THAT(summary, IsOk());
    if (!summary.ok()) return {};
    EXPECT_THAT(summary->violations, SizeIs(1));
    const auto beside = std::filesystem::directory_iterator(root_);
    EXPECT_EQ(std::distance(begin(beside), end(beside)), 2) << "only the archive and the folder";
    return summary->violations.empty() ? FileViolation() : summary->violations.front();
  }

  const TemporaryFolder folder_;
  std::string root_;
  int runs_ = 0;
};

TEST_F(UnzipTest, WritesWhatWasPacked) {
  std::string noise;
  uint32_t seed = 7;
  for (int i = 0; i < 1'000'000; ++i) noise += static_cast<char>((seed = seed * 1664525U + 1013904223U) >> 24);
  const std::string zeros(3'000'000, '\0');
  const std::vector<Zipped> entries = {{.name = "rgb.txt", .bytes = "0 rgb/0.png\n"},
                                       {.name = "rgb/", .bytes = "", .deflate = false, .mode = S_IFDIR | 0755},
                                       {.name = "rgb/0.png", .bytes = noise, .deflate = false},
                                       {.name = "rgb/1.png", .bytes = noise},
                                       {.name = "zeros", .bytes = zeros},
                                       {.name = "a/b/c/empty", .bytes = ""},
                                       {.name = "stored_empty", .bytes = "", .deflate = false}};
  for (const bool wide : {false, true}) {
    for (const std::string& comment : {std::string(), std::string(65535, 'c')}) {
      const absl::StatusOr<UnzipSummary> summary = Run(Archive(entries, wide, comment));
      ASSERT_THAT(summary, IsOk());
      EXPECT_THAT(summary->violations, IsEmpty());
      EXPECT_EQ(summary->files, 6);
      EXPECT_EQ(summary->bytes, 12 + 2'000'000 + 3'000'000);
      EXPECT_THAT(Files(),
                  ElementsAre(Pair("a/b/c/empty", ""), Pair("rgb.txt", "0 rgb/0.png\n"), Pair("rgb/0.png", noise),
                              Pair("rgb/1.png", noise), Pair("stored_empty", ""), Pair("zeros", zeros)));
    }
  }
}

TEST_F(UnzipTest, LeavesOutTheFolderOnTopAndWhatSystemsAdd) {
  EXPECT_THAT(Run(Archive({{.name = "clip/rgb.txt", .bytes = "r"},
                           {.name = "clip/clip/x", .bytes = "x"},
                           {.name = "__MACOSX/clip/._rgb.txt", .bytes = "mac"},
                           {.name = "clip/.DS_Store", .bytes = "mac"},
                           {.name = "clip/._rgb.txt", .bytes = "mac"},
                           {.name = "clip/Thumbs.db", .bytes = "win"},
                           {.name = "clip/desktop.ini", .bytes = "win"}})),
              IsOk());
  EXPECT_THAT(Files(), ElementsAre(Pair("clip/x", "x"), Pair("rgb.txt", "r"))) << "one folder, once";
  EXPECT_THAT(Run(Archive({{.name = "clip/rgb.txt", .bytes = "r"}, {.name = "clips", .bytes = "x"}})), IsOk());
  EXPECT_THAT(Files(), ElementsAre(Pair("clip/rgb.txt", "r"), Pair("clips", "x"))) << "not of all";
}

TEST_F(UnzipTest, NothingLeavesTheFolder) {
  for (const char* name : {"../evil", "a/../../evil", "/tmp/evil", "C:/evil", "a\\..\\..\\evil", "a//b", "./a", "a/.",
                           "..", "a\nb", "a\x7f"}) {
    const FileViolation violation = Violation(Archive({{.name = name, .bytes = "x"}}));
    EXPECT_THAT(violation.status, HasCode(StatusCode::kInvalidArgument)) << name;
    EXPECT_THAT(violation.file, HasSubstr(std::string(name).substr(0, 1))) << "it is named";
  }
  EXPECT_THAT(Violation(Archive({{.name = std::string("a\0b", 3), .bytes = "x"}})).status,
              HasCode(StatusCode::kInvalidArgument));
  EXPECT_THAT(Violation(Archive({{.name = std::string(2049, 'a'), .bytes = "x"}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("longer than 2048")));
  EXPECT_THAT(Violation(Archive({{.name = std::string(256, 'a'), .bytes = "x"}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("longer than 255")));
  std::string deep;
  for (int i = 0; i < 17; ++i) deep += "d/";
  EXPECT_THAT(Violation(Archive({{.name = deep + "a", .bytes = "x"}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("deeper than 16")));
}

TEST_F(UnzipTest, TakesFilesAlone) {
  const FileViolation link = Violation(Archive({{.name = "l", .bytes = "/etc/passwd", .mode = S_IFLNK | 0777}}));
  EXPECT_EQ(link.file, "l");
  EXPECT_THAT(link.status, HasStatus(StatusCode::kInvalidArgument, HasSubstr("symbolic link")));
  EXPECT_THAT(Violation(Archive({{.name = "p", .bytes = "", .mode = S_IFIFO | 0644}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("not a file")));
  // Modes are not taken over: no program, nothing that others may write.
  EXPECT_THAT(Run(Archive({{.name = "x", .bytes = "x", .mode = S_IFREG | 06777}})), IsOk());
  struct stat information = {};
  ASSERT_EQ(stat((root_ + "/out/x").c_str(), &information), 0);
  EXPECT_EQ(information.st_mode & 07133, 0U);
}

TEST_F(UnzipTest, TakesWhatItCanRead) {
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "x", .flags = 1}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("encrypted")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "x", .method = 14}})).status,
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("method 14")));
}

TEST_F(UnzipTest, NoTwoNamesAreOne) {
  EXPECT_EQ(Violation(Archive({{.name = "a", .bytes = "1"}, {.name = "a", .bytes = "2"}})).file, "a");
  EXPECT_EQ(Violation(Archive({{.name = "a/x", .bytes = "1"}, {.name = "a/X", .bytes = "2"}, {.name = "b"}})).file,
            "a/X");
  EXPECT_EQ(Violation(Archive({{.name = "a/x", .bytes = "1"}, {.name = "A/y", .bytes = "2"}})).file, "A/y");
  EXPECT_EQ(Violation(Archive({{.name = "b/x", .bytes = "1"}, {.name = "b", .bytes = "2"}})).file, "b");
  EXPECT_EQ(Violation(Archive({{.name = "B", .bytes = "1"}, {.name = "b/x", .bytes = "2"}})).file, "B");
}

// Bombs: what they say is bounded before anything is written, what comes out by what they say.
TEST_F(UnzipTest, ABombEndsAtTheFirstLimit) {
  const std::string zeros(1 << 20, '\0');
  const std::string honest = Archive({{.name = "a", .bytes = zeros}, {.name = "b", .bytes = zeros}});
  const FileViolation much = Violation(honest, {.max_bytes = (2 << 20) - 1});
  EXPECT_EQ(much.file, "clip.zip");
  EXPECT_THAT(much.status, HasCode(StatusCode::kResourceExhausted));
  EXPECT_THAT(Files(), IsEmpty());
  EXPECT_TRUE(Run(honest, {.max_bytes = 2 << 20})->ok());
  // It says a byte, and has a megabyte.
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = zeros, .size = 1}}), {.max_bytes = 100}).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("longer than")));
  EXPECT_LE(Files()["a"].size(), 1U);
  // Many entries that are all the same bytes of the file.
  std::vector<Zipped> overlapping(50, {.bytes = zeros, .local_offset = 0});
  for (size_t i = 0; i < overlapping.size(); ++i) overlapping[i].name = "f" + std::to_string(i);
  EXPECT_THAT(Violation(Archive(overlapping), {.max_bytes = 10 << 20}).status, HasCode(StatusCode::kResourceExhausted));
  // A sum that overflows 64 bits: sizes of zip64, of which each alone would be refused.
  std::string huge = Archive({{.name = "aaaa", .bytes = "x"}}, /*wide=*/true);
  std::string field;
  AppendRaw<uint16_t>(field, 1);
  AppendRaw<uint16_t>(field, 24);
  huge.replace(huge.find(field) + field.size(), 8, std::string(8, '\xff'));
  EXPECT_THAT(Violation(huge).status, HasCode(StatusCode::kResourceExhausted));
}

TEST_F(UnzipTest, CountsFiles) {
  std::vector<Zipped> entries;
  for (int i = 0; i < 6; ++i) entries.push_back({.name = std::to_string(i), .bytes = "x"});
  EXPECT_TRUE(Run(Archive(entries), {.max_files = 6})->ok());
  EXPECT_THAT(Violation(Archive(entries), {.max_files = 5}).status, HasCode(StatusCode::kResourceExhausted));
  // Before any is looked at, if there are far too many.
  entries.assign(1100, {.name = "__MACOSX/a"});
  EXPECT_THAT(Violation(Archive(entries), {.max_files = 5}).status,
              HasStatus(StatusCode::kResourceExhausted, HasSubstr("1100 entries")));
}

TEST_F(UnzipTest, DamageIsNamed) {
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .crc32 = 1}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("CRC-32")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .size = 4}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("shorter")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .deflate = false, .size = 4}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("sizes")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .packed = "\xff\xff\xff"}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("inflated")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .packed = DeflatedRaw("abc") + "more"}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("follows")));
  EXPECT_THAT(
      Violation(Archive({{.name = "a", .bytes = "abc", .local_offset = 5}, {.name = "b", .bytes = "more"}})).status,
      HasStatus(StatusCode::kDataLoss, HasSubstr("where the directory says")));
  EXPECT_THAT(Violation(Archive({{.name = "a", .bytes = "abc", .local_offset = 0x7fffffff}})).status,
              HasStatus(StatusCode::kDataLoss, HasSubstr("sizes")));
}

TEST_F(UnzipTest, WhatIsNoArchiveIsSaid) {
  const std::string good = Archive({{.name = "a", .bytes = "abc"}, {.name = "b", .bytes = "x"}});
  for (const std::string& bad : {std::string(), std::string("PK"), std::string(100, 'x'),
                                 good.substr(0, good.size() - 1), good + "x", Archive({})}) {
    const FileViolation violation = Violation(bad);
    EXPECT_EQ(violation.file, "clip.zip");
    EXPECT_THAT(violation.status, HasCode(StatusCode::kInvalidArgument));
  }
  // Whatever is cut or flipped: an answer, and nothing beside the folder.
  for (const bool wide : {false, true}) {
    const std::string whole = Archive({{.name = "a", .bytes = "abc"}, {.name = "b/c", .bytes = "x"}}, wide);
    for (size_t i = 0; i < whole.size(); ++i) {
      constexpr int kFlips[] = {0x01, 0x80, 0xff};
      std::string flipped = whole;
      flipped[i] = static_cast<char>(flipped[i] ^ kFlips[i % 3]);
      const absl::StatusOr<UnzipSummary> summary = Run(flipped, {.max_files = 10, .max_bytes = 1000});
      ASSERT_THAT(summary, IsOk()) << i;
      ASSERT_EQ(std::distance(std::filesystem::directory_iterator(root_), std::filesystem::directory_iterator()), 2);
    }
  }
}

TEST_F(UnzipTest, StopsWhenTold) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THAT(Run(Archive({{.name = "a", .bytes = "abc"}}), {}, stop.get_token()), HasCode(StatusCode::kCancelled));
}

TEST_F(UnzipTest, FailsWhereItCannotWrite) {
  Put(folder_ / "clip.zip", Archive({{.name = "a", .bytes = "abc"}}));
  EXPECT_THAT(Unzip(folder_ / "none.zip", folder_.path(), {}, {}, nullptr), HasCode(StatusCode::kNotFound));
  Put(folder_ / "a", "there already");
  EXPECT_THAT(Unzip(folder_ / "clip.zip", folder_.path(), {}, {}, nullptr), HasCode(StatusCode::kAlreadyExists));
  EXPECT_EQ(Get(folder_ / "a"), "there already");
}

}  // namespace
}  // namespace depthtween
