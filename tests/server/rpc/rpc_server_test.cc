// The server as a whole: what it lists, how it is probed, how it stops.
#include "server/rpc/rpc_server.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/security/credentials.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <future>
#include <thread>

#include "depthtween/v1/admin.grpc.pb.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "proto/depthtween/crc32c.h"
#include "server/rpc/health_check.h"
#include "server/telemetry/metrics.h"
#include "server/telemetry/request_id.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

namespace health_v1 = grpc::health::v1;
using google::protobuf::DescriptorPool;
using google::protobuf::Message;
using google::protobuf::MessageFactory;

class RpcServerTest : public RpcTest {
 protected:
  grpc::Status Check(const std::string& service, health_v1::HealthCheckResponse* response) {
    grpc::ClientContext context;
    health_v1::HealthCheckRequest request;
    request.set_service(service);
    return health_v1::Health::NewStub(channel())->Check(&context, request, response);
  }
  std::string Address() { return "127.0.0.1:" + std::to_string(server().port()); }
};

TEST_F(RpcServerTest, SaysWhatItIs) {
  job_options.workers = 3;
  grpc::ClientContext context;
  v1::ServerInfo info;
  ASSERT_THAT(v1::AdminService::NewStub(channel())->GetServerInfo(&context, {}, &info), Succeeds());
  EXPECT_EQ(info.version(), DEPTHTWEEN_VERSION);
  EXPECT_EQ(info.workers(), 3);
  EXPECT_EQ(info.limits().max_chunk_bytes(), limits.max_chunk_bytes);
  EXPECT_EQ(info.limits().max_queued_jobs(), limits.max_queued_jobs);
}

TEST_F(RpcServerTest, HealthIsToldForEachService) {
  health_v1::HealthCheckResponse response;
  for (const std::string service : {"", "depthtween.v1.SequenceService", "depthtween.v1.JobService",
                                    "depthtween.v1.OutputService", "depthtween.v1.AdminService"}) {
    ASSERT_THAT(Check(service, &response), Succeeds()) << service;
    EXPECT_EQ(response.status(), health_v1::HealthCheckResponse::SERVING) << service;
  }
  EXPECT_THAT(Check("depthtween.v1.Nothing", &response), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));

  grpc::ClientContext context;
  health_v1::HealthCheckRequest request;
  request.set_service("depthtween.v1.Nothing");
  const auto stub = health_v1::Health::NewStub(channel());
  const auto reader = stub->Watch(&context, request);
  ASSERT_TRUE(reader->Read(&response));
  EXPECT_EQ(response.status(), health_v1::HealthCheckResponse::SERVICE_UNKNOWN);
  context.TryCancel();
}

TEST_F(RpcServerTest, AProbeFromOutsideSeesTheServerAndItsEnd) {
  const std::string address = Address();
  EXPECT_THAT(CheckHealth({.server = address, .timeout = absl::Seconds(60)}), IsOk());
  StopServer();
  EXPECT_THAT(CheckHealth({.server = address, .timeout = absl::Milliseconds(200)}),
              HasCode(absl::StatusCode::kUnavailable));
}

// One call of any method with one request, as a client does it that knows only bytes. Gives the status, and the first
// answer if there is one; a stream that goes on is cancelled then.
grpc::Status CallWithBytes(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                           const std::string& request, std::string* answer) {
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  void* tag = nullptr;
  bool ok = false;
  grpc::ClientContext context;
  const auto call = stub.PrepareCall(&context, method, &queue);
  call->StartCall(nullptr);
  queue.Next(&tag, &ok);
  const grpc::Slice slice(request);
  call->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), nullptr);
  queue.Next(&tag, &ok);
  grpc::ByteBuffer buffer;
  call->Read(&buffer, nullptr);
  queue.Next(&tag, &ok);
  if (ok) {
    std::vector<grpc::Slice> slices;
    EXPECT_TRUE(buffer.Dump(&slices).ok());
    for (const grpc::Slice& part : slices) answer->append(reinterpret_cast<const char*>(part.begin()), part.size());
    grpc::ByteBuffer next;
    if (method == "/grpc.health.v1.Health/Watch") context.TryCancel();
    call->Read(&next, nullptr);
    queue.Next(&tag, &ok);
  }
  grpc::Status status;
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
  return status;
}

