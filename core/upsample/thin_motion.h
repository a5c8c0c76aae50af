// Motion of thin things - ropes, bars, fingers - away from a key. A window around them shows mostly what lies behind,
// and flow follows that. The key's depth tells which of a window's pixels are theirs, and those alone are looked for,
// frame after frame. What flow explains is left to it; what is found is a proposal among others (choose.h).
//
// Shapes:   all images W x H.  Units: pixels.
// Threads:  one thread at a time.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_THIN_MOTION_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_THIN_MOTION_H_

#include <vector>

#include "core/base/image.h"
#include "core/upsample/keys.h"

namespace depthtween {

class ThinMotion {
 public:
  // `color` is the one that the key is seen in; neither is kept.
  ThinMotion(const Key& key, ImageView<const Rgb8> color, const DepthNoise& noise);

  // The next frame away from the key, nearest first. `forward` is the flow from the frame before (the key, for the
  // first) to this one; empty, it says that nothing moves. Returns the motion from this frame to the key in and beside
  // thin things that were found where flow does not have them; (0, 0) elsewhere.
  Image<Flow2> Follow(ImageView<const Rgb8> color, ImageView<const Flow2> forward);

 private:
  struct WindowPixel {
    int8_t dx, dy;  // from the centre
    Rgb8 color;
  };
  // A place of a thin thing, and what of the window around it is the thing's.
  struct Place {
    int x, y;
    std::vector<WindowPixel> pixels;
    Flow2 along_flow, found, last_step;  // from the key to the frame that was followed last
    bool in_sight = true;
  };
  static float Difference(const Place& place, ImageView<const Rgb8> frame, int u, int v, float limit);

  std::vector<Place> places_;
  bool first_ = true;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_THIN_MOTION_H_
