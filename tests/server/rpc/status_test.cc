// Errors as clients see them, against the interface's documentation.
#include "server/rpc/status.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>

#include "google/rpc/error_details.pb.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

template <typename Message>
std::optional<Message> Detail(const grpc::Status& status) {
  google::rpc::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  for (const auto& any : details.details()) {
    if (Message message; any.UnpackTo(&message)) return message;
  }
  return std::nullopt;
}

// API.md: every error has an ErrorInfo of our domain, whether the module that failed gave a reason or not.
TEST(Status, AlwaysHasErrorInfo) {
  for (int code = 1; code <= 16; ++code) {
    const absl::Status plain(static_cast<absl::StatusCode>(code), "went wrong");
    const grpc::Status status = ToGrpcStatus(plain, {.subject = "jobs/1", .request_id = "abc"});
    EXPECT_EQ(static_cast<int>(status.error_code()), code);
    EXPECT_EQ(status.error_message(), "went wrong");
    const auto info = Detail<google::rpc::ErrorInfo>(status);
    ASSERT_TRUE(info.has_value()) << code;
    EXPECT_EQ(info->domain(), "depthtween");
    EXPECT_EQ(info->reason(), absl::StatusCodeToString(plain.code()));
    EXPECT_EQ(Detail<google::rpc::RequestInfo>(status)->request_id(), "abc");
  }
}

TEST(Status, OkStaysOk) {
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_EQ(ToRpcStatus(absl::OkStatus()).ByteSizeLong(), 0U);
}

// What a program needs in order to react is in the details, not in the text: field, resource, state, limit, delay.
TEST(Status, DetailsFollowTheReason) {
  const auto field =
      Detail<google::rpc::BadRequest>(ToGrpcStatus(InvalidField("job.options.key_every", "= -1, must be >= 0")));
  ASSERT_TRUE(field.has_value());
  EXPECT_EQ(field->field_violations(0).field(), "job.options.key_every");
  EXPECT_EQ(field->field_violations(0).description(), "job.options.key_every = -1, must be >= 0");

  const auto resource = Detail<google::rpc::ResourceInfo>(ToGrpcStatus(NoSuchResource("sequences/1/uploads/2")));
  ASSERT_TRUE(resource.has_value());
  EXPECT_EQ(resource->resource_type(), "depthtween/Upload");
  EXPECT_EQ(resource->resource_name(), "sequences/1/uploads/2");

  const grpc::Status wrong_state = ToGrpcStatus(WrongState("READY", "it is READY"), {.subject = "sequences/1"});
  const auto precondition = Detail<google::rpc::PreconditionFailure>(wrong_state);
  ASSERT_TRUE(precondition.has_value());
  EXPECT_EQ(precondition->violations(0).type(), "WRONG_STATE");
  EXPECT_EQ(precondition->violations(0).subject(), "sequences/1");
  EXPECT_EQ(Detail<google::rpc::ErrorInfo>(wrong_state)->metadata().at("state"), "READY");

  const grpc::Status queue_full = ToGrpcStatus(LimitExceeded("max_queued_jobs", 1000, "the queue is full"));
  EXPECT_EQ(Detail<google::rpc::QuotaFailure>(queue_full)->violations(0).subject(), "max_queued_jobs");
  EXPECT_GT(Detail<google::rpc::RetryInfo>(queue_full)->retry_delay().seconds(), 0);
  // A file that is too large stays too large: no invitation to try again.
  const grpc::Status too_large = ToGrpcStatus(LimitExceeded("max_sequence_bytes", 1, "too large"));
  EXPECT_TRUE(Detail<google::rpc::QuotaFailure>(too_large).has_value());
  EXPECT_FALSE(Detail<google::rpc::RetryInfo>(too_large).has_value());

  EXPECT_TRUE(Detail<google::rpc::RetryInfo>(ToGrpcStatus(ServerStopping())).has_value());
  EXPECT_TRUE(Detail<google::rpc::RetryInfo>(ToGrpcStatus(DiskFull("no room"))).has_value());
}

// A protobuf string that is not UTF-8 cannot be parsed: the client would see garbage instead of the reason.
TEST(Status, MessagesThatQuoteBytesStayReadable) {
  const grpc::Status status = ToGrpcStatus(absl::DataLossError("no PNG: \xff\xfe"), {.subject = "a\xff"});
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  EXPECT_EQ(details.message(), "no PNG: \\xff\\xfe");
  EXPECT_EQ(ToGrpcStatus(absl::DataLossError("kein Bild: Tür.png")).error_message(), "kein Bild: Tür.png");
}

}  // namespace
}  // namespace depthtween::server