// The services that a reflection client is shown. Debian ships no header for reflection, but its library brings the
// descriptors.
std::vector<std::string> ServicesByReflection(const std::shared_ptr<grpc::Channel>& channel) {
  const auto make = [](const char* type) {
    const auto* descriptor = DescriptorPool::generated_pool()->FindMessageTypeByName(type);
    return std::unique_ptr<Message>(MessageFactory::generated_factory()->GetPrototype(descriptor)->New());
  };
  const auto request = make("grpc.reflection.v1alpha.ServerReflectionRequest");
  request->GetReflection()->SetString(request.get(), request->GetDescriptor()->FindFieldByName("list_services"), "*");
  std::string bytes;
  EXPECT_THAT(CallWithBytes(channel, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
                            request->SerializeAsString(), &bytes),
              Succeeds());
  const auto response = make("grpc.reflection.v1alpha.ServerReflectionResponse");
  EXPECT_TRUE(response->ParseFromString(bytes));
  const Message& list = response->GetReflection()->GetMessage(
      *response, response->GetDescriptor()->FindFieldByName("list_services_response"));
  const auto* services = list.GetDescriptor()->FindFieldByName("service");
  std::vector<std::string> names;
  for (int i = 0; i < list.GetReflection()->FieldSize(list, services); ++i) {
    const Message& service = list.GetReflection()->GetRepeatedMessage(list, services, i);
    names.push_back(service.GetReflection()->GetString(service, service.GetDescriptor()->FindFieldByName("name")));
  }
  return names;
}

// Whoever finds a method by reflection can call it: with an empty request it does its work or says what is missing,
// in the form of every other error.
TEST_F(RpcServerTest, EveryMethodAnswersAnEmptyRequest) {
  const std::vector<std::string> services = ServicesByReflection(channel());
  EXPECT_THAT(services,
              testing::UnorderedElementsAre("depthtween.v1.SequenceService", "depthtween.v1.JobService",
                                            "depthtween.v1.OutputService", "depthtween.v1.AdminService",
                                            "grpc.health.v1.Health", "grpc.reflection.v1alpha.ServerReflection"));
  int methods = 0;
  for (const std::string& name : services) {
    if (name == "grpc.reflection.v1alpha.ServerReflection") continue;  // gRPC's own, which has just answered
    const auto* service = DescriptorPool::generated_pool()->FindServiceByName(name);
    ASSERT_NE(service, nullptr) << name;
    for (int i = 0; i < service->method_count(); ++i, ++methods) {
      const std::string method = "/" + name + "/" + service->method(i)->name();
      std::string answer;
      const grpc::Status status = CallWithBytes(channel(), method, "", &answer);
      if (status.ok() || status.error_code() == grpc::CANCELLED) continue;
      EXPECT_EQ(status.error_code(), grpc::INVALID_ARGUMENT) << method << ": " << status.error_message();
      EXPECT_TRUE(Detail<google::rpc::ErrorInfo>(status).has_value()) << method;
      EXPECT_TRUE(Detail<google::rpc::BadRequest>(status).has_value()) << method;
    }
  }
  EXPECT_GT(methods, 30);
}

// Bytes that are no message, to every method: told as what they are, and counted as every call.
TEST_F(RpcServerTest, UndecodableRequestsAreCallsLikeOthers) {
  int methods = 0;
  for (const std::string& name : ServicesByReflection(channel())) {
    if (name == "grpc.reflection.v1alpha.ServerReflection") continue;  // gRPC's own, which reads a stream
    const auto* service = DescriptorPool::generated_pool()->FindServiceByName(name);
    for (int i = 0; i < service->method_count(); ++i, ++methods) {
      const std::string& method = service->method(i)->name();
      // A varint without end, and a field that is longer than the message.
      for (const std::string bytes : {"\xff\xff\xff", "\x0a\x7f-"}) {
        std::string answer;
        EXPECT_THAT(CallWithBytes(channel(), absl::StrCat("/", name, "/", method), bytes, &answer),
                    Fails(grpc::INVALID_ARGUMENT, "BAD_MESSAGE"))
            << method;
      }
      const std::string label = absl::StrCat(name == "grpc.health.v1.Health" ? "Health." : "", method);
      EXPECT_THAT(MetricsText({}), testing::ContainsRegex(absl::StrCat("calls_total\\{[^}]*INVALID_ARGUMENT[^}]*\"",
                                                                       label, "\"[^}]*\\} ")));
    }
  }
  EXPECT_GT(methods, 30);
  EXPECT_NE(CreateSequence().name(), "") << "and the server goes on";
}

