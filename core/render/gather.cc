#include "core/render/gather.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/render/aperture.h"

namespace depthtween {

Image<Light> BlurByGathering(const RenderView& view, const CircleOfConfusion& circle, int threads) {
  const int width = view.color.width(), height = view.color.height();
  const LinearLight& tables = LinearLight::Tables();
  Image<Light> before(width + 1, height);  // the sum of all pixels to the left
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) before(x + 1, y) = before(x, y) + tables.Decode(view.color(x, y));
  });
  const Aperture aperture(0, static_cast<float>(circle.limit_px));
  Image<Light> out(width, height);
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const Aperture::Shape& shape = aperture.Scaled(circle.RadiusPx(view.depth_m(x, y)));
        Light sum = {};
        for (int dy = std::max(-shape.reach, -y); dy <= std::min(shape.reach, height - 1 - y); ++dy) {
          // By parts: a sum of coverage times light is minus a sum of changes times what lies before them.
          for (const auto& [px, change] : aperture.RowAt(shape.first_row + dy))
            sum -= change * before(std::clamp(x + px, 0, width), y + dy);
        }
        out(x, y) = shape.reach == 0 ? tables.Decode(view.color(x, y)) : sum / sum[3];
      }
  });
  return out;
}

}  // namespace depthtween
