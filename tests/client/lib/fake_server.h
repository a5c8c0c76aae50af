// A server in memory that keeps the promises of the protos for one sequence and one job, and can be told to fail in the
// ways that networks do. Listens on a loopback port of its own.
#ifndef DEPTHTWEEN_TESTS_CLIENT_LIB_FAKE_SERVER_H_
#define DEPTHTWEEN_TESTS_CLIENT_LIB_FAKE_SERVER_H_

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "depthtween/v1/admin.grpc.pb.h"
#include "depthtween/v1/job.grpc.pb.h"
#include "depthtween/v1/output.grpc.pb.h"
#include "depthtween/v1/sequence.grpc.pb.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "proto/depthtween/crc32c.h"

namespace depthtween::client {

using grpc::ServerContext;
using grpc::Status;
using grpc::StatusCode;

class FakeAdmin : public v1::AdminService::Service {
 public:
  Status GetServerInfo(ServerContext*, const v1::GetServerInfoRequest*, v1::ServerInfo* answer) override {
    answer->set_version("fake");
    answer->mutable_limits()->set_max_chunk_bytes(max_chunk_bytes);
    answer->mutable_limits()->set_max_files_per_upload(max_files_per_upload);
    return Status::OK;
  }
  int64_t max_chunk_bytes = 100;
  int max_files_per_upload = 3;
};

class FakeSequences : public v1::SequenceService::Service {
 public:
  Status CreateSequence(ServerContext*, const v1::CreateSequenceRequest* request, v1::Sequence* answer) override {
    if (sequence.name().empty()) {
      sequence.set_name("sequences/1");
      sequence.set_state(v1::Sequence::STATE_UPLOADING);
    }
    *answer = sequence;
    request_ids.push_back(request->request_id());
    return Status::OK;
  }
  Status StartUpload(ServerContext*, const v1::StartUploadRequest* request, v1::Upload* answer) override {
    const std::string name = "sequences/1/uploads/" + request->request_id();
    const auto [found, is_new] = uploads.try_emplace(name);
    if (is_new) {
      found->second.announced = request->upload();
      order.push_back(name);
    }
    *answer = Describe(name);
    return Status::OK;
  }
  Status GetUpload(ServerContext*, const v1::GetUploadRequest* request, v1::Upload* answer) override {
    *answer = Describe(request->name());
    return Status::OK;
  }
  Status WriteUpload(ServerContext*, grpc::ServerReader<v1::WriteUploadRequest>* stream, v1::Upload* answer) override {
    v1::WriteUploadRequest message;
    std::string name;
    while (stream->Read(&message)) {
      if (!message.name().empty()) name = message.name();
      Held& upload = uploads[name];
      messages += 1;
      if (messages == away_at_message) return {StatusCode::UNAVAILABLE, "the line was cut"};
      if (messages == damage_at_message) return {StatusCode::DATA_LOSS, "crc32c does not match"};
      if (message.write_offset() != static_cast<int64_t>(upload.bytes.size())) {
        return {StatusCode::OUT_OF_RANGE, "write_offset is not committed_size"};
      }
      if (message.crc32c() != Crc32c(message.data())) return {StatusCode::DATA_LOSS, "crc32c does not match"};
      upload.bytes += message.data();
      upload.finished = message.finish();
    }
    *answer = Describe(name);
    return Status::OK;
  }
  Status CommitSequence(ServerContext*, const v1::CommitSequenceRequest*, v1::Sequence* answer) override {
    sequence.set_state(v1::Sequence::STATE_VALIDATING);
    *answer = sequence;
    return Status::OK;
  }
  Status GetSequence(ServerContext*, const v1::GetSequenceRequest*, v1::Sequence* answer) override {
    *answer = sequence;
    sequence.set_state(v1::Sequence::STATE_READY);  // validated by the time of the next question
    return Status::OK;
  }

  // What arrived, by path.
  std::map<std::string, std::string> Files() {
    std::map<std::string, std::string> files;
    for (const std::string& name : order) {
      const Held& upload = uploads[name];
      size_t offset = 0;
      for (const v1::Upload::File& file : upload.announced.files()) {
        files[file.path()] = upload.bytes.substr(offset, file.size_bytes());
        offset += file.size_bytes();
      }
    }
    return files;
  }

