// The surface of a key, moved to the frames between it and the other key and drawn there: a proposal of motion that
// knows what hides what.
//
// Its points go along composed flow, or along the trajectories of the joint optimisation (core/solve), which flow,
// images, the other key's surface and rigidity together decide. Source: Yuan et al. 2018, sections 3 and 4. We differ:
// what is drawn only proposes, the observed colours choose.
//
// The way is a SolveProblem with the frames from a key to the other and the flow between neighbours (without flow,
// nothing moves before it is solved for); its step and tracks are filled in here.
//
// Shapes:   images W x H of the camera; points one per kStep pixels: inside a layer motion is smooth, and a proposal
//           need not know its edges.
// Units:    metres, pixels, intervals.
// Threads:  a KeySurface is safe to use concurrently; making one runs on one thread.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_KEY_SURFACE_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_KEY_SURFACE_H_

#include <optional>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/raster/surface_raster.h"
#include "core/solve/solve.h"

namespace depthtween {

class KeySurface {
 public:
  static constexpr int kStep = 2;

  // Along composed flow; depth is linear in time towards the other key's at the end of the track, if that is its layer.
  static KeySurface AlongFlow(const SolveProblem& path);
  // Along the joint optimisation's trajectories. Errors: those of Solve.
  static absl::StatusOr<KeySurface> Solved(SolveProblem path, const SolveOptions& options);

  // Of the solve; absent along flow.
  const std::optional<SolveSummary>& summary() const { return summary_; }
  // As a frame (index into SolveProblem::frames) sees it.
  DrawnSurface SeenIn(int frame) const;
  // The motion frame -> key of what is seen there; (0, 0) where nothing is.
  Image<Flow2> MotionSeenIn(int frame) const;

 private:
  KeySurface(int width, int height) : width_(width), height_(height) {}
  // Points of one frame.
  struct Points {
    Image<Flow2> position;
    Image<float> depth_m;  // 0 = unknown
  };
  int width_, height_;
  std::vector<Points> frames_;
  std::optional<SolveSummary> summary_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_KEY_SURFACE_H_
