#include "server/http/uploads.h"

#include <google/protobuf/empty.pb.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <boost/asio/experimental/awaitable_operators.hpp>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "depthtween/v1/sequence.pb.h"
#include "google/rpc/error_details.pb.h"
#include "proto/depthtween/crc32c.h"
#include "server/http/byte_range.h"
#include "server/http/errors.h"
#include "server/http/tus.h"

namespace depthtween::server {
namespace {

using boost::asio::awaitable;

constexpr char kStartUpload[] = "/depthtween.v1.SequenceService/StartUpload";
constexpr char kWriteUpload[] = "/depthtween.v1.SequenceService/WriteUpload";
constexpr char kDeleteUpload[] = "/depthtween.v1.SequenceService/DeleteUpload";
constexpr char kGetUpload[] = "/depthtween.v1.SequenceService/GetUpload";

// Of one message: the store's limit is four times as much, and larger ones are not faster.
constexpr size_t kUploadChunkBytes = 256 << 10;
// A body with a checksum is held until it is known to be whole: nothing of it may be kept if it is not. One body, and
// all of them together.
constexpr int64_t kMaxHeldBytes = 16 << 20;
constexpr int64_t kMaxHeldBytesTogether = 64 << 20;

// ---- errors ----

std::string ReasonOf(const google::rpc::Status& error, std::string_view key, std::string* value) {
  for (const auto& any : error.details()) {
    google::rpc::ErrorInfo info;
    if (!any.UnpackTo(&info)) continue;
    const auto found = info.metadata().find(std::string(key));
    if (found != info.metadata().end()) *value = found->second;
    return info.reason();
  }
  return "";
}

// Errors of uploads that HTTP tells apart better than google.rpc.Code does.
HttpResponse UploadError(const grpc::Status& status) {
  const google::rpc::Status error = ErrorOf(status);
  HttpResponse response = ErrorResponse(error);
  std::string committed, limit;
  const std::string reason = ReasonOf(error, "committed_size", &committed);
  if (reason == "OFFSET_MISMATCH") response.status = 409;
  if (reason == "CHECKSUM_MISMATCH") response.status = kTusChecksumMismatch;
  if (reason == "DISK_FULL") response.status = 507;
  if (ReasonOf(error, "limit", &limit) == "LIMIT_EXCEEDED" && limit == "max_sequence_bytes") response.status = 413;
  if (!committed.empty()) response.headers.emplace_back("Upload-Offset", committed);
  return response;
}

// A body that could not be read.
HttpResponse BodyError(const absl::Status& status) {
  if (absl::IsDeadlineExceeded(status)) return ErrorResponse(408, status);
  if (absl::IsResourceExhausted(status)) return ErrorResponse(413, status);
  return ErrorResponse(status);
}

HttpResponse Conflict(const v1::Upload& upload, int64_t offset) {
  const absl::Status status = absl::OutOfRangeError(absl::StrFormat(
      "the bytes begin at %d, must begin at %d, where the upload stands", offset, upload.committed_size()));
  HttpResponse response = ErrorResponse(ErrorOf(status, "OFFSET_MISMATCH"));
  response.status = 409;
  response.headers.emplace_back("Upload-Offset", absl::StrCat(upload.committed_size()));
  return response;
}

HttpResponse TooLong(int64_t size_bytes) {
  return ErrorResponse(
      413, absl::OutOfRangeError(absl::StrFormat("the body reaches beyond the %d bytes of the upload", size_bytes)));
}

awaitable<void> Answer(Exchange& exchange, HttpResponse response) {
  const absl::Status sent = co_await exchange.Respond(std::move(response));
  (void)sent;  // a client that is gone finds out by asking again
}

// Every answer of tus names the version.
awaitable<void> AnswerTus(Exchange& exchange, HttpResponse response) {
  response.headers.emplace_back("Tus-Resumable", kTusVersion);
  return Answer(exchange, std::move(response));
}

// ---- bytes on their way ----

// The bytes of a request: from its body as they come, or from one that is held.
class UploadBytes {
 public:
  explicit UploadBytes(Exchange& exchange) : exchange_(exchange) {}
  UploadBytes(Exchange& exchange, std::string held) : exchange_(exchange), held_(std::move(held)), is_held_(true) {}

