#include "server/jobs/job_manager.h"

#include <algorithm>

namespace depthtween::server {

namespace {

std::vector<OutputSpec> SceneFlowOutputs(const SceneFlowOptions& options) {
  struct Part {
    const char *format, *id, *folder, *extension;
  };
  constexpr Part kParts[] = {
      {"npz", "sceneflow", "sceneflow", "npz"},         {"flo", "flow", "flow", "flo"},
      {"flo", "depth_change", "depth_change", "pfm"},   {"kitti", "kitti-flow", "kitti/flow", "png"},
      {"kitti", "kitti-disp_0", "kitti/disp_0", "png"}, {"kitti", "kitti-disp_1", "kitti/disp_1", "png"}};
  std::vector<OutputSpec> outputs;
  for (const Part& part : kParts) {
    if (std::find(options.formats.begin(), options.formats.end(), part.format) == options.formats.end()) continue;
    outputs.push_back({.kind = OutputKind::kSceneFlow,
                       .id = part.id,
                       .file_name = part.folder,
                       .frames = true,
                       .extension = part.extension});
  }
  outputs.push_back({.kind = OutputKind::kReport, .id = "report", .file_name = "report.json"});
  outputs.push_back({.kind = OutputKind::kPreview, .id = "preview", .file_name = "preview.png"});
  return outputs;
}

}  // namespace

std::vector<OutputSpec> OutputsOf(const JobRecord& job) {
  if (job.scene_flow_options) return SceneFlowOutputs(*job.scene_flow_options);
  std::vector<OutputSpec> outputs = {
      {.kind = OutputKind::kDepth, .id = "depth", .file_name = "depth", .frames = true},
      {.kind = OutputKind::kUncertainty, .id = "uncertainty", .file_name = "uncertainty", .frames = true},
      {.kind = OutputKind::kProvenance, .id = "provenance", .file_name = "provenance", .frames = true},
      {.kind = OutputKind::kReport, .id = "report", .file_name = "report.json"},
      {.kind = OutputKind::kTimestamps, .id = "timestamps", .file_name = "depth.txt"},
      {.kind = OutputKind::kCamera, .id = "camera", .file_name = "camera.json"},
  };
  if (job.options.scene_flow) {
    outputs.push_back({.kind = OutputKind::kSceneFlow,
                       .id = "sceneflow",
                       .file_name = "sceneflow",
                       .frames = true,
                       .extension = "npz",
                       .assembled = true});
  }
  for (size_t i = 0; i < job.renders.size(); ++i) {
    const RenderRecord& render = job.renders[i];
    const int index = static_cast<int>(i);
    for (const std::string& stream : render.streams) {
      outputs.push_back({.kind = OutputKind::kPictures,
                         .id = stream,
                         .file_name = stream,
                         .frames = true,
                         .extension = render.extension,
                         .render = index});
    }
    for (size_t k = 0; k < render.videos.size(); ++k) {
      outputs.push_back({.kind = OutputKind::kVideo,
                         .id = render.streams[k] + "-video",
                         .file_name = render.videos[k],
                         .render = index});
    }
  }
  return outputs;
}

}  // namespace depthtween::server