// What came before it is kept.
TEST_F(RpcServerTest, AnUndecodableMessageEndsAnUpload) {
  const v1::Upload upload = StartUpload(CreateSequence().name(), {{"a", "0123456789"}});
  v1::WriteUploadRequest first;
  first.set_name(upload.name());
  first.set_data("0123");
  first.set_crc32c(Crc32c("0123"));
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  grpc::GenericStub stub(channel());
  const auto call = stub.PrepareCall(&context, "/depthtween.v1.SequenceService/WriteUpload", &queue);
  void* tag = nullptr;
  bool ok = false;
  call->StartCall(nullptr);
  ASSERT_TRUE(queue.Next(&tag, &ok) && ok);
  for (const std::string& bytes : {first.SerializeAsString(), std::string("\xff\xff\xff")}) {
    const grpc::Slice slice(bytes);
    call->Write(grpc::ByteBuffer(&slice, 1), nullptr);
    ASSERT_TRUE(queue.Next(&tag, &ok) && ok);
  }
  grpc::Status status;
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
  EXPECT_THAT(status, Fails(grpc::INVALID_ARGUMENT, "BAD_MESSAGE"));
  grpc::ClientContext ask;
  v1::GetUploadRequest request;
  request.set_name(upload.name());
  v1::Upload after;
  EXPECT_THAT(sequences_stub().GetUpload(&ask, request, &after), Succeeds());
  EXPECT_EQ(after.committed_size(), 4);
}

TEST_F(RpcServerTest, WhatIsNoMethodOrTooLongIsRefused) {
  std::string answer;
  EXPECT_EQ(CallWithBytes(channel(), "/depthtween.v1.JobService/Nothing", "", &answer).error_code(),
            grpc::UNIMPLEMENTED);
  EXPECT_EQ(
      CallWithBytes(channel(), "/depthtween.v1.JobService/GetJob", std::string(5 << 20, '\0'), &answer).error_code(),
      grpc::RESOURCE_EXHAUSTED);
  EXPECT_NE(CreateSequence().name(), "");
}