  // As Exchange::ReadSome, but stops short of `size` at the end alone, so that messages are not small where a client
  // sends small pieces.
  awaitable<absl::StatusOr<size_t>> Fill(char* data, size_t size) {
    if (is_held_) {
      const size_t count = held_.copy(data, size, taken_);
      taken_ += count;
      co_return count;
    }
    size_t filled = 0;
    while (filled < size) {
      absl::StatusOr<size_t> count = co_await exchange_.ReadSome(data + filled, size - filled);
      if (!count.ok()) {
        // What came before the error is kept, and the error comes with the next call.
        if (filled == 0) co_return std::move(count).status();
        failed_ = std::move(count).status();
        break;
      }
      if (*count == 0) break;
      filled += *count;
    }
    co_return filled;
  }
  // Why the body ended early, if it did.
  const absl::Status& failed() const { return failed_; }

 private:
  Exchange& exchange_;
  const std::string held_;
  const bool is_held_ = false;
  size_t taken_ = 0;
  absl::Status failed_;
};

// How writing went. `upload` is what the server said last.
struct UploadOutcome {
  v1::Upload upload;
  absl::Status body;      // why it could not be read to its end
  bool too_long = false;  // it reaches beyond the upload; nothing beyond was written
  grpc::Status call;
};

// The messages of a call of WriteUpload, from where the upload stands to the end of the bytes.
awaitable<void> WriteMessages(RpcCall& call, const v1::Upload& upload, UploadBytes& bytes, UploadOutcome& outcome) {
  v1::WriteUploadRequest message;
  message.set_name(upload.name());
  int64_t offset = upload.committed_size();
  while (true) {
    std::string& data = *message.mutable_data();
    data.resize(kUploadChunkBytes);
    const absl::StatusOr<size_t> count = co_await bytes.Fill(data.data(), data.size());
    if (!count.ok()) {
      outcome.body = count.status();
      break;
    }
    data.resize(*count);
    const int64_t end = offset + static_cast<int64_t>(data.size());
    bool finished = false;
    if (end >= upload.size_bytes()) {
      // Only a body that ends here is the upload. One without Content-Length may go on, or break off before its end.
      char beyond = 0;
      const absl::StatusOr<size_t> more = co_await bytes.Fill(&beyond, 1);
      outcome.too_long = end > upload.size_bytes() || (more.ok() && *more > 0);
      if (outcome.too_long) break;
      if (!more.ok()) outcome.body = more.status();
      finished = more.ok() && bytes.failed().ok();
    }
    if (data.empty() && !finished) break;  // the end of the body, not of the upload
    message.set_write_offset(offset);
    message.set_finish(finished);
    message.clear_crc32c();
    if (!data.empty()) message.set_crc32c(Crc32c(data));
    const bool written = co_await call.Write(message);
    if (!written) co_return;
    message.clear_name();
    offset = end;
    if (finished || !outcome.body.ok()) break;
  }
  if (outcome.body.ok()) outcome.body = bytes.failed();
  if (!message.name().empty()) {  // the server learns the upload's name from a message, even from one without data
    message.clear_data();
    message.clear_crc32c();
    message.set_write_offset(offset);
    const bool written = co_await call.Write(message);
    if (!written) co_return;
  }
  co_await call.CloseWriting();
}

// Writes the bytes to the upload from where it stands, and finishes it with its last byte.
awaitable<UploadOutcome> WriteBytes(RpcChannel& channel, Exchange& exchange, const v1::Upload& upload,
                                    UploadBytes& bytes) {
  UploadOutcome outcome;
  RpcCall call(channel, exchange, kWriteUpload);
  // The answer is waited for from the beginning: where both sides are one process, gRPC 1.51 drops an answer that comes
  // together with its status before anybody waits for it (inproc_transport.cc, "server sent status early").
  using boost::asio::experimental::awaitable_operators::operator&&;
  const bool answered = co_await (call.Read(&outcome.upload) && WriteMessages(call, upload, bytes, outcome));
  (void)answered;  // Finish says why not
  outcome.call = co_await call.Finish();
  co_return outcome;
}

awaitable<grpc::Status> GetUpload(RpcChannel& channel, Exchange& exchange, const std::string& name,
                                  v1::Upload* upload) {
  v1::GetUploadRequest request;
  request.set_name(name);
  co_return co_await CallUnary(channel, exchange, kGetUpload, request, upload);
}

bool Reaches(const v1::Upload& upload, const HttpRequest& request) {
  const int64_t left = upload.size_bytes() - upload.committed_size();
  return request.content_length.value_or(0) > static_cast<uint64_t>(left);
}

// What is wrong with an outcome; nullopt if nothing is.
std::optional<HttpResponse> ErrorIn(const UploadOutcome& outcome) {
  if (!outcome.body.ok()) return BodyError(outcome.body);
  if (!outcome.call.ok()) return UploadError(outcome.call);
  if (outcome.too_long) return TooLong(outcome.upload.size_bytes());
  return std::nullopt;
}

HttpResponse UploadAsJson(const v1::Upload& upload) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  HttpResponse response;
  response.headers = {{"Content-Type", "application/json"},
                      {"Cache-Control", "no-store"},
                      {"Upload-Offset", absl::StrCat(upload.committed_size())}};
  if (!google::protobuf::util::MessageToJsonString(upload, &response.body, options).ok()) response.status = 500;
  return response;
}

// Memory for a body that must be held; none if that is not to be had.
class HeldBytes {
 public:
  HeldBytes(std::atomic<int64_t>& together, int64_t bytes) : together_(together), bytes_(bytes) {
    granted_ = together_.fetch_add(bytes_) + bytes_ <= kMaxHeldBytesTogether;
  }
  ~HeldBytes() { together_ -= bytes_; }
  HeldBytes(const HeldBytes&) = delete;
  HeldBytes& operator=(const HeldBytes&) = delete;
  bool granted() const { return granted_; }

