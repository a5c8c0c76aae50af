#include "client/cli/order.h"

#include <string>
#include <vector>

#include "proto/depthtween/documents.h"

namespace depthtween::cli {

absl::StatusOr<v1::Job> OrderOf(JobKind kind, const nlohmann::json& document) {
  ASSIGN_OR_RETURN(const std::string canonical, CanonicalJobOptions(kind, document.dump(), "options"));
  v1::Job order;
  if (kind == JobKind::kUpsample) {
    ReadDocument(canonical, order.mutable_options());
  } else {
    ReadDocument(canonical, order.mutable_scene_flow_options());
  }
  return order;
}

absl::StatusOr<std::vector<v1::RenderOptions>> RenderMessagesOf(const RenderFlags& flags,
                                                                const std::string& container) {
  ASSIGN_OR_RETURN(const std::vector<nlohmann::json> documents, RendersOf(flags, container));
  std::vector<v1::RenderOptions> renders;
  for (const nlohmann::json& document : documents) ReadDocument(document.dump(), &renders.emplace_back());
  return renders;
}

}  // namespace depthtween::cli
