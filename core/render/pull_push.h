// Continues layers of an image into where they are not seen, without mixing layers.
//
// Source: pull-push, Gortler et al., The Lumigraph, SIGGRAPH 1996; ours keeps the farthest layer of each cell on the
// way up, and on the way down takes only cells of the layer asked for.
// Threads: a LayerPyramid is immutable once made; Infer is safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_
#define DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_

#include <array>
#include <cstdint>
#include <vector>

#include "core/base/image.h"

namespace depthtween {

struct LayerSample {
  std::array<float, 3> value = {};  // red, green, blue in 0..255; or u, v in pixels
  float inverse_depth = 0;          // 1 / metres
  float weight = 0;                 // 0 = nothing

  Rgb8 Color() const {
    const auto round = [](float v) { return static_cast<uint8_t>(v + 0.5F); };
    return {round(value[0]), round(value[1]), round(value[2])};
  }
};

class LayerPyramid {
 public:
  // Uses the pixels with inverse_depth > 0 and distrusted == 0. Two inverse depths are one layer when the smaller is at
  // least 1 - layer_gap of the larger.
  LayerPyramid(ImageView<const Rgb8> color, ImageView<const float> inverse_depth, ImageView<const uint8_t> distrusted,
               float layer_gap, int threads);
  LayerPyramid(ImageView<const Flow2> motion, ImageView<const float> inverse_depth, ImageView<const uint8_t> distrusted,
               float layer_gap, int threads);

  // The layer at `inverse_depth` as it would be at a pixel: from the finest cells around that know it, of at least
  // 2^(finest + 1) pixels, and coarser ones in so far as those are incomplete. Where none knows it, a farther layer.
  // Weight 0: nothing at all.
  LayerSample Infer(int x, int y, float inverse_depth, int finest = 0) const;

 private:
  template <typename Read>
  void Build(int width, int height, const Read& read, int threads);
  LayerSample Gather(int x, int y, float farthest, float nearest, int finest) const;

  const float layer_gap_;
  std::vector<Image<LayerSample>> levels_;  // the first has half the size of the image
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_
