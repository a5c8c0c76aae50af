#include "core/fill/key_cleaning.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numeric>

#include "core/base/lanes.h"
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
// Texture, sum over channels across 4 pixels in x and in y: it shows a motion of half a pixel. If the camera stands
// still, more than this share of it does (recordings: 55 %), else hardly any (0 to 3 %).
constexpr int kTexture = 120;
constexpr int kTextureStride = 2;
constexpr float kStandingShare = 0.25F;

Image<uint8_t> StandsStill(ImageView<const Rgb8> a, ImageView<const Rgb8> b, int threads) {
  const int width = a.width(), height = a.height();
  Image<uint8_t> still(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    // Of each column, the sum over the rows of the window; from row to row one comes in and one goes out.
    std::vector<int> column(width, 0);
    const auto add = [&](int y, int sign) {
      if (y < 0 || y >= height) return;
      const Rgb8 *const of_a = a.row(y), *const of_b = b.row(y);
      for (int x = 0; x < width; ++x) column[x] += sign * ColorDifference(of_a[x], of_b[x]);
    };
    for (int y = begin - kStillRadius; y < begin + kStillRadius; ++y) add(y, 1);
    for (int y = begin; y < end; ++y) {
      add(y + kStillRadius, 1);
      if (y > begin) add(y - kStillRadius - 1, -1);
      const int rows = std::min(height - 1, y + kStillRadius) - std::max(0, y - kStillRadius) + 1;
      uint8_t* const to = still.row(y);
      int sum = std::accumulate(column.begin(), column.begin() + std::min(width, kStillRadius), 0);
      for (int x = 0; x < width; ++x) {
        if (x + kStillRadius < width) sum += column[x + kStillRadius];
        if (x - kStillRadius > 0) sum -= column[x - kStillRadius - 1];
        const int columns = std::min(width - 1, x + kStillRadius) - std::max(0, x - kStillRadius) + 1;
        to[x] = sum <= kStillColor * rows * columns;
      }
    }
  });
  return still;
}

constexpr int kMaxDenoiseTaps = (2 * kMaxDenoiseRadius + 1) * (2 * kMaxDenoiseRadius + 1);

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

bool CameraStoodStill(ImageView<const Rgb8> color, ImageView<const Rgb8> other) {
  int textured = 0, standing = 0;
  for (int y = kStillRadius; y + kStillRadius < color.height(); y += kTextureStride)
    for (int x = kStillRadius; x + kStillRadius < color.width(); x += kTextureStride) {
      if (ColorDifference(color(x - 2, y), color(x + 2, y)) + ColorDifference(color(x, y - 2), color(x, y + 2)) <
          kTexture)
        continue;
      ++textured;
      int sum = 0;
      for (int dy = -kStillRadius; dy <= kStillRadius; ++dy)
        for (int dx = -kStillRadius; dx <= kStillRadius; ++dx)
          sum += ColorDifference(color(x + dx, y + dy), other(x + dx, y + dy));
      constexpr int kPixels = (2 * kStillRadius + 1) * (2 * kStillRadius + 1);
      standing += sum <= kStillColor * kPixels ? 1 : 0;
    }
  return static_cast<float>(standing) > kStandingShare * static_cast<float>(textured);
}

