#include "core/solve/association.h"

#include <cmath>
#include <cstdlib>

namespace depthtween {
namespace {

// Depth may be off by so much of the prediction: a fast limb moves a tenth of its distance between two depth frames.
constexpr float kLayerShare = 0.1F;
constexpr float kLeastCosine = 0.7071F;  // 45 degrees
constexpr int kColorGate = 40;           // largest difference of a channel, sRGB units
constexpr int kWindowRadius = 1;         // pixels
constexpr int kClosestRadius = 5;        // pixels

}  // namespace

std::optional<Partner> FindPartner(const PartnerSurface& surface, const Triple<float>& predicted,
                                   const Triple<float>& normal, Rgb8 color) {
  if (!(predicted.z > 0)) return std::nullopt;
  const PixelOf<float> ideal = Project(surface.pixels->pinhole(), predicted);
  const PixelOf<float> seen = surface.pixels->Seen(ideal.u, ideal.v);
  const auto try_at = [&](float x, float y) -> std::optional<Partner> {
    const int nx = static_cast<int>(std::floor(x + 0.5F)), ny = static_cast<int>(std::floor(y + 0.5F));
    if (!surface.depth_m.Contains(nx, ny)) return std::nullopt;
    const float z = DepthBetweenPixels(surface.depth_m, x, y, surface.noise);
    if (z <= 0 || std::abs(z - predicted.z) > kLayerShare * predicted.z) return std::nullopt;
    const Rgb8 there = surface.color(nx, ny);
    if (std::abs(there.r - color.r) > kColorGate || std::abs(there.g - color.g) > kColorGate ||
        std::abs(there.b - color.b) > kColorGate)
      return std::nullopt;
    const Triple<float> facing = NormalAt(surface.depth_m, *surface.pixels, nx, ny, surface.reach, surface.noise);
    const bool known = Dot(facing, facing) > 0 && Dot(normal, normal) > 0;
    if (known && Dot(facing, normal) < kLeastCosine) return std::nullopt;
    return Partner{surface.pixels->PointAt(x, y, z), facing};
  };
  if (std::optional<Partner> partner = try_at(seen.u, seen.v)) return partner;
  for (int dy = -kWindowRadius; dy <= kWindowRadius; ++dy)
    for (int dx = -kWindowRadius; dx <= kWindowRadius; ++dx)
      if (dx != 0 || dy != 0)
        if (std::optional<Partner> partner = try_at(seen.u + static_cast<float>(dx), seen.v + static_cast<float>(dy)))
          return partner;
  return std::nullopt;
}

std::optional<Partner> ClosestPartner(const PartnerSurface& surface, const Triple<float>& point) {
  if (!(point.z > 0)) return std::nullopt;
  const PixelOf<float> ideal = Project(surface.pixels->pinhole(), point);
  const PixelOf<float> seen = surface.pixels->Seen(ideal.u, ideal.v);
  const int x0 = static_cast<int>(std::floor(seen.u + 0.5F)), y0 = static_cast<int>(std::floor(seen.v + 0.5F));
  std::optional<Partner> closest;
  float least = 0;
  int closest_x = 0, closest_y = 0;
  for (int y = y0 - kClosestRadius; y <= y0 + kClosestRadius; ++y)
    for (int x = x0 - kClosestRadius; x <= x0 + kClosestRadius; ++x) {
      if (!surface.depth_m.Contains(x, y) || !(surface.depth_m(x, y) > 0)) continue;
      const Triple<float> q =
          surface.pixels->PointAt(static_cast<float>(x), static_cast<float>(y), surface.depth_m(x, y));
      const float distance2 = Dot(q - point, q - point);
      if (closest && distance2 >= least) continue;
      closest = Partner{.point = q}, least = distance2, closest_x = x, closest_y = y;
    }
  if (closest)
    closest->normal = NormalAt(surface.depth_m, *surface.pixels, closest_x, closest_y, surface.reach, surface.noise);
  return closest;
}

}  // namespace depthtween
