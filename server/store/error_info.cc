#include "server/store/error_info.h"

#include <utility>

#include "nlohmann/json.hpp"

namespace depthtween::server {
namespace {

constexpr char kPayloadType[] = "depthtween/error-info";

}  // namespace

absl::Status WithErrorInfo(absl::Status status, const ErrorInfo& info) {
  const nlohmann::json json = {{"reason", info.reason}, {"metadata", info.metadata}};
  // A path in the metadata may hold any bytes: what is not UTF-8 is replaced, where dump() would throw.
  status.SetPayload(kPayloadType, absl::Cord(json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)));
  return status;
}

std::optional<ErrorInfo> GetErrorInfo(const absl::Status& status) {
  const auto payload = status.GetPayload(kPayloadType);
  if (!payload) return std::nullopt;
  const auto json = nlohmann::json::parse(std::string(*payload));
  return ErrorInfo{.reason = json.at("reason"), .metadata = json.at("metadata")};
}

absl::Status BadField(std::string_view field, std::string_view message) {
  return WithErrorInfo(absl::InvalidArgumentError(View(message)),
                       {.reason = "BAD_FIELD", .metadata = {{"field", std::string(field)}}});
}

absl::Status InvalidField(std::string_view field, std::string_view why) {
  return BadField(field, absl::StrCat(std::string(field), " ", std::string(why)));
}

absl::Status NoSuchResource(std::string_view resource) {
  return WithErrorInfo(absl::NotFoundError(absl::StrCat("there is no ", View(resource))),
                       {.reason = "NO_SUCH_RESOURCE", .metadata = {{"resource", std::string(resource)}}});
}

absl::Status WrongState(std::string_view state, std::string_view message) {
  return WithErrorInfo(absl::FailedPreconditionError(View(message)),
                       {.reason = "WRONG_STATE", .metadata = {{"state", std::string(state)}}});
}

absl::Status LimitExceeded(std::string_view limit, int64_t maximum, std::string_view message) {
  return WithErrorInfo(
      absl::ResourceExhaustedError(View(message)),
      {.reason = "LIMIT_EXCEEDED", .metadata = {{"limit", std::string(limit)}, {"maximum", absl::StrCat(maximum)}}});
}

absl::Status ServerStopping() {
  return WithErrorInfo(
      absl::UnavailableError("the server is stopping; finished work is kept, try again when it is back"),
      {.reason = "SERVER_STOPPING"});
}

absl::Status ServerBusy(std::string_view why) {
  return WithErrorInfo(absl::ResourceExhaustedError(View(why)), {.reason = "SERVER_BUSY"});
}

namespace {

absl::Status Lost(std::string_view resource, int frame, const std::string& what) {
  ErrorInfo info = {.reason = "FILE_LOST", .metadata = {{"resource", std::string(resource)}}};
  if (frame >= 0) info.metadata["frame"] = absl::StrCat(frame);
  return WithErrorInfo(
      absl::DataLossError(absl::StrCat(what,
                                       " was made, but its file is lost from the server's disk; delete the job and "
                                       "create it again")),
      info);
}

}  // namespace

absl::Status FileLost(std::string_view output, int frame) {
  return Lost(output, frame, absl::StrCat(frame >= 0 ? absl::StrCat("frame ", frame, " of ") : "", View(output)));
}

absl::Status FileOfJobLost(std::string_view job, std::string_view what, int frame) {
  return Lost(job, frame, absl::StrCat("the ", View(what), " of frame ", frame, " of ", View(job)));
}

absl::Status FileDamaged(std::string_view resource, std::string_view file, int frame) {
  ErrorInfo info = {.reason = "FILE_DAMAGED",
                    .metadata = {{"resource", std::string(resource)}, {"file", std::string(file)}}};
  if (frame >= 0) info.metadata["frame"] = absl::StrCat(frame);
  return WithErrorInfo(
      absl::DataLossError(absl::StrCat(frame >= 0 ? absl::StrCat("frame ", frame, " of ") : "", View(resource),
                                       ": the bytes of ", View(file), " are no longer those that were stored; restore ",
                                       "them from a backup, or delete it and create it again")),
      info);
}

absl::Status DiskFull(std::string_view message) {
  return WithErrorInfo(
      absl::ResourceExhaustedError(
          absl::StrCat("the server's disk is full, delete old jobs and sequences or try again later: ", View(message))),
      {.reason = "DISK_FULL"});
}

}  // namespace depthtween::server
