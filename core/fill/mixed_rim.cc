#include "core/fill/mixed_rim.h"

#include <cstddef>
#include <vector>

#include "core/fill/depth_noise.h"

namespace depthtween {
namespace {

constexpr double kMixedShare = 0.2;  // of pixels beside unknown ones, from which on they are mixtures
constexpr int64_t kFewest = 50;      // of pixels beside unknown ones, which tell
constexpr int kMostRings = 4;        // a resampling to twice the size makes a rim of two pixels

// Calls body(x, y) for the neighbours of a pixel that exist.
template <typename Body>
void ForNeighbours(const Image<float>& depth_m, int x, int y, const Body& body) {
  for (int ny = y - 1; ny <= y + 1; ++ny)
    for (int nx = x - 1; nx <= x + 1; ++nx)
      if ((nx != x || ny != y) && depth_m.Contains(nx, ny)) body(nx, ny);
}

struct Rim {
  std::vector<size_t> unsupported;
  int64_t beside = 0;  // pixels beside unknown ones that have a measurement farther inside
};

Rim FindRim(const Image<float>& depth_m) {
  const DepthNoise noise;
  Image<uint8_t> touches(depth_m.width(), depth_m.height());
  for (int y = 0; y < depth_m.height(); ++y)
    for (int x = 0; x < depth_m.width(); ++x)
      if (depth_m(x, y) > 0)
        ForNeighbours(depth_m, x, y, [&](int nx, int ny) { touches(x, y) |= depth_m(nx, ny) <= 0 ? 1 : 0; });
  Rim rim;
  for (int y = 0; y < depth_m.height(); ++y)
    for (int x = 0; x < depth_m.width(); ++x) {
      if (touches(x, y) == 0) continue;
      const float z = depth_m(x, y);
      bool inside = false, supported = false;
      ForNeighbours(depth_m, x, y, [&](int nx, int ny) {
        if (touches(nx, ny) != 0 || depth_m(nx, ny) <= 0) return;
        inside = true;
        supported = supported || depth_m(nx, ny) <= z || SameLayer(z, depth_m(nx, ny), noise);
      });
      rim.beside += inside ? 1 : 0;
      if (inside && !supported) rim.unsupported.push_back(static_cast<size_t>(&depth_m(x, y) - depth_m.data()));
    }
  return rim;
}

}  // namespace

int64_t DropMixedRim(Image<float>& depth_m) {
  int64_t dropped = 0;
  for (int ring = 0; ring < kMostRings; ++ring) {
    const Rim rim = FindRim(depth_m);
    const auto unsupported = static_cast<int64_t>(rim.unsupported.size());
    if (ring == 0 &&
        (rim.beside < kFewest || static_cast<double>(unsupported) < kMixedShare * static_cast<double>(rim.beside)))
      return 0;
    if (unsupported == 0) break;
    for (const size_t p : rim.unsupported) depth_m.data()[p] = 0;
    dropped += unsupported;
  }
  return dropped;
}

}  // namespace depthtween
