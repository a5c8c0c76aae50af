// One moment seen by both cameras, borrowed.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_RGBD_VIEW_H_
#define DEPTHTWEEN_CORE_SEQUENCE_RGBD_VIEW_H_

#include "core/base/image.h"

namespace depthtween {

struct RgbdView {
  ImageView<const Rgb8> color;
  ImageView<const float> depth_m;  // of the same size; metres, 0 = unknown
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_RGBD_VIEW_H_
