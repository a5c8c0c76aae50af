#include "core/upsample/key_surface.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/flow/dense_flow.h"
#include "core/upsample/choose.h"
#include "core/upsample/motion_options.h"

namespace depthtween {
namespace {

// From the key to each frame, at the key's points.
std::vector<Image<Flow2>> TracksAlong(const SolveProblem& path) {
  const int width = path.camera.width / KeySurface::kStep, height = path.camera.height / KeySurface::kStep;
  const Image<Flow2> still(width, height);
  std::vector<Image<Flow2>> tracks;
  for (const SolveFrame& frame : path.frames) {
    const Image<Flow2>& before = tracks.empty() ? still : tracks.back();
    tracks.push_back(frame.forward.empty() ? still.Clone() : Compose(before, frame.forward, KeySurface::kStep));
  }
  return tracks;
}

}  // namespace

KeySurface KeySurface::AlongFlow(const SolveProblem& path) {
  KeySurface surface(path.camera.width, path.camera.height);
  const std::vector<Image<Flow2>> tracks = TracksAlong(path);
  const ImageView<const float> key = path.key.depth_m, other = path.other.depth_m;
  for (size_t s = 0; s < tracks.size(); ++s) {
    Points points{Image<Flow2>(tracks[s].width(), tracks[s].height()),
                  Image<float>(tracks[s].width(), tracks[s].height())};
    for (int j = 0; j < tracks[s].height(); ++j)
      for (int i = 0; i < tracks[s].width(); ++i) {
        const auto x = static_cast<float>(i * kStep), y = static_cast<float>(j * kStep);
        const Flow2 step = tracks[s](i, j), end = tracks.back()(i, j);
        points.position(i, j) = {x + step.u, y + step.v};
        const float z = key(i * kStep, j * kStep);
        const float z_end = SampleDepthInLayer(other, x + end.u, y + end.v, path.noise);
        const bool same = z > 0 && z_end > 0 && std::abs(z_end - z) < kSameSurface * std::min(z, z_end);
        points.depth_m(i, j) = same ? z + path.frames[s].time * (z_end - z) : z;
      }
    surface.frames_.push_back(std::move(points));
  }
  return surface;
}

absl::StatusOr<KeySurface> KeySurface::Solved(SolveProblem path, const SolveOptions& options) {
  KeySurface surface(path.camera.width, path.camera.height);
  if (path.frames.empty()) return surface;  // both keys are seen in one frame
  const std::vector<Image<Flow2>> tracks = TracksAlong(path);
  path.step = kStep;
  for (size_t s = 0; s < tracks.size(); ++s) path.frames[s].track = tracks[s];
  ASSIGN_OR_RETURN(SolveResult result, Solve(path, options));
  for (size_t s = 0; s < tracks.size(); ++s) {
    Points points;
    result.motion.At(static_cast<int>(s), points.position, points.depth_m);
    surface.frames_.push_back(std::move(points));
  }
  surface.summary_ = std::move(result.summary);
  return surface;
}

DrawnSurface KeySurface::SeenIn(int frame) const {
  return DrawSurface(frames_[frame].position, frames_[frame].depth_m, width_, height_, {.step = kStep});
}

Image<Flow2> KeySurface::MotionSeenIn(int frame) const {
  const DrawnSurface drawn = SeenIn(frame);
  Image<Flow2> motion(width_, height_);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x)
      if (drawn.depth_m(x, y) > 0)
        motion(x, y) = {drawn.source(x, y).u - static_cast<float>(x), drawn.source(x, y).v - static_cast<float>(y)};
  return motion;
}

}  // namespace depthtween
