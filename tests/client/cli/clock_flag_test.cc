#include "client/cli/clock_flag.h"

#include <gtest/gtest.h>

namespace depthtween::cli {
namespace {

// The forms that job.proto lists, and what is none of them; the bounds are the server's.
TEST(ClockProblem, SeesWhatTheServerWouldRefuse) {
  for (const std::string right : {"", "stamps", "index", "estimate", "4", "-2.5", "4,3000", "-3600000,-1e5"}) {
    EXPECT_EQ(ClockProblem(right), "") << right;
  }
  for (const std::string wrong :
       {"sundial", "4,", ",4", "4,5,6", "nan", "1e12", "3600001", "4,100001", "4,nan", "Stamps", "\x1b"}) {
    EXPECT_NE(ClockProblem(wrong), "") << wrong;
  }
  EXPECT_NE(ClockProblem("4" + std::string(64, ' ')), "") << "too long to be kept";
}

}  // namespace
}  // namespace depthtween::cli