// gRPC alone would take the socket away from the server that has it.
TEST_F(RpcServerTest, ASocketBelongsToTheServerThatAnswersThere) {
  const TemporaryFolder folder;
  rpc_options.listen = "unix:" + folder / "socket";
  // What a server leaves that was killed: nobody answers.
  sockaddr_un left{.sun_family = AF_UNIX, .sun_path = {}};
  const std::string path = folder / "socket";
  std::copy(path.begin(), path.end(), left.sun_path);
  const int fd = socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_EQ(bind(fd, reinterpret_cast<const sockaddr*>(&left), sizeof(left)), 0);
  close(fd);
  server();
  EXPECT_THAT(CheckHealth({.server = rpc_options.listen, .timeout = absl::Seconds(60)}), IsOk());
  EXPECT_THAT(StartAnother(rpc_options), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(CheckHealth({.server = rpc_options.listen, .timeout = absl::Seconds(60)}), IsOk());
}

// https://www.w3.org/TR/trace-context/
TEST_F(RpcServerTest, EveryAnswerNamesItsTrace) {
  grpc::ClientContext context;
  context.AddMetadata("traceparent", "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01");
  v1::Job job;
  (void)jobs_stub().GetJob(&context, {}, &job);
  const auto& metadata = context.GetServerInitialMetadata();
  ASSERT_EQ(metadata.count("traceparent"), 1U);
  const grpc::string_ref value = metadata.find("traceparent")->second;
  EXPECT_THAT(std::string(value.data(), value.size()),
              testing::MatchesRegex("00-0af7651916cd43dd8448eb211c80319c-[0-9a-f]{16}-01"));
}

TEST_F(RpcServerTest, EveryAnswerCarriesARequestId) {
  for (const std::string wanted : {"my-id.1", "", "not acceptable", "<script>"}) {
    grpc::ClientContext context;
    if (!wanted.empty()) context.AddMetadata(kRequestIdKey, wanted);
    v1::GetJobRequest request;
    v1::Job job;
    const grpc::Status status = jobs_stub().GetJob(&context, request, &job);
    const auto& metadata = context.GetServerInitialMetadata();
    ASSERT_EQ(metadata.count(kRequestIdKey), 1U);
    const grpc::string_ref value = metadata.find(kRequestIdKey)->second;
    const std::string id(value.data(), value.size());
    if (wanted == "my-id.1") {
      EXPECT_EQ(id, wanted);
    } else {
      EXPECT_EQ(id.size(), 16U) << wanted;
    }
    ASSERT_TRUE(Detail<google::rpc::RequestInfo>(status).has_value());
    EXPECT_EQ(Detail<google::rpc::RequestInfo>(status)->request_id(), id);
  }
}

// Watchers that do nothing shut nobody out: short calls and health have room of their own.
TEST_F(RpcServerTest, StreamsBeyondTheLimitAreAskedToComeBack) {
  rpc_options.room.streams = 2;
  const v1::Job job = CreateJob(ReadySequence("wait_at 0"));
  v1::WatchJobRequest request;
  request.set_name(job.name());
  grpc::ClientContext contexts[2];
  std::unique_ptr<grpc::ClientReader<v1::JobEvent>> readers[2];
  for (int i = 0; i < 2; ++i) {
    readers[i] = jobs_stub().WatchJob(&contexts[i], request);
    v1::JobEvent event;
    ASSERT_TRUE(readers[i]->Read(&event));
  }
  const auto watch = [&] {
    grpc::ClientContext context;
    const auto reader = jobs_stub().WatchJob(&context, request);
    v1::JobEvent event;
    if (!reader->Read(&event)) return reader->Finish();
    context.TryCancel();
    reader->Finish();
    return grpc::Status::OK;
  };
  const grpc::Status status = watch();
  EXPECT_THAT(status, Fails(grpc::RESOURCE_EXHAUSTED, "SERVER_BUSY"));
  EXPECT_TRUE(Detail<google::rpc::RetryInfo>(status).has_value());
  grpc::ClientContext context;
  v1::ListJobsResponse list;
  EXPECT_THAT(jobs_stub().ListJobs(&context, {}, &list), Succeeds());
  EXPECT_THAT(CheckHealth({.server = Address(), .timeout = absl::Seconds(60)}), IsOk());

  contexts[0].TryCancel();
  readers[0]->Finish();
  grpc::Status later;
  do {
    later = watch();
  } while (later.error_code() == grpc::RESOURCE_EXHAUSTED);
  EXPECT_THAT(later, Succeeds());
}

TEST_F(RpcServerTest, OneClientCannotHaveAllStreams) {
  rpc_options.room.streams_of_client = 1;
  const v1::Job job = CreateJob(ReadySequence("wait_at 0"));
  v1::WatchJobRequest request;
  request.set_name(job.name());
  grpc::ClientContext first, second;
  v1::JobEvent event;
  const auto reader = jobs_stub().WatchJob(&first, request);
  ASSERT_TRUE(reader->Read(&event));
  const auto refused = jobs_stub().WatchJob(&second, request);
  EXPECT_FALSE(refused->Read(&event));
  EXPECT_THAT(refused->Finish(), Fails(grpc::RESOURCE_EXHAUSTED, "SERVER_BUSY"));
  first.TryCancel();
  reader->Finish();
}

// API.md: on the way down every stream ends with UNAVAILABLE and a RetryInfo, whatever it was doing, and bytes that
// arrived are kept. Over a real connection, as clients have it.
TEST_F(RpcServerTest, StoppingEndsEveryStream) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  const auto network = grpc::CreateCustomChannel(Address(), grpc::InsecureChannelCredentials(), arguments);
  const auto job_client = v1::JobService::NewStub(network);
  const auto output_client = v1::OutputService::NewStub(network);
  const auto sequence_client = v1::SequenceService::NewStub(network);
  const v1::Job job = CreateJob(ReadySequence("wait_at 1"));

  grpc::ClientContext watch_context, frames_context, upload_context;
  v1::WatchJobRequest watch_request;
  watch_request.set_name(job.name());
  const auto watch = job_client->WatchJob(&watch_context, watch_request);
  v1::JobEvent event;
  ASSERT_TRUE(watch->Read(&event));

  v1::StreamFramesRequest frames_request;
  frames_request.set_name(job.name() + "/outputs/depth");
  frames_request.set_follow(true);
  const auto frames = output_client->StreamFrames(&frames_context, frames_request);
  v1::FrameChunk chunk;
  ASSERT_TRUE(frames->Read(&chunk));

  const std::string sequence = CreateSequence().name();
  v1::Upload response;
  const auto upload = sequence_client->WriteUpload(&upload_context, &response);
  v1::WriteUploadRequest bytes;
  bytes.set_name(StartUpload(sequence, {{"a", "0123456789"}}).name());
  bytes.set_data("01234");
  bytes.set_crc32c(Crc32c("01234"));
  ASSERT_TRUE(upload->Write(bytes));
  const std::string file = directory().SequenceFolder(IdOf(sequence)) + "/a";
  while (ReadText(file) != "01234") std::this_thread::sleep_for(std::chrono::milliseconds(2));

  auto stopped = std::async(std::launch::async, [this] { StopServer(); });
  while (watch->Read(&event)) {
  }
  while (frames->Read(&chunk)) {
  }
  for (const grpc::Status& status : {watch->Finish(), frames->Finish(), upload->Finish()}) {
    EXPECT_THAT(status, Fails(grpc::UNAVAILABLE, "SERVER_STOPPING"));
    EXPECT_TRUE(Detail<google::rpc::RetryInfo>(status).has_value());
  }
  stopped.get();
  const auto again = StartAnother(rpc_options);
  ASSERT_THAT(again, IsOk());
  grpc::ClientContext context;
  v1::GetUploadRequest request;
  request.set_name(bytes.name());
  ASSERT_THAT(v1::SequenceService::NewStub((*again)->InProcessChannel())->GetUpload(&context, request, &response),
              Succeeds());
  EXPECT_EQ(response.committed_size(), 5);
}

