#include "tests/server/rpc/rpc_fixture.h"

#include <random>
#include <thread>

#include "proto/depthtween/crc32c.h"
#include "server/store/sqlite.h"
#include "server/telemetry/log.h"

namespace depthtween::server {

RpcTest::RpcTest() {
  ConfigureLog({.level = LogLevel::kError});
  job_options.core_program = FAKE_CORE;
  job_options.workers = 1;
  limits.reserved_disk_bytes = 0;
}

RpcTest::~RpcTest() {
  // As in main.cc: the server goes before what it borrows.
  sequences_stub_.reset();
  jobs_stub_.reset();
  outputs_stub_.reset();
  server_.reset();
  upkeep_.reset();
  jobs_.reset();
}

RpcServer& RpcTest::server() {
  if (server_ == nullptr) {
    directory_ = Take(DataDirectory::Open(folder_ / "data"));
    store_ = Take(OpenSqliteStore(directory_->DatabaseFile(), limits));
    blobs_ = MakeFolderBlobStore(*directory_);
    jobs_ = Take(JobManager::Start(*directory_, *store_, job_options));
    sequences_ = std::make_unique<Sequences>(*store_, *blobs_, [this] { jobs_->Wake(); });
    collector_ = std::make_unique<Collector>(*store_, *jobs_, *sequences_, *directory_, job_options.retention);
    upkeep_ = std::make_unique<Upkeep>(*store_, *collector_, jobs_->damage(), directory_->path(),
                                       UpkeepOptions{.scrub_round = absl::ZeroDuration(), .gap = absl::Hours(24)});
    guard_ = Take(Guard::Open(guard_options));
    server_ = Take(RpcServer::Start(rpc_options, *directory_, *guard_, *sequences_, *jobs_, *upkeep_, health_));
    sequences_stub_ = v1::SequenceService::NewStub(server_->InProcessChannel());
    jobs_stub_ = v1::JobService::NewStub(server_->InProcessChannel());
    outputs_stub_ = v1::OutputService::NewStub(server_->InProcessChannel());
  }
  return *server_;
}

absl::StatusOr<std::unique_ptr<RpcServer>> RpcTest::StartAnother(const RpcServerOptions& options) {
  return RpcServer::Start(options, *directory_, *guard_, *sequences_, *jobs_, *upkeep_, health_);
}

v1::SequenceService::Stub& RpcTest::sequences_stub() { return server(), *sequences_stub_; }
v1::JobService::Stub& RpcTest::jobs_stub() { return server(), *jobs_stub_; }
v1::OutputService::Stub& RpcTest::outputs_stub() { return server(), *outputs_stub_; }

v1::Sequence RpcTest::CreateSequence(const std::string& display_name) {
  grpc::ClientContext context;
  v1::CreateSequenceRequest request;
  request.mutable_sequence()->set_display_name(display_name);
  v1::Sequence sequence;
  EXPECT_THAT(sequences_stub().CreateSequence(&context, request, &sequence), Succeeds());
  return sequence;
}

v1::Upload RpcTest::StartUpload(const std::string& sequence, const std::map<std::string, std::string>& files) {
  grpc::ClientContext context;
  v1::StartUploadRequest request;
  request.set_parent(sequence);
  for (const auto& [path, bytes] : files) {
    v1::Upload::File* file = request.mutable_upload()->add_files();
    file->set_path(path);
    file->set_size_bytes(static_cast<int64_t>(bytes.size()));
  }
  v1::Upload upload;
  EXPECT_THAT(sequences_stub().StartUpload(&context, request, &upload), Succeeds());
  return upload;
}

grpc::Status RpcTest::WriteUpload(const std::string& upload, std::string_view bytes, int64_t offset, size_t chunk,
                                  bool finish, v1::Upload* response) {
  grpc::ClientContext context;
  const auto writer = sequences_stub().WriteUpload(&context, response);
  v1::WriteUploadRequest request;
  request.set_name(upload);
  for (size_t at = offset; at < bytes.size(); at += chunk) {
    const std::string_view data = bytes.substr(at, chunk);
    request.set_write_offset(static_cast<int64_t>(at));
    request.set_data(data.data(), data.size());
    request.set_crc32c(Crc32c(data));
    if (!writer->Write(request)) return writer->Finish();
  }
  if (finish) {
    request.clear_data();
    request.clear_crc32c();
    request.set_finish(true);
    writer->Write(request);
  }
  writer->WritesDone();
  return writer->Finish();
}

v1::Sequence RpcTest::ReadySequence(const std::string& script) {
  v1::Sequence sequence = CreateSequence();
  const v1::Upload upload = StartUpload(sequence.name(), {{"script", script}});
  v1::Upload written;
  EXPECT_THAT(WriteUpload(upload.name(), script, 0, 1 << 20, /*finish=*/true, &written), Succeeds());
  grpc::ClientContext context;
  v1::CommitSequenceRequest commit;
  commit.set_name(sequence.name());
  EXPECT_THAT(sequences_stub().CommitSequence(&context, commit, &sequence), Succeeds());
  while (sequence.state() == v1::Sequence::STATE_VALIDATING) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    grpc::ClientContext get_context;
    v1::GetSequenceRequest get;
    get.set_name(sequence.name());
    EXPECT_THAT(sequences_stub().GetSequence(&get_context, get, &sequence), Succeeds());
  }
  return sequence;
}

void RpcTest::Go(const v1::Sequence& sequence) {
  WriteText(directory().SequenceFolder(IdOf(sequence.name())) + "/go", "");
}

v1::Job RpcTest::CreateJob(const v1::Sequence& sequence) {
  grpc::ClientContext context;
  v1::CreateJobRequest request;
  request.mutable_job()->set_sequence(sequence.name());
  v1::Job job;
  EXPECT_THAT(jobs_stub().CreateJob(&context, request, &job), Succeeds());
  return job;
}

v1::Job RpcTest::GetJob(const std::string& name) {
  grpc::ClientContext context;
  v1::GetJobRequest request;
  request.set_name(name);
  v1::Job job;
  EXPECT_THAT(jobs_stub().GetJob(&context, request, &job), Succeeds());
  return job;
}

void RpcTest::ForgetChecksums(const v1::Job& job) {
  EXPECT_THAT(Take(Database::Open(directory().DatabaseFile()))
                  ->Run("DELETE FROM job_files WHERE job = (SELECT number FROM jobs WHERE id = ?)", {IdOf(job.name())}),
              IsOk());
}

v1::Job RpcTest::WaitUntilEnded(const std::string& name) {
  grpc::ClientContext context;
  v1::WatchJobRequest request;
  request.set_name(name);
  const auto reader = jobs_stub().WatchJob(&context, request);
  v1::JobEvent event;
  while (reader->Read(&event)) {
  }
  EXPECT_THAT(reader->Finish(), Succeeds());
  return GetJob(name);
}

std::string Concatenate(const std::map<std::string, std::string>& files) {
  std::string all;
  for (const auto& [path, bytes] : files) all += bytes;
  return all;
}

std::string RandomBytes(size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::string bytes(count, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

}  // namespace depthtween::server
