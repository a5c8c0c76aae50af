// Depth of field: one sharp frame and its depth, seen through a lens.
//
// Shapes:   view, hidden and the result are W x H; an empty `hidden` is allowed and costs quality at silhouettes.
// Units:    metres along z, 0 = unknown = infinitely far; radii in pixels. Light is added linearly, in float.
// Threads:  safe to call concurrently; the result does not depend on `threads` (>= 1).
#ifndef DEPTHTWEEN_CORE_RENDER_DEPTH_OF_FIELD_H_
#define DEPTHTWEEN_CORE_RENDER_DEPTH_OF_FIELD_H_

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/render/hidden_background.h"
#include "core/render/lens.h"
#include "core/render/render_view.h"

namespace depthtween {

enum class DepthOfFieldMethod {
  kLayers,  // ours: see lens_layers.h
  kKraus,   // Kraus and Strengert 2007, which the paper used: see kraus.h
  kGather,  // every pixel the mean of its own circle of confusion
};

struct DepthOfFieldOptions {
  DepthOfFieldMethod method = DepthOfFieldMethod::kLayers;
  int blades = 0;               // of the aperture: 3..16, or 0 for a disc. Of the same area. kLayers only
  double max_radius_px = 32.0;  // larger circles of confusion are cut down to this, which bounds time. (0, 128]
  int layers = 20;              // what lies in one layer, of equal width in blur, does not hide itself. 4..64. kLayers

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// A pixel that nothing unsharp reaches keeps its bits. `options` must validate. `hidden` should reach as far as
// max_radius_px.
Image<Rgb8> RenderDepthOfField(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                               const DepthOfFieldOptions& options, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_DEPTH_OF_FIELD_H_
