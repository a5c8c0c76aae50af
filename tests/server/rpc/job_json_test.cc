// A job whose fields are known, read back by another JSON library: names and forms are those of protobuf's JSON
// mapping.
#include "server/rpc/job_json.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

TEST(JobJson, IsTheJobWithoutItsWebhook) {
  JobView job;
  job.record = {.id = "0123456789abcdef",
                .display_name = "a \"name\"",
                .sequence_id = "fedcba9876543210",
                .options = R"({"method":"hold","key_every":4})",
                .state = JobState::kFailed,
                .error = absl::DataLossError("gone"),
                .create_time = absl::FromUnixSeconds(1'900'000'000),
                .start_time = absl::InfiniteFuture(),
                .end_time = absl::FromUnixMillis(1'900'000'001'500),
                .webhook = WebhookRecord{.url = "https://example.org/secret"}};
  const nlohmann::json json = nlohmann::json::parse(Take(JobJson(job)));
  EXPECT_EQ(json.at("name"), "jobs/0123456789abcdef");
  EXPECT_EQ(json.at("displayName"), "a \"name\"");
  EXPECT_EQ(json.at("sequence"), "sequences/fedcba9876543210");
  EXPECT_EQ(json.at("options").at("keyEvery"), 4);
  EXPECT_EQ(json.at("state"), "STATE_FAILED");
  EXPECT_EQ(json.at("error").at("message"), "gone");
  EXPECT_EQ(json.at("priority"), 0) << "plain fields are always there";
  EXPECT_EQ(json.at("createTime"), "2030-03-17T17:46:40Z");
  EXPECT_EQ(json.at("endTime"), "2030-03-17T17:46:41.500Z");
  EXPECT_FALSE(json.contains("startTime"));
  EXPECT_FALSE(json.contains("webhook"));
}

}  // namespace
}  // namespace depthtween::server
