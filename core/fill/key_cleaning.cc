#include "core/fill/key_cleaning.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// A path that crosses 12 sRGB units is as long as one that crosses a pixel: about three times the noise of a good
// camera.
constexpr float kColorPerPixel = 12.0F;

// Sum over channels, 0..765.
int ColorDifference(Rgb8 a, Rgb8 b) { return std::abs(a.r - b.r) + std::abs(a.g - b.g) + std::abs(a.b - b.b); }

// Colours this near (sum over channels, mean over a 7 x 7 window) are the same surface standing still: three
// times the noise of a camera, less than what moves by half a pixel on any texture that shows motion at all.
constexpr int kStillColor = 15;
constexpr int kStillRadius = 3;

Image<uint8_t> StandsStill(ImageView<const Rgb8> a, ImageView<const Rgb8> b, int threads) {
  const int width = a.width(), height = a.height();
  Image<uint8_t> still(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    std::vector<int> column(width);
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < width; ++x) {
        column[x] = 0;
        for (int ny = std::max(0, y - kStillRadius); ny <= std::min(height - 1, y + kStillRadius); ++ny)
          column[x] += ColorDifference(a(x, ny), b(x, ny));
      }
      const int rows = std::min(height - 1, y + kStillRadius) - std::max(0, y - kStillRadius) + 1;
      for (int x = 0; x < width; ++x) {
        const int first = std::max(0, x - kStillRadius), last = std::min(width - 1, x + kStillRadius);
        int sum = 0;
        for (int nx = first; nx <= last; ++nx) sum += column[nx];
        still(x, y) = sum <= kStillColor * rows * (last - first + 1);
      }
    }
  });
  return still;
}

}  // namespace

Image<float> RemoveFlyingPixels(ImageView<const float> depth_m, const DepthNoise& noise, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float z = depth_m(x, y);
        if (z <= 0) continue;
        int same = 0, nearer = 0, farther = 0;
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx) {
            if (!depth_m.Contains(x + dx, y + dy)) continue;
            const float other = depth_m(x + dx, y + dy);
            if (other <= 0) continue;
            if (SameLayer(z, other, noise))
              ++same;
            else if (other < z)
              ++nearer;
            else
              ++farther;
          }
        // `same` counts the pixel itself. A mixture sees both sides and hardly anything of its own depth; a lonely
        // pixel (noise, a speck) has no company at all.
        const bool mixed = nearer > 0 && farther > 0 && same <= 3;
        const bool lonely = same <= 1 && nearer + farther >= 3;
        out(x, y) = mixed || lonely ? 0.0F : z;
      }
  });
  return out;
}

Image<float> SettleWhereStill(ImageView<const float> depth_m, ImageView<const Rgb8> color,
                              const std::vector<DepthWitness>& witnesses, const DepthNoise& noise, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  std::vector<Image<uint8_t>> still;
  for (const DepthWitness& witness : witnesses) still.push_back(StandsStill(color, witness.color, threads));
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float own = depth_m(x, y);
        float others[8];
        int count = 0;
        for (size_t w = 0; w < witnesses.size(); ++w)
          if (still[w](x, y) && witnesses[w].depth_m(x, y) > 0) others[count++] = witnesses[w].depth_m(x, y);
        out(x, y) = own;
        if (count == 0) continue;
        // What to gather around: the own measurement, unless it is missing or all witnesses, two at least, stand
        // elsewhere together.
        float centre = own;
        const bool together =
            std::all_of(others, others + count, [&](float z) { return SameLayer(z, others[0], noise); });
        const bool contradicted = own > 0 && count >= 2 && together && !SameLayer(own, others[0], noise);
        if (own <= 0 || contradicted) {
          if (!together || count < 2) continue;
          centre = others[0];
        }
        float sum = 0, weight = 0;
        const auto add = [&](float z) {
          if (z > 0 && std::abs(z - centre) <= 4.0F * noise.At(centre)) sum += z, weight += 1;
        };
        add(own);
        for (int i = 0; i < count; ++i) add(others[i]);
        out(x, y) = sum / weight;
      }
  });
  return out;
}

