#include "core/render/focus.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

constexpr int kPointedPx = 2;      // how exactly one points
constexpr int kPatchPx = 4;        // a surface is known by this much around the point
constexpr double kGate = 0.1;      // of depth: 5 m/s at 2 m and 30 fps
constexpr double kRecentre = 0.1;  // a frame: keeps small errors of motion from adding up to a slip off the edge

double Median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Calls visit(x, y, depth) for the pixels around (x, y) that lie on the surface at `surface_m`.
template <typename Visit>
void VisitSurface(ImageView<const float> depth_m, double x, double y, double surface_m, const Visit& visit) {
  const int cx = static_cast<int>(std::lround(x)), cy = static_cast<int>(std::lround(y));
  for (int v = cy - kPatchPx; v <= cy + kPatchPx; ++v)
    for (int u = cx - kPatchPx; u <= cx + kPatchPx; ++u)
      if (depth_m.Contains(u, v) && std::abs(depth_m(u, v) - surface_m) <= kGate * surface_m)
        visit(u, v, depth_m(u, v));
}

}  // namespace

double FocusDepthOf(const FocusKeys& keys, int frame) {
  assert(!keys.keys.empty());
  const auto after =
      std::find_if(keys.keys.begin(), keys.keys.end(), [&](const FocusKey& k) { return k.frame > frame; });
  if (after == keys.keys.begin()) return after->depth_m;
  const FocusKey& from = *(after - 1);
  if (after == keys.keys.end()) return from.depth_m;
  double t = static_cast<double>(frame - from.frame) / (after->frame - from.frame);
  if (keys.easing == FocusEasing::kSmooth) t = t * t * (3 - 2 * t);
  return 1 / ((1 - t) / from.depth_m + t / after->depth_m);
}

absl::StatusOr<FocusPoint> StartFocus(const FocusPixel& pixel, ImageView<const float> depth_m) {
  const double x = std::round(pixel.x), y = std::round(pixel.y);
  if (!(x >= 0 && y >= 0 && x < depth_m.width() && y < depth_m.height()))
    return absl::InvalidArgumentError(absl::StrFormat("focus pixel = (%g, %g), must lie within the %d x %d image",
                                                      pixel.x, pixel.y, depth_m.width(), depth_m.height()));
  double nearest_m = std::numeric_limits<double>::infinity();
  const int cx = static_cast<int>(x), cy = static_cast<int>(y);
  for (int v = cy - kPointedPx; v <= cy + kPointedPx; ++v)
    for (int u = cx - kPointedPx; u <= cx + kPointedPx; ++u)
      if (depth_m.Contains(u, v) && depth_m(u, v) > 0) nearest_m = std::min<double>(nearest_m, depth_m(u, v));
  if (std::isinf(nearest_m))
    return absl::NotFoundError(
        absl::StrFormat("frame %d has no depth around the focus pixel (%g, %g)", pixel.frame, pixel.x, pixel.y));
  std::vector<float> depths;
  VisitSurface(depth_m, x, y, nearest_m, [&](int, int, float depth) { depths.push_back(depth); });
  return FocusPoint{pixel.frame, pixel.x, pixel.y, Median(depths)};
}

FocusPoint FollowFocus(const FocusPoint& point, ImageView<const float> depth_m, ImageView<const Flow2> motion,
                       int next_frame, ImageView<const float> next_depth_m) {
  FocusPoint next = point;
  next.frame = next_frame;
  std::vector<float> u_px, v_px, depths;
  if (!motion.empty()) {
    VisitSurface(depth_m, point.x, point.y, point.depth_m, [&](int u, int v, float) {
      u_px.push_back(motion(u, v).u);
      v_px.push_back(motion(u, v).v);
    });
    if (!u_px.empty()) next.x += Median(u_px), next.y += Median(v_px);
  }
  double sum_x = 0, sum_y = 0;
  VisitSurface(next_depth_m, next.x, next.y, point.depth_m, [&](int u, int v, float depth) {
    depths.push_back(depth);
    sum_x += u;
    sum_y += v;
  });
  if (depths.empty()) return next;
  const auto count = static_cast<double>(depths.size());
  next.x += kRecentre * (sum_x / count - next.x);
  next.y += kRecentre * (sum_y / count - next.y);
  next.depth_m = Median(depths);
  return next;
}

}  // namespace depthtween
