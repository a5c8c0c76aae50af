#include "server/http/downloads.h"

#include <limits>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "proto/depthtween/sha256.h"
#include "server/http/download_plan.h"
#include "server/http/errors.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

using boost::asio::awaitable;

constexpr char kGetJob[] = "/depthtween.v1.JobService/GetJob";
constexpr char kListOutputs[] = "/depthtween.v1.OutputService/ListOutputs";
constexpr char kStreamFrames[] = "/depthtween.v1.OutputService/StreamFrames";
constexpr char kReadOutput[] = "/depthtween.v1.OutputService/ReadOutput";

// What a job that SUCCEEDED has made never changes.
constexpr char kForEver[] = "private, max-age=31536000, immutable";
constexpr char kAskAgain[] = "private, no-cache";

std::string JobOf(const std::string& output) { return output.substr(0, output.find("/outputs/")); }

// Strong: a job that SUCCEEDED is never run again, and everything it made was complete before it ended. So its bytes
// are the same exactly as long as these facts are; another run, or another server with a job of the same name, ends at
// another time. Hashes of gigabytes would say no more.
std::string TagOfResult(std::string_view what, const v1::Job& job, const std::string& output, int64_t size) {
  Sha256 hash;
  hash.Update(absl::StrFormat("%s|%s|%d|%d.%09d|%d", std::string(what), output, job.attempt(), job.end_time().seconds(),
                              job.end_time().nanos(), size));
  return absl::StrCat("\"", Hex(hash.Finish().substr(0, 16)), "\"");
}

google::rpc::Status NoSuchFrame(const v1::Job& job, const FileRoute& route) {
  const int total = job.progress().frames_total();
  const bool beyond = total > 0 && route.frame >= total;
  return ErrorOf(
      absl::NotFoundError(beyond ? absl::StrFormat("there is no frame %d of %s: the job has %d, counted from 0",
                                                   route.frame, route.resource, total)
                                 : absl::StrFormat("frame %d of %s is not stored yet: follow the job by :watch",
                                                   route.frame, route.resource)),
      beyond ? "NO_SUCH_FRAME" : "FRAME_NOT_READY");
}

// The same error as one of a resource that is not there: over HTTP frame and encoding are part of its name.
HttpResponse AsNotFound(const grpc::Status& status) {
  google::rpc::Status error = ErrorOf(status);
  error.set_code(static_cast<int>(grpc::NOT_FOUND));
  return ErrorResponse(error);
}

awaitable<void> SendError(Exchange& exchange, HttpResponse response) {
  const absl::Status sent = co_await exchange.Respond(std::move(response));
  (void)sent;  // a client that is gone does not read errors
}

// The head of the answer. True if bytes are to follow; else the answer is complete.
awaitable<bool> Begin(Exchange& exchange, const DownloadPlan& plan) {
  if (!plan.sends_body && plan.status != 200) {
    HttpResponse response;
    response.status = plan.status;
    if (plan.status == 412) {
      response = ErrorResponse(412, absl::FailedPreconditionError("If-Match does not list what is here now"));
    } else if (plan.status == 416) {
      response = ErrorResponse(416, absl::OutOfRangeError("Range names no byte that is here: see Content-Range"));
    }
    response.headers.insert(response.headers.end(), plan.headers.begin(), plan.headers.end());
    co_await SendError(exchange, std::move(response));
    co_return false;
  }
  std::optional<uint64_t> length;
  if (plan.content_length) length = static_cast<uint64_t>(*plan.content_length);
  const absl::Status begun = co_await exchange.StartBody(plan.status, plan.headers, length);
  if (!begun.ok()) co_return false;
  if (plan.sends_body) co_return true;
  const absl::Status ended = co_await exchange.End();
  (void)ended;
  co_return false;
}

void LogCut(const std::string& resource, std::string_view why) {
  LogWarning("download_cut", {{"resource", resource}, {"error", std::string(why)}});
}

// The frames from `start` to the last, as messages.
v1::StreamFramesRequest FramesFrom(const std::string& output, int start) {
  v1::StreamFramesRequest request;
  request.set_name(output);
  request.set_start_frame(start);
  return request;
}

const v1::Output* FindOutput(const v1::ListOutputsResponse& outputs, const std::string& name) {
  for (const v1::Output& output : outputs.outputs()) {
    if (output.name() == name) return &output;
  }
  return nullptr;
}

// A job and its outputs.
struct JobAndOutputs {
  v1::Job job;
  v1::ListOutputsResponse outputs;
};

