// Names of calls: which of a client's are taken over follows from the rules in the header and from W3C Trace Context,
// whose own example is used.
#include "server/telemetry/request_id.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

namespace depthtween::server {
namespace {

using testing::MatchesRegex;

constexpr char kExample[] = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";

TEST(RequestId, TakesWhatIsHarmlessAndMakesTheRest) {
  EXPECT_EQ(ChooseRequestId("7d9-A.b_c"), "7d9-A.b_c");
  std::set<std::string> made;
  for (const std::string& unwanted :
       {std::string(), std::string(65, 'a'), std::string("a b"), std::string("a\n"), std::string("\xc3\xa4")}) {
    const std::string id = ChooseRequestId(unwanted);
    EXPECT_EQ(id.size(), 16U);
    EXPECT_NE(id, unwanted);
    made.insert(id);
  }
  EXPECT_EQ(made.size(), 5U);
}

TEST(Trace, IsContinued) {
  const std::string next = ContinueTrace(kExample);
  EXPECT_THAT(next, MatchesRegex("00-0af7651916cd43dd8448eb211c80319c-[0-9a-f]{16}-01"));
  EXPECT_NE(next, kExample) << "a span of our own";
  EXPECT_EQ(TraceOf(next), "0af7651916cd43dd8448eb211c80319c");
  EXPECT_NE(ContinueTrace(kExample), next);
}

TEST(Trace, BeginsWhereThereIsNone) {
  for (const char* bad : {"", "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331",
                          "01-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01",
                          "00-0AF7651916CD43DD8448EB211C80319C-b7ad6b7169203331-01",
                          "00-00000000000000000000000000000000-b7ad6b7169203331-01",
                          "00-0af7651916cd43dd8448eb211c80319c-0000000000000000-01",
                          "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-0\n"}) {
    const std::string made = ContinueTrace(bad);
    EXPECT_THAT(made, MatchesRegex("00-[0-9a-f]{32}-[0-9a-f]{16}-00"));
    EXPECT_NE(TraceOf(made), "0af7651916cd43dd8448eb211c80319c");
    EXPECT_EQ(TraceOf(ContinueTrace(made)), TraceOf(made)) << "it is well-formed itself";
  }
}

}  // namespace
}  // namespace depthtween::server