 private:
  std::atomic<int64_t>& together_;
  const int64_t bytes_;
  bool granted_ = false;
};

// The body, if it has the checksum that its header promises.
struct CheckedBody {
  std::string bytes;
  std::optional<HttpResponse> error;
};
awaitable<CheckedBody> ReadChecked(Exchange& exchange, std::string header) {
  CheckedBody checked;
  const absl::StatusOr<UploadChecksum> checksum = ParseUploadChecksum(header);
  if (!checksum.ok()) {
    checked.error = ErrorResponse(checksum.status());
    co_return checked;
  }
  absl::StatusOr<std::string> body = co_await exchange.ReadBody(kMaxHeldBytes);
  if (!body.ok()) {
    checked.error = BodyError(body.status());
  } else if (!Matches(*checksum, *body)) {
    const absl::Status mismatch = absl::DataLossError(absl::StrFormat(
        "the %d bytes of the body do not have the %s of Upload-Checksum; none was kept: send them again", body->size(),
        checksum->algorithm));
    checked.error = ErrorResponse(ErrorOf(mismatch, "CHECKSUM_MISMATCH"));
    checked.error->status = kTusChecksumMismatch;
  } else {
    checked.bytes = *std::move(body);
  }
  co_return checked;
}

int64_t BytesToHold(const HttpRequest& request) {
  if (!request.Header("upload-checksum")) return 0;
  const auto most = static_cast<uint64_t>(kMaxHeldBytes);
  return static_cast<int64_t>(std::min(request.content_length.value_or(most), most));
}

HttpResponse NoMemoryToHold() {
  return ErrorResponse(503, absl::ResourceExhaustedError(
                                "too many bodies with an Upload-Checksum are on their way: send it again later"));
}

bool HasTusBody(const HttpRequest& request) {
  return SameHeader(request.Header("content-type").value_or(""), kTusContentType);
}

// 412 unless the client speaks this version.
std::optional<HttpResponse> WrongVersion(const HttpRequest& request) {
  if (request.Header("tus-resumable").value_or("") == kTusVersion) return std::nullopt;
  HttpResponse response =
      ErrorResponse(412, absl::FailedPreconditionError(absl::StrCat("the header Tus-Resumable must be ", kTusVersion)));
  response.headers.emplace_back("Tus-Version", kTusVersion);
  return response;
}

HttpResponse TusOptions() {
  HttpResponse response;
  response.status = 204;
  response.headers = {
      {"Tus-Version", kTusVersion}, {"Tus-Extension", kTusExtensions}, {"Tus-Checksum-Algorithm", kTusChecksums}};
  return response;
}

// Until when an upload is kept, if that is not for ever.
void AddExpiry(const v1::Upload& upload, HttpResponse& response) {
  if (!upload.has_expire_time()) return;
  response.headers.emplace_back("Upload-Expires", TusTime(absl::FromUnixSeconds(upload.expire_time().seconds())));
}

// What the creation of an upload asks for.
absl::StatusOr<v1::StartUploadRequest> ReadCreation(const HttpRequest& http, const std::string& parent) {
  if (http.Header("upload-defer-length")) {
    return absl::InvalidArgumentError("Upload-Defer-Length is not supported, must be left out: send Upload-Length");
  }
  const std::string length = http.Header("upload-length").value_or("");
  const std::optional<int64_t> size_bytes = ParseByteCount(length);
  if (!size_bytes) {
    return absl::InvalidArgumentError("Upload-Length must be there and be the size of the file in bytes");
  }
  ASSIGN_OR_RETURN(TusFile file, ReadTusFile(http.Header("upload-metadata").value_or("")));
  v1::StartUploadRequest request;
  request.set_parent(parent);
  request.set_request_id(file.request_id);
  request.mutable_upload()->set_metadata(http.Header("upload-metadata").value_or(""));
  v1::Upload::File* added = request.mutable_upload()->add_files();
  added->set_path(file.path);
  added->set_size_bytes(*size_bytes);
  added->set_sha256(file.sha256);
  return request;
}

}  // namespace

