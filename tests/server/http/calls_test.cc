// Calls as coroutines against a real server in the process; what they carry, against the contract of the guard.
#include "server/http/calls.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/http/fake_exchange.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::Pair;

TEST(CallMetadata, OnlyWhatTheGuardAndTheLogNeed) {
  const std::string trace = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01";
  HttpRequest request{.query = {{"signature", "abc.def"}},
                      .headers = {{"Authorization", "Bearer s3cret"},
                                  {"Traceparent", "the client's own, which was looked at before"},
                                  {"Cookie", "a=b"},
                                  {"depthtween-peer", "10.0.0.1:1"},
                                  {"depthtween-link", "forged"},
                                  {"grpc-timeout", "1n"}},
                      .peer = "127.0.0.1:4711",
                      .request_id = "abc",
                      .traceparent = trace};
  EXPECT_THAT(
      CallMetadata(request),
      ElementsAre(Pair("authorization", "Bearer s3cret"), Pair("depthtween-link", "abc.def"),
                  Pair("depthtween-peer", "127.0.0.1:4711"), Pair("traceparent", trace), Pair("x-request-id", "abc")));
  // What gRPC would refuse as metadata is not passed on.
  request.query = {{"signature", "a\nb"}};
  request.headers = {{"Authorization", "\xff"}};
  request.traceparent.clear();
  EXPECT_THAT(CallMetadata(request),
              ElementsAre(Pair("depthtween-peer", "127.0.0.1:4711"), Pair("x-request-id", "abc")));
}

// By the grammar in gRPC's PROTOCOL-HTTP2.
TEST(GrpcTimeout, IsANumberAndAUnit) {
  EXPECT_EQ(ParseGrpcTimeout("10S"), absl::Seconds(10));
  EXPECT_EQ(ParseGrpcTimeout("99999999H"), absl::Hours(99'999'999));
  EXPECT_EQ(ParseGrpcTimeout("2M"), absl::Minutes(2));
  EXPECT_EQ(ParseGrpcTimeout("0m"), absl::ZeroDuration());
  EXPECT_EQ(ParseGrpcTimeout("7u"), absl::Microseconds(7));
  EXPECT_EQ(ParseGrpcTimeout("7n"), absl::Nanoseconds(7));
  for (const char* bad : {"", "S", "10", "10s", "-1S", "1.5S", "123456789S", " 1S", "1SS"}) {
    EXPECT_EQ(ParseGrpcTimeout(bad), std::nullopt) << bad;
  }
}

class CallsTest : public RpcTest {
 protected:
  boost::asio::io_context context;
};

TEST_F(CallsTest, Unary) {
  RpcChannel rpc(channel());
  FakeExchange exchange(context, {.request_id = "abc"});
  const v1::Sequence made = CreateSequence("name");
  v1::GetSequenceRequest request;
  v1::Sequence answer;
  request.set_name(made.name());
  EXPECT_THAT(
      RunToEnd(context, CallUnary(rpc, exchange, "/depthtween.v1.SequenceService/GetSequence", request, &answer)),
      Succeeds());
  EXPECT_EQ(answer.display_name(), "name");
  request.set_name("sequences/nothing");
  const grpc::Status status =
      RunToEnd(context, CallUnary(rpc, exchange, "/depthtween.v1.SequenceService/GetSequence", request, &answer));
  EXPECT_EQ(status.error_code(), grpc::NOT_FOUND);
  EXPECT_EQ(Detail<google::rpc::RequestInfo>(status)->request_id(), "abc");
  EXPECT_EQ(RunToEnd(context, CallUnary(rpc, exchange, "/nobody.Knows/This", request, &answer)).error_code(),
            grpc::UNIMPLEMENTED);
}

// A call that streams to the server: what it says at the end has arrived byte for byte.
TEST_F(CallsTest, ClientStreaming) {
  RpcChannel rpc(channel());
  FakeExchange exchange(context, {.request_id = "abc"});
  const v1::Upload upload = StartUpload(CreateSequence().name(), {{"rgb.txt", "0123456789"}});
  v1::Upload answer;
  const auto write = [&]() -> boost::asio::awaitable<grpc::Status> {
    RpcCall call(rpc, exchange, "/depthtween.v1.SequenceService/WriteUpload");
    v1::WriteUploadRequest message;
    message.set_name(upload.name());
    message.set_finish(true);
    (void)co_await call.Write(message);  // refused: nothing has been written
    co_await call.CloseWriting();
    (void)co_await call.Read(&answer);
    co_return co_await call.Finish();
  };
  EXPECT_FALSE(RunToEnd(context, write()).ok());
}

// A stream that would go on for ever ends when its time is over.
TEST_F(CallsTest, TheClientsDeadlineHolds) {
  RpcChannel rpc(channel());
  const std::string job = CreateJob(ReadySequence("wait_at 1")).name();
  FakeExchange exchange(context, {.headers = {{"grpc-timeout", "300m"}}, .request_id = "abc"});
  const auto watch = [&]() -> boost::asio::awaitable<grpc::Status> {
    RpcCall call(rpc, exchange, "/depthtween.v1.JobService/WatchJob");
    v1::WatchJobRequest request;
    request.set_name(job);
    (void)co_await call.WriteLast(request);
    v1::JobEvent event;
    bool more = true;
    while (more) more = co_await call.Read(&event);
    co_return co_await call.Finish();
  };
  EXPECT_EQ(RunToEnd(context, watch()).error_code(), grpc::DEADLINE_EXCEEDED);
}

// Messages come in order; ReadWithin says that there is none yet; a client that goes ends the call.
TEST_F(CallsTest, ServerStreamingUntilTheClientGoes) {
  RpcChannel rpc(channel());
  FakeExchange exchange(context, {.request_id = "abc"});
  const std::string job = CreateJob(ReadySequence("wait_at 1")).name();
  bool first = false, waited = false;
  const auto watch = [&]() -> boost::asio::awaitable<grpc::Status> {
    RpcCall call(rpc, exchange, "/depthtween.v1.JobService/WatchJob");
    v1::WatchJobRequest request;
    request.set_name(job);
    (void)co_await call.WriteLast(request);
    v1::JobEvent event;
    first = co_await call.Read(&event);
    // The job waits for its child: sooner or later there is nothing new.
    std::optional<bool> more = true;
    while (more && *more) more = co_await call.ReadWithin(absl::Milliseconds(50), &event);
    waited = !more;
    exchange.MarkGone();
    EXPECT_FALSE(co_await call.Read(&event));
    co_return co_await call.Finish();
  };
  EXPECT_EQ(RunToEnd(context, watch()).error_code(), grpc::CANCELLED);
  EXPECT_TRUE(first);
  EXPECT_TRUE(waited);
}

}  // namespace
}  // namespace depthtween::server
