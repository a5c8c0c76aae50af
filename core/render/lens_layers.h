// Depth of field by light that is spread, not gathered: every pixel, and what is known to lie hidden behind it, spreads
// over its own circle of confusion.
//
// Layers of equal width in blur, with the plane of focus as a layer of its own, keep apart what can hide what. Within a
// layer light adds up, and its weights tell how much of the lens the layer fills at a pixel. Layers are then taken from
// near to far until the lens is full. Weights of one surface add up to one wherever it passes from layer to layer, so
// neither seams nor halos arise there; at a silhouette the nearer layer fills the lens in part, and what is behind it,
// found or inferred, fills the rest.
//
// Threads: pure; the result does not depend on `threads`.
#ifndef DEPTHTWEEN_CORE_RENDER_LENS_LAYERS_H_
#define DEPTHTWEEN_CORE_RENDER_LENS_LAYERS_H_

#include "core/base/image.h"
#include "core/render/hidden_background.h"
#include "core/render/lens.h"
#include "core/render/linear_light.h"
#include "core/render/render_view.h"

namespace depthtween {

struct LensLayersOptions {
  int blades = 0;   // of the aperture; 0 = a disc
  int layers = 20;  // at least 4
};

// Linear light of weight 1. `hidden` may be empty.
Image<Light> BlurInLayers(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                          const LensLayersOptions& options, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_LENS_LAYERS_H_
