// Depth of field by pyramids, as the paper had it.
//
// Source: Kraus and Strengert, Depth-of-Field Rendering by Pyramidal Image Processing, Computer Graphics Forum 26(3),
// 2007. The frame is cut into sub-images by blur, each twice as unsharp as the one before. From far to near: what is
// nearer than a sub-image is culled, the holes are filled by pull-push, the sub-image is matted, blurred by as many
// pyramid levels as it is away from the focus, and blended over the ones behind it. We work in linear light and end
// by dividing by the weight, else the baseline would lose for reasons that are not its own.
#ifndef DEPTHTWEEN_CORE_RENDER_KRAUS_H_
#define DEPTHTWEEN_CORE_RENDER_KRAUS_H_

#include "core/base/image.h"
#include "core/render/lens.h"
#include "core/render/linear_light.h"
#include "core/render/render_view.h"

namespace depthtween {

// Linear light of weight 1. Pure; the result does not depend on `threads`.
Image<Light> BlurByPyramids(const RenderView& view, const CircleOfConfusion& circle, int threads);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_KRAUS_H_
