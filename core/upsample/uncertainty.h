// How far a fused depth may be wrong.
//
// Shapes:   all images W x H.  Units: metres.
// Threads:  PredictSigma splits rows over `threads`; results do not depend on it.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_UNCERTAINTY_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_UNCERTAINTY_H_

#include "core/base/image.h"
#include "core/fill/depth_noise.h"
#include "core/upsample/fuse.h"

namespace depthtween {

// What speaks against a depth, in standard deviations that add up in squares. A cost is that of the match, in sRGB
// units.
struct SigmaWeights {
  float unrest = 0, unrest_per_cost = 0;  // of the deviation of the keys' answers within the neighbourhood
  float one_surface = 0;                  // of what the two answers differ by more than their neighbours' do, or ...
  float two_surfaces = 0;                 // of what they differ by at a silhouette, if they are about two surfaces ...
  float hidden_once = 0;                  // ... and elsewhere, where one key does not see the surface, the other does
  float step = 0, step_per_cost = 0;      // of the jump at a silhouette, whose wrong side it may be
  float seen_once = 0, inferred = 0;      // of depth, where one key or none saw the pixel
  float share_per_cost = 0;               // of depth
};

// The weights under which errors are likeliest (as of a normal distribution) over five scenes of the library, three
// rendered sequences and three recordings, of which each had the same say, the recordings together as much as the rest.
// What they give on each: tests/bench/RESULTS.md.
inline constexpr SigmaWeights kBetweenKeys{.unrest = 1.2F,
                                           .unrest_per_cost = 0.21F,
                                           .one_surface = 0.66F,
                                           .two_surfaces = 0.42F,
                                           .hidden_once = 0.11F,
                                           .step = 0.15F,
                                           .step_per_cost = 0.004F,
                                           .seen_once = 0.024F,
                                           .inferred = 0.05F};
// From past keys alone, where the change is that of the trend.
inline constexpr SigmaWeights kAfterKey{.unrest = 4.0F,
                                        .step = 0.22F,
                                        .step_per_cost = 0.017F,
                                        .seen_once = 0.012F,
                                        .inferred = 0.17F,
                                        .share_per_cost = 0.0014F};

// Predicted standard deviation of each depth (0 where depth is unknown). `depth_m` may have been settled since it was
// fused. Elsewhere than at silhouettes it follows the recording: where the keys' answers about one surface differ from
// pixel to pixel, as noise, wrong motion and sensors' ripples make them, each is wrong by as much; a surface that
// moves in depth changes its answers alike, and that counts for nothing.
Image<float> PredictSigma(ImageView<const float> depth_m, const Fused& fused, const DepthNoise& noise,
                          const SigmaWeights& weights, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_UNCERTAINTY_H_
