#include "tests/bench/parameters.h"

namespace depthtween {

const std::vector<PipelineParameter>& PipelineParameters() {
  using Options = PipelineOptions;
  static const auto* const kParameters = new std::vector<PipelineParameter>{
      {"sweeps",
       {0, 1, 2, 3, 5},
       [](const Options& o) { return static_cast<double>(o.sweeps); },
       [](Options& o, double value) { o.sweeps = static_cast<int>(value); }},
      {"median_radius",
       {0, 1, 2, 3, 4, 6},
       [](const Options& o) { return static_cast<double>(o.median_radius); },
       [](Options& o, double value) { o.median_radius = static_cast<int>(value); }},
      {"silhouette_passes",
       {0, 1, 2, 4},
       [](const Options& o) { return static_cast<double>(o.silhouette_passes); },
       [](Options& o, double value) { o.silhouette_passes = static_cast<int>(value); }},
      {"settle_reach",
       {0, 1, 2, 3, 4},
       [](const Options& o) { return static_cast<double>(o.settle_reach); },
       [](Options& o, double value) { o.settle_reach = static_cast<int>(value); }},
      {"flow_finest_scale",
       {0, 1, 2},
       [](const Options& o) { return static_cast<double>(o.flow_finest_scale); },
       [](Options& o, double value) { o.flow_finest_scale = static_cast<int>(value); }},
  };
  return *kParameters;
}

}  // namespace depthtween
