// The pipeline's causal mode: depth for every colour frame from what had been seen by then, for low latency.
//
// A frame knows the last key before it, the key before that, and the colour frames up to itself. Where a pixel lies in
// the last key is chosen as in the pipeline, from one side; its depth there goes on as the surface moved in depth from
// the key before; what the last key did not see is taken from what lies beside it along colour, and marked inferred.
// Frames before the first key are unknown; frames after the last one are computed like all others.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_

#include "core/upsample/pipeline.h"

namespace depthtween {

// Upsampler::Run of a pipeline with `options.causal`. No later colour or depth frame changes a bit of an earlier
// frame's result as long as `constants` stay; those of EstimateClipConstants(source, /*noise_of_first_key=*/true) do.
absl::StatusOr<IntervalSummary> RunCausally(const FrameSource& source, const ClipConstants& constants,
                                            const Interval& interval, const PipelineOptions& options,
                                            const RunContext& context, const FrameSink& sink);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_CAUSAL_H_
