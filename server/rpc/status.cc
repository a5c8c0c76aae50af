#include "server/rpc/status.h"

#include <google/protobuf/stubs/common.h>

#include <optional>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "google/rpc/error_details.pb.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr int kStoppingRetrySeconds = 1;    // a restart takes about that
constexpr int kBusyRetrySeconds = 2;        // calls are short, streams end
constexpr int kQueueFullRetrySeconds = 30;  // a place is free when a job ends
constexpr int kDiskFullRetrySeconds = 60;   // somebody has to make room

// Seconds after which trying again may help; nullopt if it will not.
std::optional<int> RetrySeconds(absl::StatusCode code, const ErrorInfo& info) {
  if (info.reason == "SERVER_BUSY") return kBusyRetrySeconds;
  if (info.reason == "DISK_FULL") return kDiskFullRetrySeconds;
  const auto limit = info.metadata.find("limit");
  if (limit != info.metadata.end()) {
    if (limit->second == "max_calls_per_second") return kBusyRetrySeconds;
    if (limit->second == "max_queued_jobs" || limit->second == "max_tenant_queued_jobs") return kQueueFullRetrySeconds;
  }
  if (code == absl::StatusCode::kUnavailable) return kStoppingRetrySeconds;
  return std::nullopt;
}

std::string ResourceType(std::string_view name) {
  if (name.find("/uploads/") != std::string_view::npos) return "depthtween/Upload";
  if (name.find("/outputs/") != std::string_view::npos) return "depthtween/Output";
  if (name.rfind("sequences/", 0) == 0) return "depthtween/Sequence";
  if (name.rfind("jobs/", 0) == 0) return "depthtween/Job";
  return "depthtween/File";
}

// Messages quote what clients and children said; a string field of protobuf must be UTF-8 or the client cannot read it.
std::string Readable(std::string_view message) {
  std::string text(message);
  if (google::protobuf::internal::IsStructurallyValidUTF8(text.data(), static_cast<int>(text.size()))) return text;
  return absl::CHexEscape(text);
}

std::string Metadata(const ErrorInfo& info, const std::string& key, const std::string& otherwise) {
  const auto found = info.metadata.find(key);
  return found == info.metadata.end() ? otherwise : found->second;
}

}  // namespace

google::rpc::Status ToRpcStatus(const absl::Status& status, const CallNames& names) {
  google::rpc::Status result;
  if (status.ok()) return result;
  const std::string message = Readable({status.message().data(), status.message().size()});
  result.set_code(static_cast<int>(status.code()));
  result.set_message(message);

  const ErrorInfo info = GetErrorInfo(status).value_or(
      ErrorInfo{.reason = std::string(absl::StatusCodeToString(status.code())), .metadata = {}});
  google::rpc::ErrorInfo error_info;
  error_info.set_reason(info.reason);
  error_info.set_domain(kErrorDomain);
  for (const auto& [key, value] : info.metadata) (*error_info.mutable_metadata())[key] = Readable(value);
  result.add_details()->PackFrom(error_info);

  const std::string subject = Readable(Metadata(info, "resource", names.subject));
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
      if (info.metadata.count("field") != 0) {
        google::rpc::BadRequest bad_request;
        auto* violation = bad_request.add_field_violations();
        violation->set_field(Readable(info.metadata.at("field")));
        violation->set_description(message);
        result.add_details()->PackFrom(bad_request);
      }
      break;
    case absl::StatusCode::kNotFound: {
      google::rpc::ResourceInfo resource;
      resource.set_resource_type(ResourceType(subject));
      resource.set_resource_name(subject);
      resource.set_description(message);
      result.add_details()->PackFrom(resource);
      break;
    }
    case absl::StatusCode::kFailedPrecondition: {
      google::rpc::PreconditionFailure failure;
      auto* violation = failure.add_violations();
      violation->set_type(info.reason);
      violation->set_subject(subject);
      violation->set_description(message);
      result.add_details()->PackFrom(failure);
      break;
    }
    case absl::StatusCode::kResourceExhausted: {
      google::rpc::QuotaFailure failure;
      auto* violation = failure.add_violations();
      violation->set_subject(Metadata(info, "limit", info.reason));
      violation->set_description(message);
      result.add_details()->PackFrom(failure);
      break;
    }
    default:
      break;
  }
  if (const std::optional<int> seconds = RetrySeconds(status.code(), info)) {
    google::rpc::RetryInfo retry;
    retry.mutable_retry_delay()->set_seconds(*seconds);
    result.add_details()->PackFrom(retry);
  }
  if (!names.request_id.empty()) {
    google::rpc::RequestInfo request;
    request.set_request_id(names.request_id);
    result.add_details()->PackFrom(request);
  }
  return result;
}

grpc::Status ToGrpcStatus(const absl::Status& status, const CallNames& names) {
  if (status.ok()) return grpc::Status::OK;
  const google::rpc::Status details = ToRpcStatus(status, names);
  return {static_cast<grpc::StatusCode>(details.code()), details.message(), details.SerializeAsString()};
}

}  // namespace depthtween::server