awaitable<grpc::Status> Look(RpcChannel& channel, Exchange& exchange, const std::string& output, JobAndOutputs* found) {
  v1::GetJobRequest get;
  get.set_name(JobOf(output));
  grpc::Status status = co_await CallUnary(channel, exchange, kGetJob, get, &found->job);
  if (!status.ok()) co_return status;
  v1::ListOutputsRequest list;
  list.set_parent(get.name());
  status = co_await CallUnary(channel, exchange, kListOutputs, list, &found->outputs);
  co_return status;
}

std::string_view BaseName(std::string_view path) {
  const size_t slash = path.rfind('/');
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

// Reads all frames for the layout of their archive.
awaitable<absl::StatusOr<ArchiveLayout>> MeasureArchive(RpcChannel& channel, Exchange& exchange,
                                                        const std::string& output, const std::string& folder,
                                                        grpc::Status* failure) {
  ArchiveBuilder builder(folder);
  RpcCall call(channel, exchange, kStreamFrames);
  const v1::StreamFramesRequest request = FramesFrom(output, 0);
  co_await call.WriteLast(request);
  v1::FrameChunk chunk;
  while (co_await call.Read(&chunk)) {
    CO_RETURN_IF_ERROR(builder.Add(chunk).status());
  }
  *failure = co_await call.Finish();
  co_return builder.TakeLayout();
}

// The parts of a representation that are wanted, to the client.
class WindowSender {
 public:
  WindowSender(Exchange& exchange, ByteWindow window) : exchange_(exchange), window_(window) {}

  awaitable<absl::Status> Send(std::string_view bytes) {
    const std::string_view wanted = window_.Cut(bytes);
    if (wanted.empty()) co_return absl::OkStatus();
    co_return co_await exchange_.Write(wanted);
  }
  bool full() const { return window_.full(); }

 private:
  Exchange& exchange_;
  ByteWindow window_;
};

// Sends what is wanted of the bytes that a call streams, from `chunk` on, its message that was read last, and ends the
// answer. Not `more`: there is no such message, and nothing is wanted.
template <typename Chunk>
awaitable<void> SendBytes(Exchange& exchange, RpcCall* call, Chunk& chunk, bool more, ByteWindow window,
                          const std::string& resource) {
  WindowSender sender(exchange, window);
  while (more && !sender.full()) {
    const absl::Status sent = co_await sender.Send(chunk.data());
    if (!sent.ok()) co_return;
    more = co_await call->Read(&chunk);  // also behind the last one, so that the call ends well
  }
  if (!sender.full()) co_return LogCut(resource, "it ended before its last byte");
  const absl::Status ended = co_await exchange.End();
  (void)ended;
}

// Central headers are gathered, because each has but a hundred bytes.
awaitable<absl::Status> SendDirectory(WindowSender& sender, const ZipIndex& index) {
  constexpr size_t kGatheredBytes = 64 << 10;
  std::string gathered;
  for (const ZipIndex::Entry& entry : index.entries()) {
    gathered += index.CentralHeader(entry);
    if (gathered.size() < kGatheredBytes) continue;
    CO_RETURN_IF_ERROR(co_await sender.Send(gathered));
    gathered.clear();
  }
  gathered += index.End();
  co_return co_await sender.Send(gathered);
}

// Whether that entry of the index is this file.
bool IsEntry(const ZipIndex& index, size_t place, const ZipIndex::Entry& file) {
  if (place >= index.entries().size()) return false;
  const ZipIndex::Entry& entry = index.entries()[place];
  return entry.name == file.name && entry.size_bytes == file.size_bytes && entry.crc32 == file.crc32;
}

}  // namespace

