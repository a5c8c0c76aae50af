#include "core/render/kraus.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// Half the size; each cell the mean of 4 x 4 pixels.
Image<Light> Shrink(ImageView<const Light> fine, int threads) {
  Image<Light> coarse((fine.width() + 1) / 2, (fine.height() + 1) / 2);
  ParallelRows(coarse.height(), threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < coarse.width(); ++x) {
        Light sum = {};
        for (int j = -1; j <= 2; ++j)
          for (int i = -1; i <= 2; ++i) sum += fine.Clamped(2 * x + i, 2 * y + j);
        coarse(x, y) = sum / 16;
      }
  });
  return coarse;
}

// Back to width x height by biquadratic B-splines.
Image<Light> Grow(ImageView<const Light> coarse, int width, int height, int threads) {
  Image<Light> fine(width, height);
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const int cx = x / 2, cy = y / 2, nx = cx + (x % 2 == 0 ? -1 : 1), ny = cy + (y % 2 == 0 ? -1 : 1);
        fine(x, y) =
            (9 * coarse(cx, cy) + 3 * coarse.Clamped(nx, cy) + 3 * coarse.Clamped(cx, ny) + coarse.Clamped(nx, ny)) /
            16;
      }
  });
  return fine;
}

// Pull-push: pixels of weight 0 get what is around them.
Image<Light> FillHoles(Image<Light> image, int threads) {
  const auto is_hole = [](const Light& pixel) { return pixel[3] == 0; };
  const Light *const begin = image.data(), *const end = begin + image.pixel_count();
  if (image.pixel_count() == 1 || std::none_of(begin, end, is_hole)) return image;
  Image<Light> coarse = Shrink(image, threads);
  for (size_t i = 0; i < coarse.pixel_count(); ++i)
    if (Light& cell = coarse.data()[i]; cell[3] > 0) cell /= cell[3];
  const Image<Light> around = Grow(FillHoles(std::move(coarse), threads), image.width(), image.height(), threads);
  for (size_t i = 0; i < image.pixel_count(); ++i)
    if (is_hole(image.data()[i])) image.data()[i] = around.data()[i];
  return image;
}

Image<Light> Blur(Image<Light> image, int levels, int threads) {
  if (levels == 0) return image;
  const Image<Light> coarse = Blur(Shrink(image, threads), levels - 1, threads);
  return Grow(coarse, image.width(), image.height(), threads);
}

// The radius of the disc whose variance is that of |k| levels down and up again: a level of 4-pixel boxes adds
// 5/4 4^(k-1) and its B-spline 3/4 4^(k-1), a disc has r^2 / 4.
float RadiusOfSubImage(int k) {
  const auto radius = static_cast<float>(2 * std::sqrt(2.0 / 3 * (std::pow(4.0, std::abs(k)) - 1)));
  return k < 0 ? -radius : radius;
}

// How far `radius_px` has come from sub-image k - 1 to k.
float Progress(float radius_px, int k) {
  const float before = RadiusOfSubImage(k - 1);
  return std::clamp((radius_px - before) / (RadiusOfSubImage(k) - before), 0.0F, 1.0F);
}

// The matting function. Between two sub-images the nearer fades and the farther is whole behind it.
float Opacity(float radius_px, int k) { return Progress(radius_px, k - 1) * (1 - Progress(radius_px, k + 1)); }

}  // namespace

Image<Light> BlurByPyramids(const RenderView& view, const CircleOfConfusion& circle, int threads) {
  const int width = view.color.width(), height = view.color.height();
  const LinearLight& tables = LinearLight::Tables();
  Image<float> radius_px(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) radius_px(x, y) = circle.RadiusPx(view.depth_m(x, y));
  const auto [low, high] = std::minmax_element(radius_px.data(), radius_px.data() + radius_px.pixel_count());
  int nearest = 0, farthest = 0;
  while (RadiusOfSubImage(nearest) > *low) --nearest;
  while (RadiusOfSubImage(farthest) < *high) ++farthest;

  Image<Light> sum(width, height);
  for (int k = farthest; k >= nearest; --k) {
    Image<Light> color(width, height), radius(width, height);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        if (radius_px(x, y) < RadiusOfSubImage(k - 2)) continue;  // culled
        color(x, y) = tables.Decode(view.color(x, y));
        radius(x, y) = Light{radius_px(x, y), 0, 0, 1};
      }
    color = FillHoles(std::move(color), threads);
    radius = FillHoles(std::move(radius), threads);
    for (size_t i = 0; i < color.pixel_count(); ++i) color.data()[i] *= Opacity(radius.data()[i][0], k);
    color = Blur(std::move(color), std::abs(k), threads);
    for (size_t i = 0; i < sum.pixel_count(); ++i)
      sum.data()[i] = color.data()[i] + (1 - color.data()[i][3]) * sum.data()[i];
  }
  for (size_t i = 0; i < sum.pixel_count(); ++i) sum.data()[i] /= sum.data()[i][3];
  return sum;
}

}  // namespace depthtween
