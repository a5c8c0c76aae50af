// The parts of server_load.py that need gRPC. Each prints one line of JSON.
//
// server_load_client upload SERVER SEQUENCE MIB: a file of random bytes to a new sequence; and as many bytes, in the
// same messages, to a server of this process that only counts them.
//
// server_load_client download SERVER OUTPUT: all frames of an output as PNG; and as many messages of the mean size from
// a server of this process that has them in memory.
//
// server_load_client get SERVER JOB COUNT: GetJob again and again; milliseconds at the median and the 99th percentile.
//
// server_load_client watch SERVER JOB COUNT: watches that have had their snapshot, held until standard input ends.
//
// server_load_client stall SERVER OUTPUT COUNT: streams of frames of which nobody reads more than the first message.
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "depthtween/v1/job.grpc.pb.h"
#include "depthtween/v1/output.grpc.pb.h"
#include "depthtween/v1/sequence.grpc.pb.h"
#include "proto/depthtween/crc32c.h"
#include "tests/bench/timing.h"

namespace depthtween {
namespace {

constexpr size_t kChunkBytes = 1 << 20;
constexpr int kStreamsPerConnection = 100;

void Check(const grpc::Status& status, const char* what) {
  if (status.ok()) return;
  std::cerr << what << ": " << status.error_message() << "\n";
  std::exit(1);
}

// Channels of the same arguments share a connection: `number` tells them apart.
std::shared_ptr<grpc::Channel> Connect(const std::string& server, int number = 0) {
  grpc::ChannelArguments arguments;
  arguments.SetInt("depthtween.number", number);
  arguments.SetMaxReceiveMessageSize(-1);
  return grpc::CreateCustomChannel(server, grpc::InsecureChannelCredentials(), arguments);
}

// Counts what comes, and sends messages from memory.
class BareUploads : public v1::SequenceService::Service {
  grpc::Status WriteUpload(grpc::ServerContext* /*context*/, grpc::ServerReader<v1::WriteUploadRequest>* reader,
                           v1::Upload* response) override {
    int64_t bytes = 0;
    for (v1::WriteUploadRequest request; reader->Read(&request);) bytes += static_cast<int64_t>(request.data().size());
    response->set_committed_size(bytes);
    return grpc::Status::OK;
  }
};
class BareFrames : public v1::OutputService::Service {
 public:
  BareFrames(size_t size, int count) : size_(size), count_(count) {}

 private:
  grpc::Status StreamFrames(grpc::ServerContext* /*context*/, const v1::StreamFramesRequest* /*request*/,
                            grpc::ServerWriter<v1::FrameChunk>* writer) override {
    v1::FrameChunk chunk;
    chunk.set_data(std::string(size_, 'x'));
    for (int i = 0; i < count_ && writer->Write(chunk); ++i) {
    }
    return grpc::Status::OK;
  }
  const size_t size_;
  const int count_;
};

class BareServer {
 public:
  explicit BareServer(grpc::Service& service) {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(&service);
    server_ = builder.BuildAndStart();
  }
  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }

