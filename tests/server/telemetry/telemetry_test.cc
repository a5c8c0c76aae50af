// Log lines and health, written by hand.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "server/telemetry/health.h"
#include "server/telemetry/log.h"

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

TEST_F(LogTest, LongValuesAreCut) {
  const std::string text = LineOf([] { LogInfo("call", {{"why", std::string(5'000'000, 'x')}, {"job", "12"}}); });
  EXPECT_LT(text.size(), 1200U);
  EXPECT_THAT(text, testing::EndsWith("x... (5000000 bytes)\" job=12\n"));
  ConfigureLog({.json = true});
  // Two bytes a letter, the first of them at 1023.
  const std::string json = LineOf([] {
    std::string letters = "x";
    for (int i = 0; i < 1000; ++i) letters += "\xc3\xa4";
    LogInfo("call", {{"why", letters}});
  });
  const std::string why = nlohmann::json::parse(json).at("why");
  EXPECT_THAT(why, testing::EndsWith("\xc3\xa4... (2001 bytes)"));
  EXPECT_THAT(why, testing::Not(testing::HasSubstr("\xef\xbf\xbd")));
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

TEST(Health, ServesAgainWhenEveryReasonNotToIsGone) {
  Health health;
  health.Set("", true);
  health.Set("jobs", true);
  health.Hold("draining");
  health.Hold("draining");
  health.Hold("disk");
  EXPECT_EQ(health.IsServing("jobs"), false);
  health.Hold("disk", false);
  EXPECT_EQ(health.IsServing(""), false);
  health.Hold("draining", false);
  EXPECT_EQ(health.IsServing("jobs"), true);
  EXPECT_EQ(health.IsServing(""), true);
}

}  // namespace
}  // namespace depthtween::server