awaitable<void> Uploads::Put(Exchange& exchange, const FileRoute& route) {
  const HttpRequest& request = exchange.request();
  UploadRange range;
  const std::optional<std::string> header = request.Header("content-range");
  if (header) {
    absl::StatusOr<UploadRange> parsed = ParseUploadRange(*header);
    if (!parsed.ok()) co_return co_await Answer(exchange, ErrorResponse(parsed.status()));
    range = *parsed;
  }
  v1::Upload upload;
  const grpc::Status found = co_await GetUpload(channel_, exchange, route.resource, &upload);
  if (!found.ok()) co_return co_await Answer(exchange, UploadError(found));

  if (range.size_bytes && *range.size_bytes != upload.size_bytes()) {
    const absl::Status wrong = absl::InvalidArgumentError(
        absl::StrFormat("Content-Range says that there are %d bytes, StartUpload announced %d", *range.size_bytes,
                        upload.size_bytes()));
    co_return co_await Answer(exchange, ErrorResponse(wrong));
  }
  const bool is_question = header && !range.span;
  const bool is_finished = upload.state() == v1::Upload::STATE_FINISHED;
  if (is_question && request.content_length != 0) {
    const absl::Status wrong =
        absl::InvalidArgumentError("Content-Range: bytes */SIZE asks a question, must have no body");
    co_return co_await Answer(exchange, ErrorResponse(wrong));
  }
  // Where no byte is missing and only the end is, as after a kill of the server, the question ends it.
  if (is_question && (is_finished || upload.committed_size() < upload.size_bytes())) {
    co_return co_await Answer(exchange, UploadAsJson(upload));
  }
  const int64_t offset = range.span ? range.span->offset : is_question ? upload.committed_size() : 0;
  if (offset != upload.committed_size() || is_finished) {
    co_return co_await Answer(exchange, Conflict(upload, offset));
  }
  if (range.span && request.content_length.value_or(range.span->size) != static_cast<uint64_t>(range.span->size)) {
    const absl::Status wrong = absl::InvalidArgumentError(
        absl::StrFormat("Content-Range names %d bytes, the body has %d", range.span->size, *request.content_length));
    co_return co_await Answer(exchange, ErrorResponse(wrong));
  }
  const bool beyond = range.span && range.span->offset + range.span->size > upload.size_bytes();
  if (beyond || Reaches(upload, request)) co_return co_await Answer(exchange, TooLong(upload.size_bytes()));

  UploadBytes bytes(exchange);
  UploadOutcome outcome = co_await WriteBytes(channel_, exchange, upload, bytes);
  std::optional<HttpResponse> error = ErrorIn(outcome);
  if (error) co_return co_await Answer(exchange, *std::move(error));
  const int64_t end = range.span ? range.span->offset + range.span->size : upload.size_bytes();
  if (!is_question && outcome.upload.committed_size() != end) {
    const absl::Status wrong = absl::InvalidArgumentError(
        absl::StrFormat("the body ended at byte %d, must end at %d; what came was kept: go on from there",
                        outcome.upload.committed_size(), end));
    HttpResponse response = ErrorResponse(wrong);
    response.headers.emplace_back("Upload-Offset", absl::StrCat(outcome.upload.committed_size()));
    co_return co_await Answer(exchange, std::move(response));
  }
  co_await Answer(exchange, UploadAsJson(outcome.upload));
}