Image<float> SettleWhereStill(ImageView<const float> depth_m, ImageView<const Rgb8> color,
                              const std::vector<DepthWitness>& witnesses, const DepthNoise& noise, int threads) {
  assert(witnesses.size() <= kMaxWitnesses);
  const int width = depth_m.width(), height = depth_m.height();
  std::vector<Image<uint8_t>> still;
  for (const DepthWitness& witness : witnesses) still.push_back(StandsStill(color, witness.color, threads));
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        const float own = depth_m(x, y);
        float others[kMaxWitnesses];
        int count = 0;
        for (size_t w = 0; w < witnesses.size(); ++w)
          if (still[w](x, y) && witnesses[w].depth_m(x, y) > 0) others[count++] = witnesses[w].depth_m(x, y);
        out(x, y) = own;
        if (count == 0) continue;
        // What to gather around: the layer that most of the measurements lie in, the own one's if none has more.
        const auto company = [&](float z) {
          return (own > 0 && SameLayer(z, own, noise) ? 1 : 0) +
                 std::count_if(others, others + count, [&](float other) { return SameLayer(z, other, noise); });
        };
        float centre = own;
        auto most = own > 0 ? company(own) : 1;
        for (int i = 0; i < count; ++i)
          if (const auto with = company(others[i]); with > most) most = with, centre = others[i];
        if (centre <= 0) continue;
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
  assert(radius >= 1 && radius <= kMaxDenoiseRadius);
  const int width = depth_m.width(), height = depth_m.height();
  // Planes with a margin in which nothing is known, so that windows and lanes may hang over the edge.
  const int padded = width + 2 * radius + kLanes;
  Image<float> inverse_depth(padded, height + 2 * radius), reliability(padded, height + 2 * radius);
  Image<float> channels[3];
  for (auto& channel : channels) channel = Image<float>(padded, height + 2 * radius);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; ++x) {
        inverse_depth(x + radius, y + radius) = depth_m(x, y) > 0 ? 1.0F / depth_m(x, y) : 0.0F;
        reliability(x + radius, y + radius) = 1.0F / (1.0F + distance(x, y));
        const Rgb8 c = color(x, y);
        channels[0](x + radius, y + radius) = c.r;
        channels[1](x + radius, y + radius) = c.g;
        channels[2](x + radius, y + radius) = c.b;
      }
  });
  Image<float> out(width, height);
  ParallelRows(height, threads, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < width; x += kLanes) {
        const int centre = x + radius;
        const Lanes inverse = LoadLanes(inverse_depth.row(y + radius) + centre);
        const LaneInts known = inverse > 0;
        const Lanes z = 1.0F / (known ? inverse : AllLanes(1.0F));
        const Lanes sigma = noise.a_m + noise.b_per_m * z * z;
        Lanes here[3];
        for (int c = 0; c < 3; ++c) here[c] = LoadLanes(channels[c].row(y + radius) + centre);
        // What each neighbour counts, if its depth fits.
        Lanes weights[kMaxDenoiseTaps];
        int tap = 0;
        for (int dy = -radius; dy <= radius; ++dy) {
          const float* inverse_row = inverse_depth.row(y + radius + dy) + centre;
          const float* reliability_row = reliability.row(y + radius + dy) + centre;
          const float* rows[3];
          for (int c = 0; c < 3; ++c) rows[c] = channels[c].row(y + radius + dy) + centre;
          for (int dx = -radius; dx <= radius; ++dx) {
            const Lanes difference = AbsLanes(LoadLanes(rows[0] + dx) - here[0]) +
                                     AbsLanes(LoadLanes(rows[1] + dx) - here[1]) +
                                     AbsLanes(LoadLanes(rows[2] + dx) - here[2]);
            const Lanes colour = difference * (1.0F / 45.0F);
            weights[tap++] =
                KeepLanes(LoadLanes(inverse_row + dx) > 0, LoadLanes(reliability_row + dx) / (1.0F + colour * colour));
          }
        }
        // Affine fit of 1/z about the pixel, twice: first gated around the pixel's own depth, then around the first
        // fit, so that a noisy centre does not decide who its neighbours are. Gates in inverse depth: dz / z^2.
        const Lanes gate = 3.0F * sigma * inverse * inverse, slant = 0.008F * inverse;
        Lanes c0 = inverse, cx = {}, cy = {};
        LaneInts fitted = {}, going = known;
        for (int round = 0; round < 2; ++round) {
          Lanes s = {}, sx = {}, sy = {}, sxx = {}, sxy = {}, syy = {}, sv = {}, sxv = {}, syv = {};
          tap = 0;
          for (int dy = -radius; dy <= radius; ++dy) {
            const float* inverse_row = inverse_depth.row(y + radius + dy) + centre;
            const auto fy = static_cast<float>(dy);
            const Lanes row_fit = c0 + cy * fy;
            Lanes row_s = {}, row_sx = {}, row_sxx = {}, row_sv = {}, row_sxv = {};
            for (int dx = -radius; dx <= radius; ++dx) {
              const auto fx = static_cast<float>(dx);
              const Lanes v = LoadLanes(inverse_row + dx);
              // Before the first fit a slant shows as a difference: allow it 0.8 % a pixel.
              const Lanes allowed =
                  round == 0 ? gate + slant * static_cast<float>(std::max(std::abs(dx), std::abs(dy))) : gate;
              const Lanes weight = KeepLanes(AbsLanes(v - (row_fit + cx * fx)) <= allowed, weights[tap++]);
              // Relative to the centre, where single precision has digits to spare.
              const Lanes r = v - inverse;
              const Lanes weight_x = weight * fx;
              row_s += weight, row_sx += weight_x, row_sxx += weight_x * fx;
              row_sv += weight * r, row_sxv += weight_x * r;
            }
            s += row_s, sx += row_sx, sxx += row_sxx, sv += row_sv, sxv += row_sxv;
            sy += row_s * fy, syy += row_s * (fy * fy), sxy += row_sx * fy, syv += row_sv * fy;
          }
          const LaneInts enough = going & (s >= 2.0F);
          s = enough ? s : AllLanes(1.0F);
          // Normal equations, damped towards no slope so that a line of pixels does not tilt freely.
          const Lanes mx = sx / s, my = sy / s, mv = sv / s;
          const Lanes damping = 0.02F * s;
          const Lanes a = sxx - sx * mx + damping, b = sxy - sx * my, d = syy - sy * my + damping;
          const Lanes e = sxv - sx * mv, f = syv - sy * mv;
          const Lanes determinant = a * d - b * b;
          const Lanes next_cx = (e * d - b * f) / determinant, next_cy = (a * f - b * e) / determinant;
          const Lanes next_c0 = inverse + mv - next_cx * mx - next_cy * my;
          c0 = enough ? next_c0 : c0, cx = enough ? next_cx : cx, cy = enough ? next_cy : cy;
          fitted = enough ? LaneInts(c0 > 0) : fitted;
          going = enough & fitted;
        }
        // A fit further from the measurement than noise explains has found another surface.
        const Lanes plane_z = 1.0F / (fitted ? c0 : AllLanes(1.0F));
        const LaneInts better = fitted & (AbsLanes(plane_z - z) <= 4.0F * sigma);
        for (int i = 0; i < std::min(kLanes, width - x); ++i)
          out(x + i, y) = better[i] ? plane_z[i] : depth_m(x + i, y);
      }
  });
  return out;
}

}  // namespace depthtween
