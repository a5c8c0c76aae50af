// The lines are read back from a pipe of our own.
#include "core/tools/progress_pipe.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace depthtween::tools {
namespace {

using nlohmann::json;

class ProgressPipeTest : public testing::Test {
 protected:
  ProgressPipeTest() { EXPECT_EQ(pipe(ends_.data()), 0); }
  ~ProgressPipeTest() override {
    close(ends_[0]);
    close(ends_[1]);
  }
  bool HasLine() {
    pollfd wait{ends_[0], POLLIN, 0};
    return poll(&wait, 1, 0) == 1;
  }
  // What is in the pipe, a value a line.
  std::vector<json> Lines() {
    std::array<char, 4096> text{};
    std::istringstream stream(std::string(text.data(), read(ends_[0], text.data(), text.size())));
    std::vector<json> lines;
    for (std::string line; std::getline(stream, line);) lines.push_back(json::parse(line));
    return lines;
  }
  std::array<int, 2> ends_{};
};

TEST_F(ProgressPipeTest, LinesAndErrorsAreJson) {
  ProgressPipe pipe(ends_[1], [] {});
  pipe.Send({{"checked", 12}, {"of", 66}});
  pipe.SendError(absl::DataLossError("cut \"short\""));
  const std::vector<json> lines = Lines();
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0], json({{"checked", 12}, {"of", 66}}));
  EXPECT_EQ(lines[1], json({{"error", {{"code", "DATA_LOSS"}, {"message", "cut \"short\""}}}}));
}

// However often it is called: at most one line for each second that has passed.
TEST_F(ProgressPipeTest, BeingAliveIsSaidOnceASecond) {
  ProgressPipe pipe(ends_[1], [] {});
  while (!HasLine()) pipe.SendAlive();
  for (int i = 0; i < 1000; ++i) pipe.SendAlive();
  const std::vector<json> lines = Lines();
  ASSERT_GE(lines.size(), 1U);
  int last = 0;
  for (const json& line : lines) {
    EXPECT_GT(line.at("alive"), last);
    last = line.at("alive");
  }
}

TEST_F(ProgressPipeTest, WithoutAPipeNothingHappens) {
  ProgressPipe pipe(-1, [] { FAIL(); });
  EXPECT_FALSE(pipe.connected());
  pipe.Send({{"checked", 1}});
  pipe.SendAlive();
  EXPECT_FALSE(HasLine());
}

}  // namespace
}  // namespace depthtween::tools