  // Faults: the number of the message, counted from 1 over all streams, at which they happen.
  int away_at_message = 0;
  int damage_at_message = 0;
  int messages = 0;
  std::vector<std::string> request_ids;

 private:
  struct Held {
    v1::Upload announced;
    std::string bytes;
    bool finished = false;
  };
  v1::Upload Describe(const std::string& name) {
    const Held& held = uploads[name];
    v1::Upload upload;
    upload.set_name(name);
    upload.set_size_bytes(held.announced.size_bytes());
    upload.set_committed_size(static_cast<int64_t>(held.bytes.size()));
    upload.set_state(held.finished ? v1::Upload::STATE_FINISHED : v1::Upload::STATE_RECEIVING);
    return upload;
  }
  v1::Sequence sequence;
  std::map<std::string, Held> uploads;
  std::vector<std::string> order;
};

class FakeJobs : public v1::JobService::Service {
 public:
  Status CreateJob(ServerContext*, const v1::CreateJobRequest* request, v1::Job* answer) override {
    *answer = request->job();
    answer->set_name("jobs/1");
    answer->set_state(state_of_created);
    request_ids.push_back(request->request_id());
    return Status::OK;
  }
  Status RetryJob(ServerContext*, const v1::RetryJobRequest* request, v1::Job* answer) override {
    retries += 1;
    if (retries == away_at_retry) return {StatusCode::UNAVAILABLE, "the answer was lost"};
    if (away_at_retry > 0) return {StatusCode::FAILED_PRECONDITION, "only a FAILED or CANCELLED job can be retried"};
    answer->set_name(request->name());
    answer->set_state(v1::Job::STATE_QUEUED);
    return Status::OK;
  }
  Status GetJob(ServerContext*, const v1::GetJobRequest* request, v1::Job* answer) override {
    answer->set_name(request->name());
    answer->set_state(state_of_asked);
    answer->mutable_end_time()->set_seconds(1);
    return Status::OK;
  }
  Status DeleteJob(ServerContext*, const v1::DeleteJobRequest*, google::protobuf::Empty*) override {
    deletes += 1;
    const bool was_there = std::exchange(exists, false);
    if (deletes <= unanswered_deletes) return {StatusCode::UNAVAILABLE, "the answer was lost"};
    return was_there ? Status::OK : Status(StatusCode::NOT_FOUND, "there is no such job");
  }
  // Sends `events` after the one that resume_token names, and cuts the line once, after the first of them.
  Status WatchJob(ServerContext*, const v1::WatchJobRequest* request,
                  grpc::ServerWriter<v1::JobEvent>* stream) override {
    resume_tokens.push_back(request->resume_token());
    bool send = request->resume_token().empty();
    for (const v1::JobEvent& event : events) {
      if (send) stream->Write(event);
      if (send && resume_tokens.size() == 1) return {StatusCode::UNAVAILABLE, "the line was cut"};
      if (event.resume_token() == request->resume_token()) send = true;
    }
    return Status::OK;
  }

