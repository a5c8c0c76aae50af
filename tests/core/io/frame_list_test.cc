// Lists of frames, written by hand and by chance (rapidcheck); what is written must be read.
#include "core/io/frame_list.h"

#include <gtest/gtest.h>
// rapidcheck needs gtest before it.
#include <rapidcheck/gtest.h>

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using namespace std::string_literals;

TEST(FrameList, ReadsTheTumLayout) {
  const FrameList list = ParseFrameList(
      "# color images\r\n"
      "# timestamp filename\n"
      "\n"
      "1305031232.193716 rgb/000000.png\r\n"
      "  1305031232.225683\trgb/with a blank.png  \n"
      "-0.5 rgb/\xc3\xbc.png");
  EXPECT_THAT(list.problems, IsEmpty());
  ASSERT_EQ(list.frames.size(), 3U);
  EXPECT_EQ(list.frames[0].time_ns, 1305031232193716000);
  EXPECT_EQ(list.frames[0].path, "rgb/000000.png");
  EXPECT_EQ(list.frames[1].path, "rgb/with a blank.png");
  EXPECT_EQ(list.frames[2].time_ns, -500000000);
  EXPECT_EQ(list.frames[2].path, "rgb/\xc3\xbc.png");
}

// Nanoseconds have nine decimals, which is what is written.
RC_GTEST_PROP(FrameList, TimeStampsRoundTripExactly, ()) {
  // +-100 years.
  const auto time_ns = *rc::gen::inRange<int64_t>(-3155760000000000000, 3155760000000000000);
  const FrameList list = ParseFrameList(FormatFrameList({{time_ns, "rgb/a.png"}}));
  RC_ASSERT(list.problems.empty());
  RC_ASSERT(list.frames.at(0).time_ns == time_ns);
  RC_ASSERT(list.frames.at(0).path == "rgb/a.png"s);
}

// Editors on Windows put it there; it is no part of the text.
TEST(FrameList, SkipsAByteOrderMark) {
  for (const char* begin : {"\xEF\xBB\xBF# timestamp filename\n", "\xEF\xBB\xBF"}) {
    const FrameList list = ParseFrameList(std::string(begin) + "0.5 a.png\n");
    EXPECT_THAT(list.problems, IsEmpty());
    ASSERT_EQ(list.frames.size(), 1U);
    EXPECT_EQ(list.frames[0].time_ns, 500000000);
  }
  EXPECT_THAT(ParseFrameList("\xFF\xFE#\0"s).problems,
              ElementsAre(HasStatus(StatusCode::kInvalidArgument, HasSubstr("UTF-16"))));
}

// 30 frames a second, in each unit.
TEST(FrameList, KnowsTheUnitOfStamps) {
  const std::pair<std::string, TimeUnit> lists[] = {{"12.0 a\n12.033333333 b\n", TimeUnit::kSeconds},
                                                    {"12000 a\n12033.333333 b\n", TimeUnit::kMilliseconds},
                                                    {"12000000 a\n12033333.333 b\n", TimeUnit::kMicroseconds},
                                                    {"12000000000 a\n12033333333 b\n", TimeUnit::kNanoseconds}};
  for (const auto& [text, unit] : lists) {
    const FrameList list = ParseFrameList(text);
    EXPECT_THAT(list.problems, IsEmpty());
    ASSERT_EQ(list.frames.size(), 2U);
    EXPECT_EQ(list.unit, unit);
    EXPECT_FALSE(list.unit_is_said);
    EXPECT_EQ(list.frames[0].time_ns, 12000000000);
    EXPECT_EQ(list.frames[1].time_ns, 12033333333);
  }
}

