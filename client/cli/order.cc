#include "client/cli/order.h"

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/depthtween/documents.h"

namespace depthtween::cli {
namespace {

absl::Status Read(const std::string& document, google::protobuf::Message* message) {
  if (ReadDocument(document, message)) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(message->GetTypeName(), " cannot carry ", document));
}

}  // namespace

absl::StatusOr<v1::Job> OrderOf(JobKind kind, const nlohmann::json& document) {
  ASSIGN_OR_RETURN(const std::string canonical, CanonicalJobOptions(kind, document.dump(), "options"));
  v1::Job order;
  if (kind == JobKind::kUpsample) {
    RETURN_IF_ERROR(Read(canonical, order.mutable_options()));
  } else {
    RETURN_IF_ERROR(Read(canonical, order.mutable_scene_flow_options()));
  }
  return order;
}

absl::StatusOr<std::vector<v1::RenderOptions>> RenderMessagesOf(const RenderFlags& flags,
                                                                const std::string& container) {
  ASSIGN_OR_RETURN(const std::vector<nlohmann::json> documents, RendersOf(flags, container));
  std::vector<v1::RenderOptions> renders;
  for (const nlohmann::json& document : documents) RETURN_IF_ERROR(Read(document.dump(), &renders.emplace_back()));
  return renders;
}

}  // namespace depthtween::cli