awaitable<void> Uploads::CreateTus(Exchange& exchange, const FileRoute& route) {
  const HttpRequest& request = exchange.request();
  if (request.method == "OPTIONS") co_return co_await AnswerTus(exchange, TusOptions());
  std::optional<HttpResponse> wrong_version = WrongVersion(request);
  if (wrong_version) co_return co_await AnswerTus(exchange, *std::move(wrong_version));
  const absl::StatusOr<v1::StartUploadRequest> start = ReadCreation(request, route.resource);
  if (!start.ok()) co_return co_await AnswerTus(exchange, ErrorResponse(start.status()));
  const v1::Upload::File& file = start->upload().files(0);
  const bool has_body = request.content_length.value_or(1) > 0;
  if (has_body && !HasTusBody(request)) {
    const absl::Status wrong =
        absl::InvalidArgumentError(absl::StrCat("a body must have Content-Type: ", kTusContentType));
    co_return co_await AnswerTus(exchange, ErrorResponse(415, wrong));
  }
  if (request.content_length.value_or(0) > static_cast<uint64_t>(file.size_bytes())) {
    const absl::Status wrong = absl::OutOfRangeError("the body is longer than Upload-Length");
    co_return co_await AnswerTus(exchange, ErrorResponse(413, wrong));
  }
  const HeldBytes memory(held_bytes_, has_body ? BytesToHold(request) : 0);
  if (!memory.granted()) co_return co_await AnswerTus(exchange, NoMemoryToHold());
  CheckedBody checked;
  const std::optional<std::string> checksum = request.Header("upload-checksum");
  if (has_body && checksum) {
    checked = co_await ReadChecked(exchange, *checksum);
    if (checked.error) co_return co_await AnswerTus(exchange, *std::move(checked.error));
  }

  v1::Upload upload;
  const grpc::Status started = co_await CallUnary(channel_, exchange, kStartUpload, *start, &upload);
  if (!started.ok()) co_return co_await AnswerTus(exchange, UploadError(started));
  HttpResponse created;
  created.status = 201;
  created.headers = {{"Location", absl::StrCat("/v1/", upload.name(), ":tus")}};
  // A creation that is repeated finds what it had sent before; a file without bytes is finished by being created.
  const bool fresh = upload.committed_size() == 0 && upload.state() == v1::Upload::STATE_RECEIVING;
  if (fresh && (has_body || upload.size_bytes() == 0)) {
    UploadBytes bytes = checksum ? UploadBytes(exchange, std::move(checked.bytes)) : UploadBytes(exchange);
    UploadOutcome outcome = co_await WriteBytes(channel_, exchange, upload, bytes);
    std::optional<HttpResponse> error = ErrorIn(outcome);
    if (error) co_return co_await AnswerTus(exchange, *std::move(error));
    upload = outcome.upload;
  }
  created.headers.emplace_back("Upload-Offset", absl::StrCat(upload.committed_size()));
  AddExpiry(upload, created);
  co_await AnswerTus(exchange, std::move(created));
}

awaitable<void> Uploads::HandleTus(Exchange& exchange, const FileRoute& route) {
  const HttpRequest& request = exchange.request();
  if (request.method == "OPTIONS") co_return co_await AnswerTus(exchange, TusOptions());
  std::optional<HttpResponse> wrong_version = WrongVersion(request);
  if (wrong_version) co_return co_await AnswerTus(exchange, *std::move(wrong_version));
  // For clients whose environment does not let them say PATCH.
  const std::string method =
      request.method == "POST" ? request.Header("x-http-method-override").value_or("POST") : request.method;
  if (method == "HEAD") co_return co_await HeadTus(exchange, route);
  if (method == "PATCH") co_return co_await PatchTus(exchange, route);
  if (method == "DELETE") co_return co_await DeleteTus(exchange, route);
  HttpResponse response =
      ErrorResponse(405, absl::UnimplementedError("an upload of tus takes HEAD, PATCH and DELETE, or POST with "
                                                  "X-HTTP-Method-Override: PATCH"));
  response.headers.emplace_back("Allow", "DELETE, HEAD, OPTIONS, PATCH, POST");
  co_await AnswerTus(exchange, std::move(response));
}

