// Requests of HTTP as messages, against the rules in google/api/http.proto and protobuf's JSON mapping.
#include "server/http/json_mapping.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "depthtween/v1/sequence.pb.h"
#include "google/rpc/error_details.pb.h"

namespace depthtween::server {
namespace {

// The field that an error names.
std::string FieldOf(const google::rpc::Status& error) {
  EXPECT_EQ(error.code(), 3) << error.ShortDebugString();
  for (const auto& any : error.details()) {
    if (google::rpc::BadRequest detail; any.UnpackTo(&detail)) return detail.field_violations(0).field();
  }
  return "(no field)";
}

TEST(FillRequest, BodyPathAndQuery) {
  v1::CreateJobRequest create;
  EXPECT_EQ(FillRequest({.body_field = "job",
                         .body = R"({"sequence": "sequences/1", "options": {"keyEvery": 4, "self_check": true}})",
                         .query = {{"request_id", "abc"}, {"validateOnly", "true"}, {"signature", "x"}}},
                        &create)
                .code(),
            0);
  EXPECT_EQ(create.job().sequence(), "sequences/1");
  EXPECT_EQ(create.job().options().key_every(), 4);
  EXPECT_TRUE(create.job().options().self_check());
  EXPECT_EQ(create.request_id(), "abc");
  EXPECT_TRUE(create.validate_only());

  v1::StreamFramesRequest frames;
  EXPECT_EQ(FillRequest({.path_values = {{"name", "jobs/1/outputs/depth"}},
                         .query = {{"start_frame", "3"}, {"encoding", "ENCODING_RAW"}, {"follow", "false"}}},
                        &frames)
                .code(),
            0);
  EXPECT_EQ(frames.name(), "jobs/1/outputs/depth");
  EXPECT_EQ(frames.start_frame(), 3);
  EXPECT_EQ(frames.encoding(), v1::ENCODING_RAW);

  // Paths of fields, repeated ones, enums by number, texts that need escapes.
  v1::CreateJobRequest nested;
  EXPECT_EQ(FillRequest({.query = {{"job.options.without", "a"},
                                   {"job.options.without", "b\"\\\n"},
                                   {"job.state", "2"},
                                   {"job.createTime", "2030-01-31T12:00:00Z"},
                                   {"job.options.keyEvery", "2"}}},
                        &nested)
                .code(),
            0);
  EXPECT_EQ(nested.job().options().without(1), "b\"\\\n");
  EXPECT_EQ(nested.job().state(), v1::Job::STATE_RUNNING);
  EXPECT_EQ(nested.job().create_time().seconds(), 1896091200);
  EXPECT_EQ(nested.job().options().key_every(), 2);
}

TEST(FillRequest, NamesWhatIsWrong) {
  v1::CreateJobRequest request;
  const auto body = [&request](const std::string& json) {
    request.Clear();
    return FieldOf(FillRequest({.body_field = "job", .body = json}, &request));
  };
  EXPECT_EQ(body(R"({"sequense": "x"})"), "job.sequense");
  EXPECT_EQ(body(R"({"options": {"key_evry": 1}})"), "job.options.key_evry");
  EXPECT_EQ(body(R"({"options": {"keyEvery": "many"}})"), "job.options.key_every");
  EXPECT_EQ(body("{"), "job");
  EXPECT_EQ(body("[]"), "job");

  const auto query = [&request](const std::string& name, const std::string& value) {
    request.Clear();
    return FieldOf(FillRequest({.query = {{name, value}}}, &request));
  };
  EXPECT_EQ(query("nothing", "1"), "nothing");
  EXPECT_EQ(query("job.nothing", "1"), "job.nothing");
  EXPECT_EQ(query("request_id.x", "1"), "request_id.x");
  EXPECT_EQ(query("validate_only", "maybe"), "validate_only");
  EXPECT_EQ(query("validate_only", "1"), "validate_only");
  EXPECT_EQ(query("job.state", "STATE_LOST"), "job.state");
  EXPECT_EQ(query("job.threads", "1e99"), "job.threads");
  EXPECT_EQ(query("job.threads", ""), "job.threads");
  EXPECT_EQ(query("job.threads", "1,\"x\":2"), "job.threads");  // no JSON is smuggled in
  EXPECT_EQ(query("job.progress", "{}"), "job.progress");
  EXPECT_EQ(query("", "1"), "");

  request.Clear();
  EXPECT_EQ(FieldOf(FillRequest({.body_field = "job", .body = "{}", .query = {{"job.threads", "1"}}}, &request)),
            "job.threads");
  v1::CancelJobRequest cancel;
  EXPECT_EQ(FieldOf(FillRequest({.body_field = "*", .query = {{"name", "jobs/1"}}}, &cancel)), "name");
  EXPECT_EQ(FieldOf(FillRequest(
                {.body_field = "*", .body = R"({"name": "jobs/2"})", .path_values = {{"name", "jobs/1"}}}, &cancel)),
            "name");
  v1::GetJobRequest get;
  EXPECT_EQ(FieldOf(FillRequest({.body = "{}"}, &get)), "");
}

// The parser under it calls itself for each level; nesting is bounded before.
TEST(FillRequest, BoundsDepth) {
  v1::CreateJobRequest request;
  const std::string deep = std::string(100'000, '[') + std::string(100'000, ']');
  const auto error = FillRequest({.body_field = "job", .body = deep}, &request);
  EXPECT_EQ(error.code(), 3);
  EXPECT_THAT(error.message(), testing::HasSubstr("100 levels"));
  EXPECT_EQ(JsonDepth(R"({"a": "[[[[{{{{\"[[[["})", 100), 1);  // in strings they are letters
  EXPECT_EQ(JsonDepth("[[[]],[[[[]]]]]", 100), 5);
  EXPECT_EQ(JsonDepth(deep, 100), 101);
}

TEST(PrintJson, PlainFieldsAreAlwaysThere) {
  v1::ListJobsResponse list;
  list.add_jobs()->set_state(v1::Job::STATE_QUEUED);
  const auto json = nlohmann::json::parse(*PrintJson(list));
  EXPECT_EQ(json["nextPageToken"], "");
  EXPECT_EQ(json["jobs"][0]["state"], "STATE_QUEUED");
  EXPECT_EQ(json["jobs"][0]["displayName"], "");
  EXPECT_FALSE(json["jobs"][0].contains("progress"));
}

}  // namespace
}  // namespace depthtween::server
