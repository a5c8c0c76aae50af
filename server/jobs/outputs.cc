#include "server/jobs/job_manager.h"

namespace depthtween::server {

const std::vector<OutputSpec>& AllOutputs() {
  static const std::vector<OutputSpec>* const outputs = new std::vector<OutputSpec>{
      {OutputKind::kDepth, "depth", "depth", true},
      {OutputKind::kUncertainty, "uncertainty", "uncertainty", true},
      {OutputKind::kProvenance, "provenance", "provenance", true},
      {OutputKind::kReport, "report", "report.json", false},
      {OutputKind::kTimestamps, "timestamps", "depth.txt", false},
      {OutputKind::kCamera, "camera", "camera.json", false},
  };
  return *outputs;
}

}  // namespace depthtween::server