awaitable<void> Uploads::HeadTus(Exchange& exchange, const FileRoute& route) {
  v1::Upload upload;
  const grpc::Status found = co_await GetUpload(channel_, exchange, route.resource, &upload);
  if (!found.ok()) co_return co_await AnswerTus(exchange, UploadError(found));
  if (upload.state() == v1::Upload::STATE_RECEIVING && upload.committed_size() == upload.size_bytes()) {
    // The server was killed between the last byte and the end. The client will send nothing more, because nothing is
    // missing, so this is the moment to end it. Whoever may only read leaves it as it is.
    UploadBytes none(exchange, "");
    const UploadOutcome outcome = co_await WriteBytes(channel_, exchange, upload, none);
    if (!outcome.call.ok()) {
      const grpc::Status again = co_await GetUpload(channel_, exchange, route.resource, &upload);
      if (!again.ok()) co_return co_await AnswerTus(exchange, UploadError(again));
    }
  }
  HttpResponse response;
  response.headers = {{"Upload-Offset", absl::StrCat(upload.committed_size())},
                      {"Upload-Length", absl::StrCat(upload.size_bytes())},
                      {"Cache-Control", "no-store"}};
  AddExpiry(upload, response);
  if (!upload.metadata().empty()) response.headers.emplace_back("Upload-Metadata", upload.metadata());
  co_await AnswerTus(exchange, std::move(response));
}

awaitable<void> Uploads::DeleteTus(Exchange& exchange, const FileRoute& route) {
  v1::DeleteUploadRequest request;
  request.set_name(route.resource);
  google::protobuf::Empty nothing;
  const grpc::Status deleted = co_await CallUnary(channel_, exchange, kDeleteUpload, request, &nothing);
  HttpResponse response;
  response.status = 204;
  if (!deleted.ok()) response = UploadError(deleted);
  if (deleted.error_code() == grpc::StatusCode::FAILED_PRECONDITION) response.status = 409;
  co_await AnswerTus(exchange, std::move(response));
}

awaitable<void> Uploads::PatchTus(Exchange& exchange, const FileRoute& route) {
  const HttpRequest& request = exchange.request();
  if (!HasTusBody(request)) {
    const absl::Status wrong = absl::InvalidArgumentError(absl::StrCat("Content-Type must be ", kTusContentType));
    co_return co_await AnswerTus(exchange, ErrorResponse(415, wrong));
  }
  const std::optional<int64_t> offset = ParseByteCount(request.Header("upload-offset").value_or(""));
  if (!offset) {
    const absl::Status wrong =
        absl::InvalidArgumentError("Upload-Offset must be there and be the position of the body's first byte");
    co_return co_await AnswerTus(exchange, ErrorResponse(wrong));
  }
  v1::Upload upload;
  const grpc::Status found = co_await GetUpload(channel_, exchange, route.resource, &upload);
  if (!found.ok()) co_return co_await AnswerTus(exchange, UploadError(found));
  if (*offset != upload.committed_size()) co_return co_await AnswerTus(exchange, Conflict(upload, *offset));
  if (Reaches(upload, request)) co_return co_await AnswerTus(exchange, TooLong(upload.size_bytes()));

  const HeldBytes memory(held_bytes_, BytesToHold(request));
  if (!memory.granted()) co_return co_await AnswerTus(exchange, NoMemoryToHold());
  CheckedBody checked;
  const std::optional<std::string> checksum = request.Header("upload-checksum");
  if (checksum) {
    checked = co_await ReadChecked(exchange, *checksum);
    if (checked.error) co_return co_await AnswerTus(exchange, *std::move(checked.error));
  }
  HttpResponse response;
  response.status = 204;
  if (upload.state() == v1::Upload::STATE_RECEIVING) {
    UploadBytes bytes = checksum ? UploadBytes(exchange, std::move(checked.bytes)) : UploadBytes(exchange);
    UploadOutcome outcome = co_await WriteBytes(channel_, exchange, upload, bytes);
    std::optional<HttpResponse> error = ErrorIn(outcome);
    if (error) co_return co_await AnswerTus(exchange, *std::move(error));
    upload = outcome.upload;
  }
  response.headers = {{"Upload-Offset", absl::StrCat(upload.committed_size())}};
  AddExpiry(upload, response);
  co_await AnswerTus(exchange, std::move(response));
}

}  // namespace depthtween::server
