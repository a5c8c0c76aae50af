// Continues layers of an image into where they are not seen, without mixing layers.
//
// Source: pull-push, Gortler et al., The Lumigraph, SIGGRAPH 1996; ours keeps the farthest layer of each cell on the
// way up, and on the way down takes only cells of the layer asked for. Threads: a LayerPyramid is immutable once made;
// Infer is safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_
#define DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_

#include <cstdint>
#include <vector>

#include "core/base/image.h"

namespace depthtween {

struct LayerSample {
  float r = 0, g = 0, b = 0;  // sRGB, 0..255
  float inverse_depth = 0;    // 1 / metres; 0 = nothing
  float weight = 0;

  Rgb8 Color() const {
    const auto round = [](float v) { return static_cast<uint8_t>(v + 0.5F); };
    return {round(r), round(g), round(b)};
  }
};

class LayerPyramid {
 public:
  // Uses the pixels with inverse_depth > 0 and distrusted == 0. Two inverse depths are one layer when the smaller is at
  // least 1 - layer_gap of the larger.
  LayerPyramid(ImageView<const Rgb8> color, ImageView<const float> inverse_depth, ImageView<const uint8_t> distrusted,
               float layer_gap, int threads);

  // The layer at `inverse_depth` as it would be at a pixel: from the finest cells around that know it, coarser ones in
  // so far as those are incomplete. Where none knows it, a farther layer. Weight 0: nothing at all.
  LayerSample Infer(int x, int y, float inverse_depth) const;

 private:
  LayerSample Gather(int x, int y, float farthest, float nearest) const;

  const float layer_gap_;
  std::vector<Image<LayerSample>> levels_;  // the first has half the size of the image
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_PULL_PUSH_H_