// What the list says counts, also against what its stamps look like; what is written reads back whatever the rate.
TEST(FrameList, BelievesTheUnitThatIsSaid) {
  const FrameList slow = ParseFrameList("#unit: s\n0 a\n60 b\n");
  EXPECT_THAT(slow.problems, IsEmpty());
  EXPECT_TRUE(slow.unit_is_said);
  EXPECT_EQ(slow.frames.at(1).time_ns, 60000000000);
  const FrameList again = ParseFrameList(FormatFrameList(slow.frames));
  EXPECT_THAT(again.problems, IsEmpty());
  EXPECT_EQ(again.frames.at(1).time_ns, 60000000000);
  EXPECT_EQ(ParseFrameList("# unit: us\n0 a\n5 b\n").frames.at(1).time_ns, 5000);
  EXPECT_THAT(ParseFrameList("# unit: fortnights\n0 a\n").problems,
              ElementsAre(HasStatus(StatusCode::kInvalidArgument, AllOf(HasSubstr("line 1"), HasSubstr("s, ms, us")))));
  EXPECT_THAT(ParseFrameList("# unit: s\n9300000000000 a\n").problems,
              ElementsAre(HasStatus(StatusCode::kInvalidArgument, HasSubstr("292 years"))));
  EXPECT_THAT(ParseFrameList("1305031232 a\n1305031265 b\n").problems,
              ElementsAre(HasStatus(StatusCode::kInvalidArgument, HasSubstr("# unit: "))));
}

TEST(FrameList, NamesEveryBadLine) {
  const FrameList list = ParseFrameList(
      "0.0 a.png\n"
      "0.1\n"
      "noon b.png\n"
      "nan c.png\n"
      "0.2 a.png\n"
      "0.3 folder/a.jpg\n"
      "0.4 ../outside.png\n"
      "0.5 \xff.png\n"
      "99999999999999999999 d.png\n"
      "0.6 e.png\n");
  ASSERT_EQ(list.frames.size(), 2U);
  EXPECT_EQ(list.frames[1].path, "e.png");
  const auto invalid = [](const auto& message) { return HasStatus(StatusCode::kInvalidArgument, message); };
  EXPECT_THAT(list.problems,
              ElementsAre(invalid(AllOf(HasSubstr("line 2"), HasSubstr("file name is missing"))),
                          invalid(AllOf(HasSubstr("line 3"), HasSubstr("'noon' is not a time stamp"))),
                          invalid(AllOf(HasSubstr("line 4"), HasSubstr("'nan'"))),
                          invalid(AllOf(HasSubstr("line 5"), HasSubstr("a.png is listed on line 1 already"))),
                          invalid(AllOf(HasSubstr("line 6"), HasSubstr("folder/a.jpg"), HasSubstr("line 1"))),
                          invalid(AllOf(HasSubstr("line 7"), HasSubstr("'../outside.png'"))),
                          invalid(AllOf(HasSubstr("line 8"), HasSubstr("UTF-8"))), invalid(HasSubstr("line 9"))));
}

TEST(FrameList, NamesStayInsideTheFolder) {
  for (const char* good : {"a.png", "rgb/a.png", "rgb/..a.png", "...", "rgb/\xe2\x82\xac.png", "a b"})
    EXPECT_THAT(CheckFrameName(good), IsOk()) << good;
  for (const std::string& bad :
       {""s, "/etc/passwd"s, ".."s, "../a"s, "a/../../b"s, "a/.."s, "./a"s, "a//b"s, "a/"s, "a\\b"s, "a\0b"s, "a\nb"s,
        "\x7f"s, "\xc0\xaf"s, "\xed\xa0\x80"s, "\xf4\x90\x80\x80"s, "\xe2\x82"s, std::string(1025, 'a')})
    EXPECT_THAT(CheckFrameName(bad), HasStatus(StatusCode::kInvalidArgument, HasSubstr("file name"))) << bad;
}

TEST(FrameList, StopsAtTheLimit) {
  std::string text;
  for (int i = 0; i < kMaxListedFrames + 5; ++i) absl::StrAppend(&text, i, " ", i, ".png\n");
  const FrameList list = ParseFrameList(text);
  EXPECT_EQ(list.frames.size(), static_cast<size_t>(kMaxListedFrames));
  EXPECT_THAT(list.problems, ElementsAre(HasStatus(StatusCode::kResourceExhausted, HasSubstr("100000"))));
}

}  // namespace
}  // namespace depthtween