 private:
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

// MiB a second.
double Send(const std::string& server, const std::string& upload, const std::vector<std::string>& chunks) {
  const auto stub = v1::SequenceService::NewStub(Connect(server));
  int64_t sent = 0;
  const double seconds = Seconds([&] {
    grpc::ClientContext context;
    v1::Upload answer;
    const auto writer = stub->WriteUpload(&context, &answer);
    for (size_t i = 0; i < chunks.size(); ++i) {
      v1::WriteUploadRequest request;
      if (i == 0) request.set_name(upload);
      request.set_write_offset(sent);
      request.set_data(chunks[i]);
      request.set_crc32c(Crc32c(chunks[i]));
      request.set_finish(i + 1 == chunks.size());
      sent += static_cast<int64_t>(chunks[i].size());
      if (!writer->Write(request)) break;
    }
    writer->WritesDone();
    Check(writer->Finish(), "WriteUpload");
    if (answer.committed_size() != sent) Check({grpc::StatusCode::INTERNAL, "bytes are missing"}, "WriteUpload");
  });
  return static_cast<double>(sent) / seconds / (1 << 20);
}

void Upload(const std::string& server, const std::string& sequence, int mib) {
  std::mt19937_64 random(1);
  std::vector<std::string> chunks(static_cast<size_t>(mib), std::string(kChunkBytes, '\0'));
  for (std::string& chunk : chunks)
    std::generate(chunk.begin(), chunk.end(), [&] { return static_cast<char>(random()); });
  const auto stub = v1::SequenceService::NewStub(Connect(server));
  grpc::ClientContext context;
  v1::StartUploadRequest request;
  request.set_parent(sequence);
  v1::Upload::File& file = *request.mutable_upload()->add_files();
  file.set_path("rgb/large.png");
  file.set_size_bytes(static_cast<int64_t>(kChunkBytes) * mib);
  v1::Upload upload;
  Check(stub->StartUpload(&context, request, &upload), "StartUpload");
  BareUploads bare;
  const BareServer counting(bare);
  const double before = Send(counting.address(), "uploads/none", chunks);
  const double served = Send(server, upload.name(), chunks);
  const double after = Send(counting.address(), "uploads/none", chunks);
  std::printf("{\"bare\": %.1f, \"server\": %.1f}\n", (before + after) / 2, served);
}

struct Received {
  int64_t bytes = 0;
  int messages = 0;
  double seconds = 0;
};

Received Receive(const std::string& server, const std::string& output) {
  const auto stub = v1::OutputService::NewStub(Connect(server));
  Received received;
  received.seconds = Seconds([&] {
    grpc::ClientContext context;
    v1::StreamFramesRequest request;
    request.set_name(output);
    const auto reader = stub->StreamFrames(&context, request);
    for (v1::FrameChunk chunk; reader->Read(&chunk);) {
      ++received.messages;
      received.bytes += static_cast<int64_t>(chunk.data().size());
    }
    Check(reader->Finish(), "StreamFrames");
  });
  return received;
}

void Download(const std::string& server, const std::string& output) {
  const Received served = Receive(server, output);
  BareFrames bare(static_cast<size_t>(served.bytes / served.messages), served.messages);
  const BareServer sending(bare);
  const Received plain = Receive(sending.address(), output);
  const auto rate = [](const Received& some) { return static_cast<double>(some.bytes) / some.seconds / (1 << 20); };
  std::printf("{\"bare\": %.1f, \"server\": %.1f, \"message_bytes\": %lld}\n", rate(plain), rate(served),
              static_cast<long long>(served.bytes / served.messages));
}

void Get(const std::string& server, const std::string& job, int count) {
  const auto stub = v1::JobService::NewStub(Connect(server, /*number=*/1'000'000));
  std::vector<double> times_ms;
  v1::GetJobRequest request;
  request.set_name(job);
  for (int i = 0; i < count; ++i) {
    grpc::ClientContext context;
    v1::Job answer;
    times_ms.push_back(1000 * Seconds([&] { Check(stub->GetJob(&context, request, &answer), "GetJob"); }));
  }
  std::sort(times_ms.begin(), times_ms.end());
  std::printf("{\"median\": %.3f, \"p99\": %.3f}\n", times_ms[times_ms.size() / 2],
              times_ms[times_ms.size() * 99 / 100]);
}

// Opens `count` streams, reads one message of each, and holds them until standard input ends.
template <typename Message>
void Hold(const std::string& server, int count,
          const std::function<std::unique_ptr<grpc::ClientReader<Message>>(
              const std::shared_ptr<grpc::Channel>& channel, grpc::ClientContext* context)>& open) {
  std::vector<std::pair<std::unique_ptr<grpc::ClientContext>, std::unique_ptr<grpc::ClientReader<Message>>>> streams;
  std::shared_ptr<grpc::Channel> channel;
  for (int i = 0; i < count; ++i) {
    if (i % kStreamsPerConnection == 0) channel = Connect(server, i);
    auto context = std::make_unique<grpc::ClientContext>();
    auto reader = open(channel, context.get());
    Message message;
    if (!reader->Read(&message)) Check(reader->Finish(), "a stream");
    streams.emplace_back(std::move(context), std::move(reader));
  }
  std::printf("{\"open\": %d}\n", count);
  std::fflush(stdout);
  while (std::getchar() != EOF) {
  }
  std::_Exit(0);  // ends the connections
}

int Main(const std::vector<std::string>& words) {
  if (words.size() < 3 || words.size() > 4) {
    std::cerr << "see the first lines of server_load_client.cc\n";
    return 2;
  }
  const std::string &what = words[0], &server = words[1], &name = words[2];
  const int count = words.size() > 3 ? std::atoi(words[3].c_str()) : 0;
  if (what == "upload") Upload(server, name, count);
  if (what == "download") Download(server, name);
  if (what == "get") Get(server, name, count);
  if (what == "watch") {
    Hold<v1::JobEvent>(server, count, [&](const auto& channel, grpc::ClientContext* context) {
      v1::WatchJobRequest request;
      request.set_name(name);
      return v1::JobService::NewStub(channel)->WatchJob(context, request);
    });
  }
  if (what == "stall") {
    Hold<v1::FrameChunk>(server, count, [&](const auto& channel, grpc::ClientContext* context) {
      v1::StreamFramesRequest request;
      request.set_name(name);
      return v1::OutputService::NewStub(channel)->StreamFrames(context, request);
    });
  }
  return 0;
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) { return depthtween::Main({argv + 1, argv + argc}); }
