#include "server/jobs/job_manager.h"

#include <algorithm>

namespace depthtween::server {

std::vector<OutputSpec> OutputsOf(const JobRecord& job) {
  if (job.kind == JobKind::kSceneFlow) {
    std::vector<OutputSpec> outputs;
    for (const FrameFiles& files : job.facts.outputs) {
      outputs.push_back({.kind = OutputKind::kSceneFlow,
                         .id = files.id,
                         .file_name = files.folder,
                         .frames = true,
                         .extension = files.extension});
    }
    outputs.push_back({.kind = OutputKind::kReport, .id = "report", .file_name = "report.json"});
    outputs.push_back({.kind = OutputKind::kPreview, .id = "preview", .file_name = "preview.png"});
    return outputs;
  }
  std::vector<OutputSpec> outputs = {
      {.kind = OutputKind::kDepth, .id = "depth", .file_name = "depth", .frames = true},
      {.kind = OutputKind::kUncertainty, .id = "uncertainty", .file_name = "uncertainty", .frames = true},
      {.kind = OutputKind::kProvenance, .id = "provenance", .file_name = "provenance", .frames = true},
      {.kind = OutputKind::kReport, .id = "report", .file_name = "report.json"},
      {.kind = OutputKind::kTimestamps, .id = "timestamps", .file_name = "depth.txt"},
      {.kind = OutputKind::kCamera, .id = "camera", .file_name = "camera.json"},
  };
  for (const FrameFiles& files : job.facts.outputs) {
    outputs.push_back({.kind = OutputKind::kSceneFlow,
                       .id = files.id,
                       .file_name = files.folder,
                       .frames = true,
                       .extension = files.extension,
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