awaitable<void> Downloads::SendFrame(Exchange& exchange, const FileRoute& route) {
  v1::GetJobRequest get;
  get.set_name(JobOf(route.resource));
  v1::Job job;
  grpc::Status status = co_await CallUnary(channel_, exchange, kGetJob, get, &job);
  if (!status.ok()) co_return co_await SendError(exchange, ErrorResponse(status));

  RpcCall call(channel_, exchange, kStreamFrames);
  v1::StreamFramesRequest request = FramesFrom(route.resource, route.frame);
  request.set_end_frame(route.frame + 1);
  request.set_encoding(route.encoding);
  co_await call.WriteLast(request);
  v1::FrameChunk chunk;
  bool more = co_await call.Read(&chunk);
  if (!more) {
    status = co_await call.Finish();
    const bool of_the_name = status.error_code() == grpc::OUT_OF_RANGE || status.error_code() == grpc::INVALID_ARGUMENT;
    HttpResponse error = status.ok()   ? ErrorResponse(NoSuchFrame(job, route))
                         : of_the_name ? AsNotFound(status)
                                       : ErrorResponse(status);
    co_return co_await SendError(exchange, std::move(error));
  }
  const int64_t size_bytes = chunk.header().size_bytes();
  if (size_bytes == 0) {
    const absl::Status nothing = absl::NotFoundError(absl::StrFormat(
        "%s has nothing to give for frame %d: scene flow lies between two frames", route.resource, route.frame));
    co_return co_await SendError(exchange, ErrorResponse(ErrorOf(nothing, "NO_SUCH_FRAME")));
  }
  const std::string file_name = absl::StrCat(chunk.header().stem(), std::string(ExtensionOf(route.encoding)));
  // Size and checksum of the bytes themselves, which came with their first piece.
  const Representation representation = {
      .content_type = std::string(ContentTypeOf(file_name)),
      .etag = absl::StrFormat("\"%08x-%x\"", chunk.header().crc32c(), size_bytes),
      .cache_control = job.state() == v1::Job::STATE_SUCCEEDED ? kForEver : kAskAgain,
      .disposition = Disposition("inline", file_name),
      .size_bytes = size_bytes};
  const DownloadPlan plan = PlanDownload(exchange.request(), representation);
  const bool begun = co_await Begin(exchange, plan);
  if (!begun) co_return;
  const ByteWindow window(plan.span.offset, plan.span.size);
  co_await SendBytes(exchange, &call, chunk, more, window, route.resource);
}

awaitable<void> Downloads::SendFile(Exchange& exchange, const FileRoute& route) {
  JobAndOutputs found;
  grpc::Status status = co_await Look(channel_, exchange, route.resource, &found);
  if (!status.ok()) co_return co_await SendError(exchange, ErrorResponse(status));
  const v1::Output* output = FindOutput(found.outputs, route.resource);
  std::optional<RpcCall> call;
  v1::ReadOutputRequest request;
  request.set_name(route.resource);
  v1::ReadOutputResponse chunk;
  if (output == nullptr || !output->ready()) {
    // ReadOutput knows best why it cannot be had.
    call.emplace(channel_, exchange, kReadOutput);
    co_await call->WriteLast(request);
    co_await call->Read(&chunk);
    call->Cancel();
    status = co_await call->Finish();
    if (status.ok() || status.error_code() == grpc::CANCELLED) {
      status = {grpc::UNAVAILABLE, absl::StrCat(route.resource, " has only just become ready: ask again")};
    }
    co_return co_await SendError(exchange, ErrorResponse(status));
  }
  const int64_t size_bytes = output->size_bytes();
  const std::string file_name(BaseName(output->file_name()));
  const Representation representation = {.content_type = std::string(ContentTypeOf(file_name)),
                                         .etag = TagOfResult("file", found.job, route.resource, size_bytes),
                                         .cache_control = kForEver,
                                         .disposition = Disposition("attachment", file_name),
                                         .size_bytes = size_bytes};
  const DownloadPlan plan = PlanDownload(exchange.request(), representation);
  bool more = false;
  if (plan.sends_body && plan.span.size > 0) {
    // The first message before the first byte of the answer: a lost file shall be an error and not a cut connection.
    request.set_read_offset(plan.span.offset);
    request.set_read_limit(plan.span.size);
    call.emplace(channel_, exchange, kReadOutput);
    co_await call->WriteLast(request);
    more = co_await call->Read(&chunk);
    if (!more || chunk.size_bytes() != size_bytes) {
      if (more) call->Cancel();
      status = co_await call->Finish();
      if (more || status.ok()) {
        status = {grpc::DATA_LOSS, absl::StrCat(route.resource, " has changed while it was being read")};
      }
      co_return co_await SendError(exchange, ErrorResponse(status));
    }
  }
  const bool begun = co_await Begin(exchange, plan);
  if (!begun) co_return;
  const ByteWindow window(0, plan.span.size);  // the call was told where to begin
  co_await SendBytes(exchange, call ? &*call : nullptr, chunk, more, window, route.resource);
}

