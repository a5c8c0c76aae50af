#include "core/sceneflow/pd_flow.h"

#include <algorithm>

#include "core/sceneflow/pyramid.h"
#include "core/sceneflow/range_flow.h"

namespace depthtween {

absl::StatusOr<SceneFlow> PrimalDualFlow(const FramePair& pair) {
  ASSIGN_OR_RETURN(const RangeField field, RangeFlowCoarseToFine(pair, BuildPyramid(pair), 0));
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
