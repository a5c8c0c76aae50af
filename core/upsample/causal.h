// Causal mode: depth for every colour frame from what had been seen by then, for low latency.
//
// A frame knows the last key before it, the key before that, and the colour frames up to itself. Where a pixel lies in
// the last key is chosen as in the pipeline, from one side; its depth there goes on as the surface moved in depth from
// the key before; what the last key did not see is taken from what lies beside it along colour, and marked inferred.
// Frames before the first key are unknown; frames after the last one are computed like all others.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_

#include <memory>

#include "core/upsample/pipeline.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// `options` must be valid; of them sweeps, median_radius, settle_reach, flow_finest_scale, thin and witnesses mean what
// they mean in the pipeline, the others have no meaning here. No later colour or depth frame changes a bit of an
// earlier frame's result as long as the constants stay; those of EstimateClipConstants(source,
// /*noise_of_first_key=*/true) do.
std::unique_ptr<Upsampler> MakeCausalUpsampler(const PipelineOptions& options = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_
