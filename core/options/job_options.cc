#include "core/options/job_options.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/options/field_error.h"
#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"

namespace depthtween {
namespace {

using nlohmann::json;

json ParseText(std::string_view text) { return json::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false); }

// A job always writes NPZ, from which its preview is drawn. Formats are in their own order, each once.
void SettleFormats(SceneFlowOrder& order) {
  std::vector<std::string> formats;
  for (const std::string& format : SceneFlowFormats())
    if (format == "npz" || std::count(order.formats.begin(), order.formats.end(), format) > 0)
      formats.push_back(format);
  order.formats = std::move(formats);
}

struct FormatFiles {
  const char* format;
  FrameFiles files;
};
const std::vector<FormatFiles>& FilesOfFormats() {
  static const auto* const kFiles = new std::vector<FormatFiles>{
      {"npz", {"sceneflow", "sceneflow", "npz"}},         {"flo", {"flow", "flow", "flo"}},
      {"flo", {"depth_change", "depth_change", "pfm"}},   {"kitti", {"kitti-flow", "kitti/flow", "png"}},
      {"kitti", {"kitti-disp_0", "kitti/disp_0", "png"}}, {"kitti", {"kitti-disp_1", "kitti/disp_1", "png"}}};
  return *kFiles;
}

}  // namespace

absl::StatusOr<std::string> CanonicalJobOptions(JobKind kind, std::string_view document, const std::string& path) {
  const json value = ParseText(document);
  if (value.is_discarded()) return FieldError(path, "must be a JSON object");
  if (kind == JobKind::kUpsample) {
    ASSIGN_OR_RETURN(const UpsampleOptions options, ParseUpsampleOptions(value, path));
    return ToJson(options).dump();
  }
  ASSIGN_OR_RETURN(SceneFlowOrder order, ParseSceneFlowOrder(value, path));
  SettleFormats(order);
  return ToJson(order).dump();
}

absl::StatusOr<JobFacts> FactsOfJob(JobKind kind, std::string_view canonical) {
  const auto damaged = [](const absl::Status& status) {
    return absl::DataLossError(absl::StrCat("damaged options of a job: ", status.message()));
  };
  const json value = ParseText(canonical);
  JobFacts facts;
  if (kind == JobKind::kUpsample) {
    const absl::StatusOr<UpsampleOptions> options = ParseUpsampleOptions(value);
    if (!options.ok()) return damaged(options.status());
    facts.self_check = options->self_check;
    facts.keep_motion = options->NeedsMotion();
    if (options->scene_flow) facts.outputs = {FilesOfFormats()[0].files};
    return facts;
  }
  const absl::StatusOr<SceneFlowOrder> order = ParseSceneFlowOrder(value);
  if (!order.ok()) return damaged(order.status());
  for (const auto& [format, files] : FilesOfFormats())
    if (std::count(order->formats.begin(), order->formats.end(), format) > 0) facts.outputs.push_back(files);
  return facts;
}

bool GiveSameDepth(std::string_view canonical, std::string_view other) {
  json a = ParseText(canonical), b = ParseText(other);
  for (json* const document : {&a, &b})
    for (const char* const beside_depth : {"self_check", "scene_flow"}) document->erase(beside_depth);
  return a == b;
}

}  // namespace depthtween
