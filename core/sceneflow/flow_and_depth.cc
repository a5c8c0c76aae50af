#include "core/sceneflow/flow_and_depth.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/sceneflow/frame_pair.h"

namespace depthtween {
namespace {

constexpr float kRoundTripPx = 1.0F;  // of a visible pixel
constexpr float kAlikePx = 0.5F;      // neighbours whose flows differ by this count half
constexpr int kReach = 3;             // of the mean, pixels
constexpr float kHiddenConfidence = 0.2F, kAloneConfidence = 0.05F;

// The change of depth of a visible pixel, or that there is none.
struct Change {
  float dz = 0.0F;
  bool visible = false;
};

}  // namespace

SceneFlow FromFlowAndDepth(const PixelRays& rays, const FlowAndDepth& frames, const DepthNoise& noise, int threads) {
  const int width = rays.width(), height = rays.height();
  Image<Change> changes(width, height);
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const float z = frames.from_m(x, y);
        const Flow2 flow = frames.next(x, y);
        const Flow2 place = {static_cast<float>(x) + flow.u, static_cast<float>(y) + flow.v};
        if (!(z > 0.0F) || !rays.Inside(place)) continue;
        const float there = SampleSurface(frames.to_m, place.u, place.v, noise);
        const Flow2 back = SampleFlow(frames.back, place.u, place.v);
        const bool returns = std::hypot(flow.u + back.u, flow.v + back.v) <= kRoundTripPx;
        if (there > 0.0F && returns && SameLayer(z, there, noise)) changes(x, y) = {there - z, true};
      }
  });
  SceneFlow out = EmptySceneFlow(width, height);
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        const float z = frames.from_m(x, y);
        if (!(z > 0.0F)) continue;
        const Flow2 flow = frames.next(x, y);
        float sum = 0.0F, weights = 0.0F;
        for (int ny = std::max(y - kReach, 0); ny <= std::min(y + kReach, height - 1); ++ny)
          for (int nx = std::max(x - kReach, 0); nx <= std::min(x + kReach, width - 1); ++nx) {
            const Change& change = changes(nx, ny);
            if (!change.visible || !SameLayer(z, frames.from_m(nx, ny), noise)) continue;
            const Flow2 other = frames.next(nx, ny);
            const float du = (other.u - flow.u) / kAlikePx, dv = (other.v - flow.v) / kAlikePx;
            const float weight = 1.0F / (1.0F + du * du + dv * dv);
            sum += weight * change.dz;
            weights += weight;
          }
        const bool visible = changes(x, y).visible;
        const float moved_z = weights > 0.0F ? std::max(z + sum / weights, kNearestMovedShare * z) : z;
        out.flow_px(x, y) = flow;
        out.motion_m(x, y) =
            rays.PointAt(static_cast<float>(x) + flow.u, static_cast<float>(y) + flow.v, moved_z) - rays.Point(x, y, z);
        out.depth_m(x, y) = z;
        out.hidden(x, y) = visible ? 0 : 1;
        out.confidence(x, y) = visible ? 1.0F : weights > 0.0F ? kHiddenConfidence : kAloneConfidence;
      }
  });
  return out;
}

}  // namespace depthtween
