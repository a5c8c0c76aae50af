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
#include <string>
#include <string_view>

#include "core/solve/solve.h"
#include "core/upsample/silhouettes.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

struct PipelineOptions {
  // Sweeps of propagation between neighbouring pixels where the match is uncertain. >= 0.
  int sweeps = 2;
  // Radius of the weighted median along colour near depth jumps, pixels. 0 switches it off.
  int median_radius = 3;
  // How often pixels beside a jump are decided by all frames together, each time seeing the decisions before. >= 0.
  int silhouette_passes = 2;
  // Keys are settled, where the scene stood still, by so many depth frames on either side; by one where the camera
  // moved.
  int settle_reach = 3;
  // Finest scale of the dense flow: 0 = full resolution, 1 = half.
  int flow_finest_scale = 0;
  // Motion to a key is followed outward from it, each flow starting where the last one leads, instead of composed from
  // the flows between neighbours and then refined: half the flows, and errors between 2 % lower and 8 % higher.
  bool follow = false;
  // Stages that one can do without, to learn what each is worth.
  bool recover = true;  // the motion of small, fast things that the flow between neighbours loses
  bool thin = true;     // the motion of thin things, which flow loses to what lies behind them
  bool draw = false;    // keys' surfaces moved and drawn as proposals: helps fast motion alone, so only "best" does
  bool solve = false;   // where they move to is solved for by all frames together; else composed flow says. Needs draw
  SolveOptions solver;
  bool witnesses = true;  // the frames on either side vote in the median too

  // InvalidArgument lists the presets if `name` is none of them.
  static absl::StatusOr<PipelineOptions> ForPreset(std::string_view name);
  // "settle", "propagation", "median" and "silhouettes" stand for settle_reach = 0, sweeps = 0, median_radius = 0 and
  // silhouette_passes = 0; terms and detectors of the solve for themselves. InvalidArgument lists the parts if `part`
  // is none of them.
  absl::Status SwitchOff(std::string_view part);
  // False for names that are no part.
  bool Uses(std::string_view part) const;
  absl::Status Validate() const;
};

// `options` must be valid. `decide` settles the pixels beside silhouettes, in each pass; the default is what was
// fitted.
std::unique_ptr<Upsampler> MakePipeline(const PipelineOptions& options = {},
                                        SilhouetteDecision decide = DecideSilhouettesAsFitted);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_PIPELINE_H_
