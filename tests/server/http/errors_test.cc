// Errors as HTTP clients see them, against google.rpc.Code's own table of HTTP statuses and RFC 9110.
#include "server/http/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>

#include "google/rpc/error_details.pb.h"

namespace depthtween::server {
namespace {

using testing::Contains;
using testing::Pair;

std::string HeaderOf(const HttpResponse& response, std::string_view name) {
  for (const auto& [key, value] : response.headers) {
    if (SameHeader(key, name)) return value;
  }
  return "";
}

// The "HTTP Mapping" of each code in google/rpc/code.proto.
TEST(HttpErrors, StatusFollowsTheCode) {
  const std::map<int, int> table = {{0, 200},  {1, 499},  {2, 500},  {3, 400},  {4, 504},  {5, 404},
                                    {6, 409},  {7, 403},  {8, 429},  {9, 400},  {10, 409}, {11, 400},
                                    {12, 501}, {13, 500}, {14, 503}, {15, 500}, {16, 401}, {77, 500}};
  for (const auto& [code, status] : table) EXPECT_EQ(HttpStatusOf(code), status) << code;
}

// Details are spelled out: a program reads the reason and not the text.
TEST(HttpErrors, BodyIsTheStatusWithItsDetails) {
  google::rpc::Status error;
  error.set_code(8);
  error.set_message("the queue is full");
  google::rpc::QuotaFailure quota;
  quota.add_violations()->set_subject("max_queued_jobs");
  error.add_details()->PackFrom(quota);
  google::rpc::RetryInfo retry;
  retry.mutable_retry_delay()->set_seconds(29);
  retry.mutable_retry_delay()->set_nanos(1);
  error.add_details()->PackFrom(retry);
  const grpc::Status status(grpc::RESOURCE_EXHAUSTED, error.message(), error.SerializeAsString());

  const HttpResponse response = ErrorResponse(status);
  EXPECT_EQ(response.status, 429);
  EXPECT_EQ(HeaderOf(response, "content-type"), "application/json");
  EXPECT_EQ(HeaderOf(response, "retry-after"), "30");
  const auto json = nlohmann::json::parse(response.body);
  EXPECT_EQ(json["code"], 8);
  EXPECT_EQ(json["message"], "the queue is full");
  EXPECT_EQ(json["details"][0]["@type"], "type.googleapis.com/google.rpc.QuotaFailure");
  EXPECT_EQ(json["details"][0]["violations"][0]["subject"], "max_queued_jobs");
  EXPECT_EQ(json["details"][1]["retryDelay"], "29.000000001s");
}

// RFC 9110, 11.6.1: a 401 names the scheme.
TEST(HttpErrors, UnauthenticatedNamesTheScheme) {
  EXPECT_THAT(ErrorResponse(absl::UnauthenticatedError("no token")).headers,
              Contains(Pair("WWW-Authenticate", "Bearer")));
  EXPECT_EQ(HeaderOf(ErrorResponse(absl::PermissionDeniedError("no")), "WWW-Authenticate"), "");
}

TEST(HttpErrors, FieldErrorNamesTheField) {
  const auto json = nlohmann::json::parse(ErrorJson(FieldError("job.keyEvery", "= \"x\", must be an integer")));
  EXPECT_EQ(json["code"], 3);
  EXPECT_EQ(json["details"][0]["metadata"]["field"], "job.keyEvery");
  EXPECT_EQ(json["details"][1]["fieldViolations"][0]["field"], "job.keyEvery");
}

// A status that gRPC made, and texts that are no UTF-8, still make JSON.
TEST(HttpErrors, AnythingMakesJson) {
  EXPECT_EQ(nlohmann::json::parse(ErrorJson(ErrorOf(grpc::Status(grpc::UNAVAILABLE, "gone"))))["code"], 14);
  EXPECT_EQ(nlohmann::json::parse(ErrorJson(ErrorOf(absl::NotFoundError("\xff\xfe"))))["message"], "\\xff\\xfe");
  google::rpc::Status unknown;
  unknown.set_code(5);
  unknown.add_details()->set_type_url("type.googleapis.com/nobody.Knows");
  EXPECT_EQ(nlohmann::json::parse(ErrorJson(unknown))["code"], 5);
  EXPECT_EQ(ErrorResponse(405, absl::UnimplementedError("no")).status, 405);
}

}  // namespace
}  // namespace depthtween::server
