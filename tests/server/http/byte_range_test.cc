// Ranges and conditions of requests. The truth is RFC 9110: its grammar and, where it gives them, its examples (14.1.2,
// 14.2, 13.1).
#include "server/http/byte_range.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace depthtween::server {
namespace {

using RangeKind = RangeChoice::Kind;

MATCHER_P2(IsPart, offset, size, "is that part") {
  *result_listener << "which is kind " << static_cast<int>(arg.kind) << ", " << arg.span.offset << " +"
                   << arg.span.size;
  return arg.kind == RangeKind::kPart && arg.span == ByteSpan{offset, size};
}
MATCHER(IsWhole, "is the whole") { return arg.kind == RangeKind::kWhole; }
MATCHER(IsUnsatisfiable, "cannot be satisfied") { return arg.kind == RangeKind::kUnsatisfiable; }

TEST(ChooseRange, TakesOneRange) {
  EXPECT_THAT(ChooseRange("bytes=0-499", 10000), IsPart(0, 500));
  EXPECT_THAT(ChooseRange("bytes=500-999", 10000), IsPart(500, 500));
  EXPECT_THAT(ChooseRange("bytes=-500", 10000), IsPart(9500, 500));
  EXPECT_THAT(ChooseRange("bytes=9500-", 10000), IsPart(9500, 500));
  EXPECT_THAT(ChooseRange("bytes=0-0", 10000), IsPart(0, 1));
  EXPECT_THAT(ChooseRange("bytes=-1", 10000), IsPart(9999, 1));
  EXPECT_THAT(ChooseRange("Bytes= 5-6 ,", 10), IsPart(5, 2));
}

TEST(ChooseRange, CutsWhatReachesBeyondTheEnd) {
  EXPECT_THAT(ChooseRange("bytes=9500-20000", 10000), IsPart(9500, 500));
  EXPECT_THAT(ChooseRange("bytes=-20000", 10000), IsPart(0, 10000));
  EXPECT_THAT(ChooseRange("bytes=1-99999999999999999999999999", 10), IsPart(1, 9));
  EXPECT_THAT(ChooseRange("bytes=-99999999999999999999999999", 10), IsPart(0, 10));
}

TEST(ChooseRange, SaysWhenNothingCanBeHad) {
  EXPECT_THAT(ChooseRange("bytes=10-", 10), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=10-20", 10), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=-0", 10), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=-5", 0), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=0-", 0), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=99999999999999999999999999-", 10), IsUnsatisfiable());
  EXPECT_THAT(ChooseRange("bytes=10-, 20-30", 10), IsUnsatisfiable());
}

// 14.2: a server may ignore Range, and must where the unit is unknown; what cannot be read is no range.
TEST(ChooseRange, AnswersAllElseWhole) {
  for (const char* range :
       {"", "bytes", "bytes=", "bytes=,", "bytes=-", "bytes=a-b", "bytes=5-4", "bytes=1", "bytes=1-2-3", "bytes=+1-2",
        "bytes=0x1-2", "bytes=1 - 2", "bytes=-1-2", "lines=1-2", "bytes 0-4/10", "bytes=0-4,x", "bytes=0-1, 4-5"}) {
    EXPECT_THAT(ChooseRange(range, 10), IsWhole()) << range;
  }
  EXPECT_THAT(ChooseRange(std::string("bytes=0-\0", 9), 10), IsWhole());
}

TEST(ContentRange, NamesFirstAndLastByte) {
  EXPECT_EQ(ContentRange({42, 1192}, 1234), "bytes 42-1233/1234");
  EXPECT_EQ(UnsatisfiedRange(1234), "bytes */1234");
}

TEST(Preconditions, CompareEntityTags) {
  const char* const etag = "\"xyzzy\"";
  const auto check = [&](std::string_view if_match, std::string_view if_none_match) {
    return CheckPreconditions(if_match, if_none_match, etag);
  };
  EXPECT_EQ(check("", ""), Precondition::kHolds);
  EXPECT_EQ(check("", "\"xyzzy\""), Precondition::kNotModified);
  EXPECT_EQ(check("", "W/\"xyzzy\""), Precondition::kNotModified);
  EXPECT_EQ(check("", "\"xyzzy\", \"r2d2xxxx\", \"c3piozzzz\""), Precondition::kNotModified);
  EXPECT_EQ(check("", "\"a,\" , W/\"b\",\"xyzzy\""), Precondition::kNotModified);
  EXPECT_EQ(check("", "*"), Precondition::kNotModified);
  EXPECT_EQ(check("", "\"other\""), Precondition::kHolds);
  EXPECT_EQ(check("", "xyzzy"), Precondition::kHolds);
  EXPECT_EQ(check("", "\"xyzzy"), Precondition::kHolds);
  EXPECT_EQ(check("\"xyzzy\"", ""), Precondition::kHolds);
  EXPECT_EQ(check("*", ""), Precondition::kHolds);
  EXPECT_EQ(check("W/\"xyzzy\"", ""), Precondition::kFailed);
  EXPECT_EQ(check("\"other\"", "\"xyzzy\""), Precondition::kFailed);
}

TEST(IfRange, HoldsForExactlyThatTag) {
  EXPECT_TRUE(IfRangeHolds("", "\"a\""));
  EXPECT_TRUE(IfRangeHolds("\"a\"", "\"a\""));
  EXPECT_FALSE(IfRangeHolds("\"b\"", "\"a\""));
  EXPECT_FALSE(IfRangeHolds("W/\"a\"", "\"a\""));
  EXPECT_FALSE(IfRangeHolds("Sat, 29 Oct 1994 19:43:31 GMT", "\"a\""));
}

TEST(UploadRange, IsReadOrRefused) {
  const auto part = ParseUploadRange("bytes 2-5/10");
  ASSERT_THAT(part, IsOk());
  EXPECT_EQ(part->span, (ByteSpan{2, 4}));
  EXPECT_EQ(part->size_bytes, 10);
  const auto open = ParseUploadRange("bytes 0-0/*");
  ASSERT_THAT(open, IsOk());
  EXPECT_EQ(open->span, (ByteSpan{0, 1}));
  EXPECT_EQ(open->size_bytes, std::nullopt);
  const auto question = ParseUploadRange("bytes */0");
  ASSERT_THAT(question, IsOk());
  EXPECT_EQ(question->span, std::nullopt);
  EXPECT_EQ(question->size_bytes, 0);
  for (const char* bad : {"", "bytes", "bytes=0-1/2", "bytes 0-1", "bytes 1-0/2", "bytes 0-2/2", "bytes */*",
                          "bytes -1/2", "bytes 0-/2", "items 0-1/2", "bytes 0-9223372036854775807/*",
                          "bytes 0-1/9223372036854775808", "bytes 0-1/2/3", "bytes 0-1/ 2"}) {
    EXPECT_THAT(ParseUploadRange(bad),
                HasStatus(absl::StatusCode::kInvalidArgument, testing::HasSubstr("bytes FIRST-LAST/SIZE")))
        << bad;
  }
}

TEST(ByteCount, IsDigitsAlone) {
  EXPECT_EQ(ParseByteCount("0"), 0);
  EXPECT_EQ(ParseByteCount("9223372036854775807"), INT64_MAX);
  for (const char* bad : {"", "-1", "+1", " 1", "1 ", "1.0", "0x1", "9223372036854775808", "99999999999999999999"}) {
    EXPECT_EQ(ParseByteCount(bad), std::nullopt) << bad;
  }
}

}  // namespace
}  // namespace depthtween::server