awaitable<void> Downloads::SendArchive(Exchange& exchange, const FileRoute& route) {
  JobAndOutputs found;
  grpc::Status status = co_await Look(channel_, exchange, route.resource, &found);
  if (!status.ok()) co_return co_await SendError(exchange, ErrorResponse(status));
  if (found.job.state() != v1::Job::STATE_SUCCEEDED) {
    const absl::Status wrong = absl::FailedPreconditionError(
        absl::StrFormat("%s.zip can be read once the job has SUCCEEDED, it is %s; single frames can be read now",
                        route.resource, v1::Job::State_Name(found.job.state())));
    co_return co_await SendError(exchange, ErrorResponse(ErrorOf(wrong, "WRONG_STATE")));
  }
  const v1::Output* output = FindOutput(found.outputs, route.resource);
  if (output == nullptr || output->kind() != v1::Output::KIND_FRAMES) {
    const absl::Status wrong = output == nullptr
                                   ? absl::NotFoundError(absl::StrCat("there is no output ", route.resource))
                                   : absl::FailedPreconditionError(absl::StrCat(
                                         route.resource, " is one file: GET /v1/", route.resource, ":download"));
    co_return co_await SendError(exchange,
                                 ErrorResponse(ErrorOf(wrong, output == nullptr ? "NO_SUCH_RESOURCE" : "NOT_FRAMES")));
  }
  const std::string folder = output->file_name();
  Representation representation = {.content_type = "application/zip",
                                   .etag = TagOfResult("zip", found.job, route.resource, output->frame_count()),
                                   .cache_control = kForEver,
                                   .disposition = Disposition("attachment", absl::StrCat(folder, ".zip"))};
  std::shared_ptr<const ArchiveLayout> known = layouts_.Find(representation.etag);
  if (known == nullptr && WantsRange(exchange.request(), representation.etag)) {
    absl::StatusOr<ArchiveLayout> measured =
        co_await MeasureArchive(channel_, exchange, route.resource, folder, &status);
    if (measured.ok() && status.ok() && measured->next_frame < output->frame_count()) {
      measured = absl::DataLossError(absl::StrFormat("%s has %d frames, the job made %d", route.resource,
                                                     measured->next_frame, output->frame_count()));
    }
    if (!status.ok()) co_return co_await SendError(exchange, ErrorResponse(status));
    if (!measured.ok()) co_return co_await SendError(exchange, ErrorResponse(measured.status()));
    known = std::make_shared<const ArchiveLayout>(*std::move(measured));
    layouts_.Keep(representation.etag, known);
  }
  if (known != nullptr) representation.size_bytes = known->index.size_bytes();
  const DownloadPlan plan = PlanDownload(exchange.request(), representation);
  const bool begun = co_await Begin(exchange, plan);
  if (!begun) co_return;

  // From the file that holds the first byte wanted; the window drops what lies before it.
  size_t entry = 0;
  int64_t offset = 0;
  int start_frame = 0;
  if (known != nullptr && plan.span.offset > 0) {
    const std::vector<ZipIndex::Entry>& entries = known->index.entries();
    entry = known->index.EntryAt(plan.span.offset);
    offset = entry < entries.size() ? entries[entry].offset : known->index.directory_offset();
    start_frame = entry < entries.size() ? known->frames[entry] : known->next_frame;
  }
  constexpr int64_t kAll = std::numeric_limits<int64_t>::max();
  WindowSender sender(exchange, ByteWindow(plan.span.offset - offset, plan.content_length ? plan.span.size : kAll));
  ArchiveBuilder builder(folder);
  if (start_frame < output->frame_count()) {
    RpcCall call(channel_, exchange, kStreamFrames);
    const v1::StreamFramesRequest request = FramesFrom(route.resource, start_frame);
    co_await call.WriteLast(request);
    v1::FrameChunk chunk;
    while (!sender.full()) {
      const bool more = co_await call.Read(&chunk);
      if (!more) break;
      absl::StatusOr<ArchiveBuilder::Piece> piece = builder.Add(chunk);
      if (!piece.ok()) co_return LogCut(route.resource, std::string(piece.status().message()));
      const std::vector<ZipIndex::Entry>& added = builder.layout().index.entries();
      if (known != nullptr && !piece->after.empty() && !IsEntry(known->index, entry + added.size() - 1, added.back())) {
        co_return LogCut(route.resource, "a frame has changed since the archive's layout was read");
      }
      absl::Status sent = co_await sender.Send(piece->before);
      if (sent.ok()) sent = co_await sender.Send(piece->data);
      if (sent.ok()) sent = co_await sender.Send(piece->after);
      if (!sent.ok()) co_return;
    }
    if (!sender.full()) {
      status = co_await call.Finish();
      if (!status.ok()) co_return LogCut(route.resource, status.error_message());
      if (builder.layout().next_frame < output->frame_count()) {
        co_return LogCut(route.resource, "a frame is missing");
      }
    }
  }
  if (!sender.full()) {
    if (known == nullptr) {
      known = std::make_shared<const ArchiveLayout>(builder.TakeLayout());
      layouts_.Keep(representation.etag, known);
    }
    const absl::Status sent = co_await SendDirectory(sender, known->index);
    if (!sent.ok()) co_return;
  }
  const absl::Status ended = co_await exchange.End();
  (void)ended;
}

}  // namespace depthtween::server
