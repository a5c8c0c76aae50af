#include "core/sceneflow/pd_flow.h"

#include <utility>
#include <vector>

#include "core/sceneflow/pyramid.h"
#include "core/sceneflow/range_flow.h"

namespace depthtween {

absl::StatusOr<SceneFlow> PrimalDualFlow(const FramePair& pair) {
  const std::vector<PyramidLevel> levels = BuildPyramid(pair);
  RangeField field;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    if (pair.stop.stop_requested()) return absl::CancelledError("stopped on request");
    const int width = level->rays->width(), height = level->rays->height();
    if (field.u.empty())
      field = ZeroRangeField(width, height);
    else
      field = {Enlarge(field.u, width, height, 2.0F), Enlarge(field.v, width, height, 2.0F),
               Enlarge(field.w, width, height, 2.0F)};
    SolveRangeFlow(*level, TiesAlongSurface(*level->rays, level->from.depth_m), Image<float>(width, height, 1.0F),
                   ZeroRangeField(width, height), pair.noise, {}, pair.threads, field);
  }
  SceneFlow out = EmptySceneFlow(pair.rays.width(), pair.rays.height());
  for (int y = 0; y < pair.rays.height(); ++y)
    for (int x = 0; x < pair.rays.width(); ++x) {
      const float z = pair.from.depth_m(x, y);
      const float moved_z = std::max(z + field.w(x, y) * z / pair.rays.focal_px(), kNearestMovedShare * z);
      SetMotion(
          pair, x, y,
          pair.to_rays.PointAt(static_cast<float>(x) + field.u(x, y), static_cast<float>(y) + field.v(x, y), moved_z),
          out);
      out.confidence(x, y) = 1.0F;
    }
  return out;
}

}  // namespace depthtween
