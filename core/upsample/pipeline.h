// The pipeline: depth for every colour frame of an interval, decided in the frame that was seen.
//
// Every source of motion - dense flow, the keys' surfaces moved and drawn, neighbours, standing still - only proposes
// where a pixel of the target frame lies in each key; the observed colours choose. Source: Yuan et al., Temporal
// Upsampling of Depth Maps Using a Hybrid Camera, TVCG 2018 (tracks, both directions, hole filling). We differ in where
// the decision is taken: the paper moves the keys' points forward; we search backward from the target, because
// silhouettes then follow the observed image (see ARCHITECTURE.md, "Why the target frame decides").
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_PIPELINE_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_PIPELINE_H_

#include <memory>

#include "core/upsample/upsampler.h"

namespace depthtween {

struct PipelineOptions {
  // Sweeps of propagation between neighbouring pixels where the match is uncertain. >= 0.
  int sweeps = 2;
  // Radius of the weighted median along colour near depth jumps, pixels. 0 switches it off.
  int median_radius = 3;
  // Finest scale of the dense flow: 0 = full resolution, 1 = half.
  int flow_finest_scale = 0;

  absl::Status Validate() const;
};

// `options` must be valid.
std::unique_ptr<Upsampler> MakePipeline(const PipelineOptions& options = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_PIPELINE_H_
