// A median whose votes count by colour likeness and confidence: moves depth edges onto colour edges.
//
// Source: weighted median filtering of disparity, Ma et al., Constant Time Weighted Median Filtering for Stereo
// Matching and Beyond, ICCV 2013; we evaluate it exactly but only where `mask` says.
#ifndef DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_
#define DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_

#include "core/base/image.h"

namespace depthtween {

struct WeightedMedianOptions {
  int radius = 4;            // pixels, 1..15
  float space_sigma = 2.0F;  // pixels: thin things must not be outvoted by the wide background around them
  float color_sigma = 5.0F;  // sRGB units, per channel: a little above a camera's noise
};

// Writes into `out` the median of depth around each pixel whose mask is non-zero; copies elsewhere. Samples of depth 0
// or confidence 0 do not vote. Shapes: all W x H. confidence >= 0.
Image<float> WeightedMedian(ImageView<const float> depth_m, ImageView<const float> confidence,
                            ImageView<const Rgb8> color, ImageView<const uint8_t> mask,
                            const WeightedMedianOptions& options, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_WEIGHTED_MEDIAN_H_
