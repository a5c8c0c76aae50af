// Rigid motions of windows of a surface, and those among them that may be a pixel's.
#ifndef DEPTHTWEEN_CORE_SCENEFLOW_SURFACE_WINDOWS_H_
#define DEPTHTWEEN_CORE_SCENEFLOW_SURFACE_WINDOWS_H_

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "core/base/image.h"
#include "core/sceneflow/color_patch.h"
#include "core/sceneflow/flow_matches.h"
#include "core/sceneflow/frame_pair.h"
#include "core/sceneflow/rigid_motion.h"

namespace depthtween {

// Costs are shares of a full mismatch of colour.
// Of a motion that leads behind the measured depth, or out of the image: an occlusion.
inline constexpr float kHiddenCost = 0.30F;
// How much a pixel feels of what a window says.
inline constexpr float kWindowShare = 0.5F;

struct WindowScale {
  int cell, radius, step;  // one every `cell` pixels, over `radius`, reading every `step`-th pixel
};

struct Window {
  int label = -1;
  int x = 0, y = 0;  // the pixel it is about
  RigidMotion motion;
  float support = 0.0F;
  bool speaks = false;  // for itself, or by a neighbour on its surface
  std::optional<RigidMotion> searched;
  std::vector<RigidMotion> proposed;  // of the small ones: fitted to matches that only propose

  // Of the small ones: motions that may be those of its pixels, and what each costs more than the best of them.
  struct Candidate {
    RigidMotion motion;
    float penalty = 0.0F;
    bool seen_only = false;  // not of pixels that it would hide: what only proposes knows nothing of those
  };
  std::vector<Candidate> candidates;
};

class WindowGrid {
 public:
  WindowGrid() = default;
  WindowGrid(const WindowScale& scale, int width, int height)
      : scale_(scale),
        columns_((width + scale.cell - 1) / scale.cell),
        rows_((height + scale.cell - 1) / scale.cell),
        cells_(static_cast<size_t>(columns_) * rows_) {}

  const WindowScale& scale() const { return scale_; }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  std::vector<Window>& cell(int column, int row) { return cells_[row * columns_ + column]; }
  const std::vector<Window>& cell(int column, int row) const { return cells_[row * columns_ + column]; }

  // Calls body(window) for those of the cell of a pixel and of the cells around it.
  template <typename Body>
  void ForNeighbours(int x, int y, const Body& body) const {
    const int column = x / scale_.cell, row = y / scale_.cell;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows_ - 1); ++r)
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns_ - 1); ++c)
        for (const Window& window : cell(c, r)) body(window);
  }

 private:
  WindowScale scale_ = {1, 1, 1};
  int columns_ = 0, rows_ = 0;
  std::vector<std::vector<Window>> cells_;
};

struct SurfaceWindows {
  std::vector<RigidMotion> dominant;  // the few that dominate the frame, that of most matches first
  WindowGrid small;                   // with candidates
  std::vector<float> alone_cost;      // by surface: of leaving the motion that it follows as a whole
};

// Fits windows to matches; see rigid_windows.h. `proposals` are further matches, each empty or W x H, whose motions
// windows may take that nothing else explains. `labels` as of LabelSurfaces, colours as of ToFloats. Uses up to
// pair.threads threads; the result does not depend on how many.
SurfaceWindows FitSurfaceWindows(const FramePair& pair, ImageView<const int> labels, ImageView<const Color4> from_image,
                                 ImageView<const Color4> to_image, const Image<PointMatch>& matches,
                                 std::span<const Image<PointMatch>* const> proposals);

// Where a match says that a pixel's point went.
inline Float3 FoundPoint(const FramePair& pair, const PointMatch& match) {
  return pair.to_rays.PointAt(match.place.u, match.place.v, match.depth_m);
}
// Whether a pixel's point may have come there: no farther than flow finds anything, and not onto another surface.
bool Plausible(const FramePair& pair, int x, int y, const Float3& moved);
// What a change of depth costs, as a share of it: smaller ones are likelier.
inline float DepthChangeCost(float share) {
  constexpr float kMost = 0.15F, kReachedAt = 0.15F;
  const float big = share / kReachedAt;
  return kMost * std::min(big * big, 1.0F);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SCENEFLOW_SURFACE_WINDOWS_H_
