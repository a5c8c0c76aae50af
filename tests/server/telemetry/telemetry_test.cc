// Log lines and health, written by hand.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>

#include "server/telemetry/health.h"
#include "server/telemetry/log.h"
#include "server/telemetry/request_id.h"

namespace depthtween::server {
namespace {

class LogTest : public testing::Test {
 protected:
  ~LogTest() override { ConfigureLog({}); }

  static std::string LineOf(const std::function<void()>& log) {
    testing::internal::CaptureStderr();
    log();
    return testing::internal::GetCapturedStderr();
  }
};

// One event is one line, whatever the values hold: a log that a client can add lines to proves nothing.
TEST_F(LogTest, TextIsOneLineThatCannotBeForged) {
  const std::string line = LineOf([] { LogInfo("task_started", {{"task", "12"}, {"name", "a\nb c=\"d\""}}); });
  EXPECT_THAT(line, testing::EndsWith(" info task_started task=12 name=\"a\\nb c=\\\"d\\\"\"\n"));
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1);
}

TEST_F(LogTest, JsonIsOneObjectALine) {
  ConfigureLog({.level = LogLevel::kWarning, .json = true});
  const std::string line = LineOf([] {
    LogInfo("unseen");
    LogError("failed", {{"why", "a\nb\xff"}});
  });
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1);
  const auto object = nlohmann::json::parse(line);
  EXPECT_EQ(object.at("level"), "error");
  EXPECT_EQ(object.at("event"), "failed");
  EXPECT_EQ(object.at("why"), "a\nb\xef\xbf\xbd");  // U+FFFD for the byte that is not UTF-8
  EXPECT_EQ(object.at("time").get<std::string>().back(), 'Z');
}

TEST(Health, TellsEachServiceAndEveryChange) {
  Health health;
  EXPECT_EQ(health.IsServing("jobs"), std::nullopt);
  int changes = 0;
  auto subscription = health.Subscribe([&] { ++changes; });
  health.Set("jobs", true);
  EXPECT_EQ(health.IsServing("jobs"), true);
  health.StopServing();
  EXPECT_EQ(health.IsServing("jobs"), false);
  EXPECT_EQ(health.IsServing(""), false);
  EXPECT_EQ(changes, 2);
  subscription.reset();
  health.Set("jobs", true);
  EXPECT_EQ(changes, 2);
}

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

}  // namespace
}  // namespace depthtween::server
