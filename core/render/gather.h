// The naive way to depth of field, kept to compare with: every pixel becomes the mean of its own circle of confusion,
// whatever it shows. Sharp colours bleed into what is blurred, and blurred things keep their sharp outline.
#ifndef DEPTHTWEEN_CORE_RENDER_GATHER_H_
#define DEPTHTWEEN_CORE_RENDER_GATHER_H_

#include "core/base/image.h"
#include "core/render/lens.h"
#include "core/render/linear_light.h"
#include "core/render/render_view.h"

namespace depthtween {

// Linear light of weight 1. Pure; the result does not depend on `threads`.
Image<Light> BlurByGathering(const RenderView& view, const CircleOfConfusion& circle, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_GATHER_H_
