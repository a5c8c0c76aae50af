#include "core/render/gather.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/render/aperture.h"
#include "core/render/linear_light.h"

namespace depthtween {

Image<Rgb8> BlurByGathering(const RenderView& view, const CircleOfConfusion& circle, int threads) {
  const int width = view.color.width(), height = view.color.height();
  const LinearLight& tables = LinearLight::Tables();
  Image<Light> before(width + 1, height);  // the sum of all pixels to the left
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) before(x + 1, y) = before(x, y) + tables.Decode(view.color(x, y));
  });
  const Aperture aperture(0, static_cast<float>(circle.limit_px));
  Image<Rgb8> out(width, height);
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const Aperture::Shape& shape = aperture.Scaled(circle.RadiusPx(view.depth_m(x, y)));
        Light sum = {};
        for (int dy = std::max(-shape.reach, -y); dy <= std::min(shape.reach, height - 1 - y); ++dy) {
          const Aperture::Row& row = aperture.RowAt(shape.first_row + dy);
          const auto upto = [&](int at, float share) {
            const int left = std::clamp(at, 0, width), right = std::clamp(at + 1, 0, width);
            return before(left, y + dy) + share * (before(right, y + dy) - before(left, y + dy));
          };
          sum += upto(x + row.end_px, row.end_share) - upto(x + row.begin_px, row.begin_share);
        }
        out(x, y) = shape.reach == 0 ? view.color(x, y) : tables.Encode(sum / sum[3]);
      }
  });
  return out;
}

}  // namespace depthtween