// A client that does not read cannot keep the server from stopping.
TEST_F(RpcServerTest, StoppingDoesNotWaitForReadersThatDoNotRead) {
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  ForgetChecksums(job);
  WriteText(directory().OutFolder(IdOf(job.name())) + "/depth/000000.png", RandomBytes(8 << 20, 1));
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  const auto network = grpc::CreateCustomChannel(Address(), grpc::InsecureChannelCredentials(), arguments);
  grpc::ClientContext context;
  v1::StreamFramesRequest request;
  request.set_name(job.name() + "/outputs/depth");
  const auto stub = v1::OutputService::NewStub(network);
  const auto reader = stub->StreamFrames(&context, request);
  v1::FrameChunk chunk;
  ASSERT_TRUE(reader->Read(&chunk));
  StopServer(absl::Milliseconds(50));
  while (reader->Read(&chunk)) {
  }
  EXPECT_FALSE(reader->Finish().ok());
}

// What the metrics say of jobs is what was made here; calls are at least those that this test made.
TEST_F(RpcServerTest, MetricsTellOfJobsAndCalls) {
  const v1::Job job = CreateJob(ReadySequence());
  WaitUntilEnded(job.name());
  grpc::ClientContext context;
  v1::Metrics metrics;
  ASSERT_THAT(v1::AdminService::NewStub(channel())->GetMetrics(&context, {}, &metrics), Succeeds());
  EXPECT_THAT(metrics.text(), testing::HasSubstr("depthtween_jobs{state=\"SUCCEEDED\",tenant=\"default\"} 1\n"));
  EXPECT_THAT(metrics.text(), testing::HasSubstr("depthtween_calls_total{code=\"OK\",method=\"CreateJob\"}"));
  EXPECT_THAT(metrics.text(), testing::HasSubstr("depthtween_ready 1\n"));
  EXPECT_THAT(metrics.text(), testing::HasSubstr("depthtween_store_write_seconds_count"));
}

TEST_F(RpcServerTest, TwoServersCannotShareAPort) {
  RpcServerOptions options = rpc_options;
  options.listen = Address();
  const auto other = StartAnother(options);
  EXPECT_THAT(other, HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(std::string(other.status().message()), testing::HasSubstr(Address()));
}

// There is neither TLS nor a token: what is reachable from other machines needs a word of its own.
TEST(RpcServerOptions, OnlyLoopbackUnlessTold) {
  for (const std::string listen : {"127.0.0.1:50051", "127.1.2.3:0", "[::1]:1", "localhost:1", "unix:/tmp/a.sock"}) {
    EXPECT_THAT((RpcServerOptions{.listen = listen}.Validate(/*tokens=*/false)), IsOk()) << listen;
  }
  for (const std::string listen :
       {"0.0.0.0:50051", "[::]:50051", "192.168.1.1:1", "example.org:1", "[::ffff:1.2.3.4]:1"}) {
    const absl::Status status = RpcServerOptions{.listen = listen}.Validate(/*tokens=*/false);
    EXPECT_THAT(status, HasCode(absl::StatusCode::kInvalidArgument)) << listen;
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr("--insecure-listen-anywhere"));
    EXPECT_THAT((RpcServerOptions{.listen = listen, .insecure_listen_anywhere = true}.Validate(/*tokens=*/false)),
                IsOk());
  }
  for (const std::string listen : {"", "127.0.0.1", ":1", "127.0.0.1:x", "127.0.0.1:65536", "127.0.0.1:-1"}) {
    EXPECT_THAT((RpcServerOptions{.listen = listen, .insecure_listen_anywhere = true}.Validate(/*tokens=*/false)),
                HasCode(absl::StatusCode::kInvalidArgument))
        << listen;
  }
  EXPECT_THAT((RpcServerOptions{.room = {.calls = 0}}.Validate(/*tokens=*/false)),
              HasCode(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace depthtween::server
