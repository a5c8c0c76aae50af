// One finished frame, as the renderers see it.
#ifndef DEPTHTWEEN_CORE_RENDER_RENDER_VIEW_H_
#define DEPTHTWEEN_CORE_RENDER_RENDER_VIEW_H_

#include "core/base/image.h"

namespace depthtween {

struct RenderView {
  ImageView<const Rgb8> color;
  ImageView<const float> depth_m;  // same size; 0 = unknown
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_RENDER_VIEW_H_
