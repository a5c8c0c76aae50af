// A median whose votes count by colour likeness and confidence: moves depth edges onto colour edges.
//
// Source: weighted median filtering of disparity, Ma et al., Constant Time Weighted Median Filtering for Stereo
// Matching and Beyond, ICCV 2013; we evaluate it exactly but only where `mask` says.
#ifndef DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_
#define DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_

#include <functional>
#include <vector>

#include "core/base/image.h"

namespace depthtween {

// What has a say: a depth map, how sure it is (>= 0), and the colours it is seen in. Samples of depth 0 or confidence 0
// do not vote.
struct MedianVoters {
  ImageView<const float> depth_m, confidence;
  ImageView<const Rgb8> color;
};

// Voters of another time: around the place where `motion` (pixels; called where the mask is not zero, from several
// threads) takes a pixel, each counting `weight`.
struct MedianWitness {
  MedianVoters voters;
  std::function<Flow2(int x, int y)> motion;
  float weight = 1.0F;
};

struct WeightedMedianOptions {
  int radius = 3;            // pixels, 1..15
  float space_sigma = 1.5F;  // pixels: thin things must not be outvoted by the wide background around them
  float color_sigma = 5.0F;  // sRGB units, per channel: a little above a camera's noise
  int witness_radius = 2;    // pixels, 0..15: motion between frames is known to about one
};

// The median of depth around each pixel whose mask is non-zero, over `own` and all witnesses; own depth elsewhere.
// Shapes: all W x H.
Image<float> WeightedMedian(const MedianVoters& own, const std::vector<MedianWitness>& witnesses,
                            ImageView<const uint8_t> mask, const WeightedMedianOptions& options, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_
