#include "core/sceneflow/pyramid.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

Camera HalfCamera(const Camera& camera) {
  Camera half = camera;
  half.width = (camera.width + 1) / 2;
  half.height = (camera.height + 1) / 2;
  half.fx = camera.fx / 2;
  half.fy = camera.fy / 2;
  // Pixel (i, j) covers pixels 2i, 2i + 1: its middle lies half a pixel further.
  half.cx = (camera.cx - 0.5) / 2;
  half.cy = (camera.cy - 0.5) / 2;
  return half;
}

Image<float> Blur(ImageView<const float> image) {
  Image<float> rows(image.width(), image.height()), out(image.width(), image.height());
  const auto weigh = [](float a, float b, float c) { return 0.25F * a + 0.5F * b + 0.25F * c; };
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      rows(x, y) = weigh(image.Clamped(x - 1, y), image(x, y), image.Clamped(x + 1, y));
  const ImageView<const float> across = std::as_const(rows);
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      out(x, y) = weigh(across.Clamped(x, y - 1), across(x, y), across.Clamped(x, y + 1));
  return out;
}

PyramidFrame Half(const PyramidFrame& fine, const DepthNoise& noise) {
  const int width = (fine.light.width() + 1) / 2, height = (fine.light.height() + 1) / 2;
  PyramidFrame half{Image<float>(width, height), Image<float>(width, height)};
  const Image<float> blurred = Blur(fine.light);
  const ImageView<const float> light = blurred, depth = fine.depth_m;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      float sum = 0.0F, nearest = depth.Clamped(2 * x, 2 * y);
      for (int i = 0; i < 4; ++i) {
        sum += light.Clamped(2 * x + i % 2, 2 * y + i / 2);
        nearest = std::min(nearest, depth.Clamped(2 * x + i % 2, 2 * y + i / 2));
      }
      half.light(x, y) = 0.25F * sum;
      float depth_sum = 0.0F, count = 0.0F;
      for (int i = 0; i < 4; ++i) {
        const float z = depth.Clamped(2 * x + i % 2, 2 * y + i / 2);
        if (SameLayer(z, nearest, noise)) depth_sum += z, count += 1.0F;
      }
      half.depth_m(x, y) = depth_sum / count;
    }
  return half;
}

PyramidFrame Whole(const PreparedFrame& frame) {
  PyramidFrame whole{Image<float>(frame.luma.width(), frame.luma.height()), frame.depth_m.Clone()};
  for (size_t i = 0; i < whole.light.pixel_count(); ++i)
    whole.light.data()[i] = static_cast<float>(frame.luma.data()[i]) / 255.0F;
  return whole;
}

}  // namespace

std::vector<PyramidLevel> BuildPyramid(const FramePair& pair, int least_side) {
  std::vector<PyramidLevel> levels;
  levels.push_back({std::make_unique<PixelRays>(pair.rays.camera()), std::make_unique<PixelRays>(pair.to_rays.camera()),
                    Whole(pair.from), Whole(pair.to)});
  while (std::min(levels.back().rays->width(), levels.back().rays->height()) >= 2 * least_side) {
    const PyramidLevel& fine = levels.back();
    PyramidLevel half{std::make_unique<PixelRays>(HalfCamera(fine.rays->camera())),
                      std::make_unique<PixelRays>(HalfCamera(fine.to_rays->camera())), Half(fine.from, pair.noise),
                      Half(fine.to, pair.noise)};
    levels.push_back(std::move(half));
  }
  return levels;
}

Image<float> Enlarge(ImageView<const float> coarse, int width, int height, float scale) {
  Image<float> fine(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      fine(x, y) =
          scale * SampleBilinear(coarse, 0.5F * static_cast<float>(x) - 0.25F, 0.5F * static_cast<float>(y) - 0.25F);
  return fine;
}

Image<float> Median3(ImageView<const float> image, int threads) {
  Image<float> out(image.width(), image.height());
  ParallelRows(image.height(), threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < image.width(); ++x) {
        std::array<float, 9> window;
        for (int i = 0; i < 9; ++i) window[i] = image.Clamped(x + i % 3 - 1, y + i / 3 - 1);
        std::nth_element(window.begin(), window.begin() + 4, window.end());
        out(x, y) = window[4];
      }
  });
  return out;
}

SurfaceTies TiesAlongSurface(const PixelRays& rays, ImageView<const float> depth_m) {
  SurfaceTies ties{Image<float>(depth_m.width(), depth_m.height()), Image<float>(depth_m.width(), depth_m.height())};
  const auto tie = [&](int x, int y, int nx, int ny) {
    const Float3 a = rays.Point(x, y, depth_m(x, y)), b = rays.Point(nx, ny, depth_m(nx, ny)), d = b - a;
    const float facing = 0.5F * (a.z + b.z) / rays.focal_px();
    return std::min(facing / std::sqrt(d.x * d.x + d.y * d.y + d.z * d.z), 1.0F);
  };
  for (int y = 0; y < depth_m.height(); ++y)
    for (int x = 0; x < depth_m.width(); ++x) {
      if (x + 1 < depth_m.width()) ties.right(x, y) = tie(x, y, x + 1, y);
      if (y + 1 < depth_m.height()) ties.below(x, y) = tie(x, y, x, y + 1);
    }
  return ties;
}

}  // namespace depthtween