FilledDepth FillAlongColor(ImageView<const float> depth_m, ImageView<const Rgb8> color) {
  const int width = depth_m.width(), height = depth_m.height();
  constexpr float kFar = std::numeric_limits<float>::max();
  FilledDepth out{Image<float>(width, height), Image<float>(width, height)};
  bool any_hole = false;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      out.depth_m(x, y) = depth_m(x, y);
      out.distance(x, y) = depth_m(x, y) > 0 ? 0.0F : kFar;
      any_hole |= depth_m(x, y) <= 0;
    }
  if (!any_hole) return out;
  const auto relax = [&](int x, int y, int dx, int dy, float length) {
    const int nx = x + dx, ny = y + dy;
    if (nx < 0 || ny < 0 || nx >= width || ny >= height) return;
    const float from = out.distance(nx, ny);
    if (from == kFar) return;
    const float reached =
        from + length + static_cast<float>(ColorDifference(color(x, y), color(nx, ny))) / kColorPerPixel;
    if (reached < out.distance(x, y)) {
      out.distance(x, y) = reached;
      out.depth_m(x, y) = out.depth_m(nx, ny);
    }
  };
  constexpr float kDiagonal = 1.41421356F;
  // Each pair of sweeps carries distances along paths that bend once more; after three, what still changes is below
  // noise.
  for (int pass = 0; pass < 3; ++pass) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        if (out.distance(x, y) == 0) continue;
        relax(x, y, -1, 0, 1.0F);
        relax(x, y, 0, -1, 1.0F);
        relax(x, y, -1, -1, kDiagonal);
        relax(x, y, 1, -1, kDiagonal);
      }
      for (int x = width - 1; x >= 0; --x)
        if (out.distance(x, y) != 0) relax(x, y, 1, 0, 1.0F);
    }
    for (int y = height - 1; y >= 0; --y) {
      for (int x = width - 1; x >= 0; --x) {
        if (out.distance(x, y) == 0) continue;
        relax(x, y, 1, 0, 1.0F);
        relax(x, y, 0, 1, 1.0F);
        relax(x, y, 1, 1, kDiagonal);
        relax(x, y, -1, 1, kDiagonal);
      }
      for (int x = 0; x < width; ++x)
        if (out.distance(x, y) != 0) relax(x, y, -1, 0, 1.0F);
    }
  }
  return out;
}

Image<float> DenoiseInLayers(ImageView<const float> depth_m, ImageView<const float> distance,
                             ImageView<const Rgb8> color, const DepthNoise& noise, int radius, int threads) {
  const int width = depth_m.width(), height = depth_m.height();
  Image<float> inverse_depth(width, height), out(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) inverse_depth(x, y) = depth_m(x, y) > 0 ? 1.0F / depth_m(x, y) : 0.0F;
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float z = depth_m(x, y);
        out(x, y) = z;
        if (z <= 0) continue;
        const float sigma = noise.At(z);
        const float inverse = 1.0F / z;
        const Rgb8 here = color(x, y);
        // Affine fit of 1/z about the pixel, twice: first gated around the pixel's own depth, then around the first
        // fit, so that a noisy centre does not decide who its neighbours are. Gates in inverse depth: dz / z^2.
        const float gate = 3.0F * sigma * inverse * inverse, slant = 0.015F * inverse;
        float c0 = inverse, cx = 0, cy = 0;
        bool fitted = false;
        for (int round = 0; round < 2; ++round) {
          float s = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0, sv = 0, sxv = 0, syv = 0;
          for (int ny = std::max(0, y - radius); ny <= std::min(height - 1, y + radius); ++ny) {
            const float dy = static_cast<float>(ny - y);
            const float* inverse_row = inverse_depth.row(ny);
            const float* filled_row = distance.row(ny);
            const Rgb8* color_row = color.row(ny);
            for (int nx = std::max(0, x - radius); nx <= std::min(width - 1, x + radius); ++nx) {
              const float v = inverse_row[nx];
              const float dx = static_cast<float>(nx - x);
              // Before the first fit a slant shows as a difference: allow it 1.5 % a pixel.
              const float allowed = round == 0 ? gate + slant * std::max(std::abs(dx), std::abs(dy)) : gate;
              if (v <= 0 || std::abs(v - (c0 + cx * dx + cy * dy)) > allowed) continue;
              const float colour = static_cast<float>(ColorDifference(here, color_row[nx])) / 90.0F;
              const float weight = 1.0F / ((1.0F + filled_row[nx]) * (1.0F + colour * colour));
              s += weight, sx += weight * dx, sy += weight * dy;
              sxx += weight * dx * dx, sxy += weight * dx * dy, syy += weight * dy * dy;
              // Relative to the centre, where single precision has digits to spare.
              const float r = v - inverse;
              sv += weight * r, sxv += weight * dx * r, syv += weight * dy * r;
            }
          }
          if (s < 2.0F) break;
          // Normal equations, damped towards no slope so that a line of pixels does not tilt freely.
          const float mx = sx / s, my = sy / s, mv = sv / s;
          const float damping = 0.02F * s;
          const float a = sxx - sx * mx + damping, b = sxy - sx * my, d = syy - sy * my + damping;
          const float e = sxv - sx * mv, f = syv - sy * mv;
          const float determinant = a * d - b * b;
          cx = (e * d - b * f) / determinant, cy = (a * f - b * e) / determinant;
          c0 = inverse + mv - cx * mx - cy * my;
          fitted = c0 > 0;
          if (!fitted) break;
        }
        // A fit further from the measurement than noise explains has found another surface.
        if (fitted && std::abs(1.0F / c0 - z) <= 4.0F * sigma) out(x, y) = 1.0F / c0;
      }
  });
  return out;
}

}  // namespace depthtween
