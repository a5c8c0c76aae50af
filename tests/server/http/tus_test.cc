// Headers of tus. The truth is the protocol's text with its own examples, and sha1sum and sha256sum.
#include "server/http/tus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/escaping.h"
#include "tests/support/status_matchers.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

std::string Base64(const std::string& text) { return absl::Base64Escape(text); }

TEST(UploadMetadata, IsReadAsTheProtocolShowsIt) {
  // The example of the protocol, section "Creation".
  const auto metadata = ParseUploadMetadata("filename d29ybGRfZG9taW5hdGlvbl9wbGFuLnBkZg==,is_confidential");
  ASSERT_THAT(metadata, IsOk());
  EXPECT_THAT(*metadata, ElementsAre(Pair("filename", "world_domination_plan.pdf"), Pair("is_confidential", "")));
}

TEST(UploadMetadata, RefusesWhatIsNotPairs) {
  for (const char* bad : {"", ",", " ,a", "a b c", "a !", "a YQ==,a YQ==", "a YQ==,", "\xff \xff"}) {
    EXPECT_THAT(ParseUploadMetadata(bad), HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("Upload-Metadata")))
        << bad;
  }
}

// It is answered as a header later.
TEST(UploadMetadata, IsPrintable) {
  for (const char* bad : {"\xff", "a\tYQ==", "a YQ==,b\x7f"}) {
    EXPECT_THAT(ParseUploadMetadata(bad), HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("Upload-Metadata")));
  }
}

// The example of the protocol, section "Expiration".
TEST(TusTime, IsADateOfHttp) {
  EXPECT_EQ(TusTime(absl::FromCivil(absl::CivilSecond(2014, 6, 25, 16, 0, 0), absl::UTCTimeZone())),
            "Wed, 25 Jun 2014 16:00:00 GMT");
}

TEST(TusFile, TakesPathHashAndId) {
  const std::string hash(32, '\x1F');
  const auto file = ReadTusFile("filename " + Base64("x.png") + ",path " + Base64("rgb/1.png") + ",sha256 " +
                                Base64(absl::BytesToHexString(hash)) + ",request_id " + Base64("id") + ",filetype " +
                                Base64("image/png"));
  ASSERT_THAT(file, IsOk());
  EXPECT_EQ(file->path, "rgb/1.png");
  EXPECT_EQ(file->sha256, hash);
  EXPECT_EQ(file->request_id, "id");
  const auto raw = ReadTusFile("filename " + Base64("x.png") + ",sha256 " + Base64(hash));
  ASSERT_THAT(raw, IsOk());
  EXPECT_EQ(raw->path, "x.png");
  EXPECT_EQ(raw->sha256, hash);
  EXPECT_EQ(raw->request_id, "");
}

TEST(TusFile, SaysWhatIsMissing) {
  EXPECT_THAT(ReadTusFile(""), HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("has no \"path\"")));
  EXPECT_THAT(ReadTusFile("filetype " + Base64("image/png")),
              HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("has no \"path\"")));
  EXPECT_THAT(ReadTusFile("path " + Base64("a") + ",sha256 " + Base64("short")),
              HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("64 hexadecimal digits")));
  EXPECT_THAT(ReadTusFile("path " + Base64("a") + ",sha256 " + Base64(std::string(64, 'g'))),
              HasCode(absl::StatusCode::kInvalidArgument));
  for (const char* bad : {"\xC3\xA4", "a\nb", "\xFF"}) {
    EXPECT_THAT(ReadTusFile("path " + Base64(bad)),
                HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("printable ASCII")));
  }
}

TEST(UploadChecksum, IsThatOfTheBytes) {
  // sha1sum and sha256sum of "abc", RFC 3174 and RFC 6234.
  const auto sha1 =
      ParseUploadChecksum("sha1 " + Base64(absl::HexStringToBytes("a9993e364706816aba3e25717850c26c9cd0d89d")));
  ASSERT_THAT(sha1, IsOk());
  EXPECT_TRUE(Matches(*sha1, "abc"));
  EXPECT_FALSE(Matches(*sha1, "abd"));
  const auto sha256 = ParseUploadChecksum(
      "sha256 " + Base64(absl::HexStringToBytes("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad")));
  ASSERT_THAT(sha256, IsOk());
  EXPECT_TRUE(Matches(*sha256, "abc"));
  EXPECT_FALSE(Matches(*sha256, ""));
}

TEST(UploadChecksum, RefusesWhatItCannotCheck) {
  EXPECT_THAT(ParseUploadChecksum("md5 " + Base64(std::string(16, 'x'))),
              HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("sha1,sha256")));
  for (const std::string& bad : {std::string(), std::string("sha1"), std::string("sha1 !"), "sha1 " + Base64("short"),
                                 "sha256 " + Base64(std::string(20, 'x'))}) {
    EXPECT_THAT(ParseUploadChecksum(bad), HasStatus(absl::StatusCode::kInvalidArgument, HasSubstr("Upload-Checksum")))
        << bad;
  }
}

}  // namespace
}  // namespace depthtween::server
