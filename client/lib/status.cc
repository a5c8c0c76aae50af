#include "client/lib/status.h"

#include <cerrno>
#include <string>
#include <system_error>

#include "absl/strings/cord.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "google/rpc/error_details.pb.h"

namespace depthtween::client {
namespace {

// Of ErrorInfo, on the absl::Status.
constexpr char kReasonPayload[] = "depthtween/reason";
constexpr char kFramePayload[] = "depthtween/frame";

// Adds "; field: description" for every violation that `message` does not mention yet.
void AppendFieldViolations(const google::rpc::Status& details, std::string& message) {
  for (const google::protobuf::Any& detail : details.details()) {
    google::rpc::BadRequest bad_request;
    if (!detail.UnpackTo(&bad_request)) continue;
    for (const auto& violation : bad_request.field_violations()) {
      if (message.find(violation.description()) != std::string::npos) continue;
      absl::StrAppend(&message, "; ", violation.field(), ": ", violation.description());
    }
  }
}

}  // namespace

absl::Status FromRpc(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  std::string message = status.error_message();
  google::rpc::Status details;
  if (details.ParseFromString(status.error_details())) AppendFieldViolations(details, message);
  absl::Status result(static_cast<absl::StatusCode>(status.error_code()), message);
  for (const google::protobuf::Any& detail : details.details()) {
    google::rpc::ErrorInfo info;
    if (!detail.UnpackTo(&info)) continue;
    result.SetPayload(kReasonPayload, absl::Cord(info.reason()));
    const auto frame = info.metadata().find("frame");
    if (frame != info.metadata().end()) result.SetPayload(kFramePayload, absl::Cord(frame->second));
  }
  return result;
}

bool IsTransient(const absl::Status& status) {
  return absl::IsUnavailable(status) || status.GetPayload(kReasonPayload) == absl::Cord("SERVER_BUSY");
}

bool IsLost(const absl::Status& status) {
  const auto reason = status.GetPayload(kReasonPayload);
  return reason == absl::Cord("FILE_LOST") || reason == absl::Cord("FILE_DAMAGED");
}

std::optional<int> LostFrame(const absl::Status& status) {
  if (!IsLost(status)) return std::nullopt;
  const auto text = status.GetPayload(kFramePayload);
  int frame = 0;
  if (!text || !absl::SimpleAtoi(std::string(*text), &frame) || frame < 0) return std::nullopt;
  return frame;
}

absl::Status FromProto(const google::rpc::Status& status) {
  return absl::Status(static_cast<absl::StatusCode>(status.code()), status.message());
}

absl::Status ErrnoStatus(int error_number, std::string_view what) {
  absl::StatusCode code = absl::StatusCode::kInternal;
  if (error_number == ENOENT || error_number == ENOTDIR) code = absl::StatusCode::kNotFound;
  if (error_number == ENOSPC || error_number == EDQUOT || error_number == EFBIG) {
    code = absl::StatusCode::kResourceExhausted;
  }
  if (error_number == EACCES || error_number == EPERM || error_number == EROFS) {
    code = absl::StatusCode::kPermissionDenied;
  }
  return absl::Status(code, absl::StrCat(absl::string_view(what.data(), what.size()), ": ",
                                         std::generic_category().message(error_number)));
}

}  // namespace depthtween::client
