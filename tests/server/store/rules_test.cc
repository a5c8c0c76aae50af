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
       {"rgb.txt", "rgb/1305031102.175304.png", "gt/flow_key/fwd_0_8.png", "a/b/c/d/e", "A b+c-d_e.f"}) {
    EXPECT_THAT(CheckRelativePath(path), IsOk()) << path;
  }
  EXPECT_THAT(CheckRelativePath(std::string(255, 'x')), IsOk());
}

TEST(PathRules, RefuseWhatCouldDoHarm) {
  using namespace std::string_literals;
  for (const std::string& path :
       {""s,      "/etc/passwd"s, ".."s,       "../x"s,        "a/../b"s, "a/.."s, "."s,
        "a/./b"s, "a//b"s,        "a/"s,       ".hidden"s,     "a/.git"s, "a\0b"s, "a\\b"s,
        "a\nb"s,  "C:x"s,         "\xC3\xA4"s, "a/b/c/d/e/f"s, "~"s,      "a*"s,   std::string(256, 'x')}) {
    EXPECT_THAT(CheckRelativePath(path), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << path;
  }
  // The message can be printed whatever the path holds.
  EXPECT_THAT(std::string(CheckRelativePath("a\x1B[2J").message()), HasSubstr("\\033[2J"));
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