  v1::Job::State state_of_created = v1::Job::STATE_QUEUED, state_of_asked = v1::Job::STATE_SUCCEEDED;
  int away_at_retry = 0;  // the number of the retry that gets through but is not answered; 0: none
  bool exists = true;
  int unanswered_deletes = 0;  // the first ones get through but are not answered
  int deletes = 0;
  std::vector<v1::JobEvent> events;
  std::vector<std::string> request_ids, resume_tokens;
  int retries = 0;
};

class FakeOutputs : public v1::OutputService::Service {
 public:
  Status ListOutputs(ServerContext*, const v1::ListOutputsRequest* request, v1::ListOutputsResponse* answer) override {
    v1::Output& depth = *answer->add_outputs();
    depth.set_name(request->parent() + "/outputs/depth");
    depth.set_kind(v1::Output::KIND_FRAMES);
    depth.set_file_name(frame_folder);
    depth.set_frames_ready(frames_ready);
    depth.set_frame_count(static_cast<int>(frames.size()));
    v1::Output& report = *answer->add_outputs();
    report.set_name(request->parent() + "/outputs/report");
    report.set_kind(v1::Output::KIND_FILE);
    report.set_ready(frames_ready == static_cast<int>(frames.size()));
    report.set_file_name("report.json");
    if (report_is_lost) report.set_ready(false), report.set_lost(true);
    return Status::OK;
  }
  Status StreamFrames(ServerContext*, const v1::StreamFramesRequest* request,
                      grpc::ServerWriter<v1::FrameChunk>* stream) override {
    start_frames.push_back(request->start_frame());
    const int end = request->end_frame() == 0 ? frames_ready : std::min(frames_ready, request->end_frame());
    for (int i = request->start_frame(); i < end; ++i) {
      if (lost_frames.count(i) != 0) return Lost(i);
      // A frame without bytes takes a message too.
      for (size_t offset = 0; offset == 0 || offset < frames[i].size(); offset += kChunk) {
        chunks += 1;
        if (chunks == away_at_chunk) return {StatusCode::UNAVAILABLE, "the line was cut"};
        v1::FrameChunk chunk;
        chunk.set_frame(i);
        chunk.set_offset(static_cast<int64_t>(offset));
        chunk.set_data(frames[i].substr(offset, kChunk));
        chunk.set_crc32c(Crc32c(chunk.data()) ^ (chunks == damage_at_chunk ? 1U : 0U));
        if (offset == 0) {
          chunk.mutable_header()->set_stem(stems.empty() ? absl::StrCat("frame", i) : stems[i]);
          chunk.mutable_header()->set_size_bytes(static_cast<int64_t>(frames[i].size()));
          chunk.mutable_header()->set_crc32c(Crc32c(frames[i]));
        }
        if (offset + kChunk >= frames[i].size()) chunk.set_next_frame(i + 1);
        stream->Write(chunk);
      }
    }
    return Status::OK;
  }
  // As a server says it of what it made and has no more: frames are lost, files are damaged.
  static Status Lost(int frame = -1) {
    google::rpc::ErrorInfo info;
    info.set_reason(frame >= 0 ? "FILE_LOST" : "FILE_DAMAGED");
    if (frame >= 0) (*info.mutable_metadata())["frame"] = absl::StrCat(frame);
    google::rpc::Status details;
    details.add_details()->PackFrom(info);
    return {StatusCode::DATA_LOSS, "its file is lost from the server's disk", details.SerializeAsString()};
  }
  Status ReadOutput(ServerContext*, const v1::ReadOutputRequest* request,
                    grpc::ServerWriter<v1::ReadOutputResponse>* stream) override {
    if (report_is_lost) return Lost();
    v1::ReadOutputResponse part;
    part.set_offset(request->read_offset());
    part.set_data(report.substr(request->read_offset(), 4));
    part.set_crc32c(Crc32c(part.data()));
    stream->Write(part);
    if (request->read_offset() + 4 < static_cast<int64_t>(report.size())) return {StatusCode::UNAVAILABLE, "cut"};
    return Status::OK;
  }

  static constexpr size_t kChunk = 16;
  std::vector<std::string> frames;
  std::string frame_folder = "depth";
  std::vector<std::string> stems;  // empty: frame0, frame1, ...
  int frames_ready = 0;
  std::set<int> lost_frames;
  bool report_is_lost = false;
  std::string report = "{\"frames\": 3}";
  int away_at_chunk = 0, damage_at_chunk = 0, chunks = 0;
  std::vector<int> start_frames;
};

class FakeServer {
 public:
  // On a port of the system's choice, or on this one.
  explicit FakeServer(const std::string& address = "127.0.0.1:0") {
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address, grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(&admin);
    builder.RegisterService(&sequences);
    builder.RegisterService(&jobs);
    builder.RegisterService(&outputs);
    server_ = builder.BuildAndStart();
  }
  std::string address() const { return absl::StrCat("127.0.0.1:", port_); }

  FakeAdmin admin;
  FakeSequences sequences;
  FakeJobs jobs;
  FakeOutputs outputs;

 private:
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_TESTS_CLIENT_LIB_FAKE_SERVER_H_
