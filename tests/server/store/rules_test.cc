// Small rules: paths, checksums, hashes, error details. Expected values come from the published standards where there
// are.
#include <gtest/gtest.h>

#include "proto/depthtween/crc32c.h"
#include "proto/depthtween/sha256.h"
#include "server/store/error_info.h"
#include "server/store/path_rules.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

TEST(PathRules, AcceptWhatSequencesAreMadeOf) {
  for (const char* path :
       {"rgb.txt", "rgb/1305031102.175304.png", "gt/flow_key/fwd_0_8.png", "a/b/c/d/e", "A b+c-d_e.f",
        "rgb dir/Bild \xC3\xBC \xE6\xB7\xB1 00 (1) [x] 100% #1.png", "~", "a;b&c$d'e"}) {
    EXPECT_THAT(CheckRelativePath(path), IsOk()) << path;
  }
  EXPECT_THAT(CheckRelativePath(std::string(255, 'x')), IsOk());
}

TEST(PathRules, RefuseWhatCouldDoHarm) {
  using namespace std::string_literals;
  for (const std::string& path :
       {""s,     "/etc/passwd"s, ".."s,      "../x"s,   "a/../b"s,   "a/.."s, "."s,    "a/./b"s,
        "a//b"s, "a/"s,          ".hidden"s, "a/.git"s, "a\0b"s,     "a\\b"s, "a\nb"s, "C:x"s,
        "\xC3"s, "a/b/c/d/e/f"s, "a\x7F"s,   "a*"s,     "\xC2\x9B"s, "a?"s,   "a|b"s,  std::string(256, 'x')}) {
    EXPECT_THAT(CheckRelativePath(path), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << path;
  }
  // The message can be printed whatever the path holds.
  EXPECT_THAT(std::string(CheckRelativePath("a\x1B[2J").message()), HasSubstr("\\033[2J"));
}

// All are told at once, so that files are renamed once.
TEST(PathRules, NameEveryPathThatIsRefused) {
  EXPECT_THAT(CheckRelativePaths({"a.png", "b.png"}), IsOk());
  const absl::Status two = CheckRelativePaths({"a:1.png", "b.png", ".c.png"});
  EXPECT_THAT(two, HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(std::string(two.message()), testing::AllOf(HasSubstr("2 of 3 paths"), HasSubstr("\"a:1.png\" has one of"),
                                                         HasSubstr("\".c.png\" has a name that begins with a dot")));
  const std::vector<std::string> many(25, "a*");
  EXPECT_THAT(std::string(CheckRelativePaths({many.begin(), many.end()}).message()), HasSubstr("and 15 more"));
}

TEST(Crc32c, MatchesRfc3720) {
  EXPECT_EQ(Crc32c(std::string(32, '\0')), 0x8A9136AAU);
  EXPECT_EQ(Crc32c(std::string(32, '\xFF')), 0x62A8AB43U);
  EXPECT_EQ(Crc32c("123456789"), 0xE3069283U);
  EXPECT_EQ(Crc32c(""), 0U);
}

TEST(Crc32c, ExtendsAndAgreesWithItsDefinition) {
  std::string text;
  for (int i = 0; i < 100; ++i) {
    for (const size_t cut : {size_t{0}, text.size() / 3, text.size()}) {
      EXPECT_EQ(ExtendCrc32c(Crc32c(std::string_view(text).substr(0, cut)), std::string_view(text).substr(cut)),
                crc32c_internal::ExtendByTable(0, text));
    }
    text.push_back(static_cast<char>(i * 37));
  }
}

// FIPS 180-2, appendix B.1: the digest of "abc".
TEST(Sha256, MatchesFips180) {
  Sha256 hash;
  hash.Update("a");
  hash.Update("bc");
  EXPECT_EQ(Hex(hash.Finish()), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(ErrorInfo, TravelsWithTheStatus) {
  EXPECT_FALSE(GetErrorInfo(absl::InternalError("x")).has_value());
  const absl::Status status = WithErrorInfo(absl::DataLossError("x"), {.reason = "R", .metadata = {{"k", "v\xFF"}}});
  EXPECT_EQ(GetErrorInfo(WithContext(status, "file"))->reason, "R");
  EXPECT_EQ(GetErrorInfo(status)->metadata.count("k"), 1U);
  EXPECT_THAT(WithErrorInfo(absl::OkStatus(), {.reason = "R"}), IsOk());
}

}  // namespace
}  // namespace depthtween::server
