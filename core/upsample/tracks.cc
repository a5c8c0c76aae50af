#include "core/upsample/tracks.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/flow/dense_flow.h"
#include "core/flow/lost_motion.h"
#include "core/upsample/motion_options.h"

namespace depthtween {
namespace {

// Over so few frames, and so few pixels in the mean, motion is small.
constexpr int kNearFrames = 2;
constexpr double kNearMotionPx = 4.0;
// Mean length of the motions, from every fourth pixel in both directions.
double MeanLength(const Image<Flow2>& flow) {
  double sum = 0, count = 0;
  for (int y = 0; y < flow.height(); y += 4)
    for (int x = 0; x < flow.width(); x += 4, ++count) sum += std::hypot(flow(x, y).u, flow(x, y).v);
  return sum / count;
}

// Motion to a key as it would be one frame further from it at constant velocity: what moves takes its motion along, and
// where things meet the faster wins, which occludes the slower more often than not.
Image<Flow2> Extrapolate(const Image<Flow2>& before, const Image<Flow2>& last) {
  const int width = last.width(), height = last.height();
  Image<Flow2> next(width, height);
  Image<float> speed2(width, height, -1.0F);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const Flow2 m = last(x, y);
      const Flow2 step = {m.u - before(x, y).u, m.v - before(x, y).v};
      const int to_x = static_cast<int>(std::floor(static_cast<float>(x) - step.u + 0.5F));
      const int to_y = static_cast<int>(std::floor(static_cast<float>(y) - step.v + 0.5F));
      const float length2 = step.u * step.u + step.v * step.v;
      if (!next.Contains(to_x, to_y) || length2 <= speed2(to_x, to_y)) continue;
      speed2(to_x, to_y) = length2;
      next(to_x, to_y) = {m.u + step.u, m.v + step.v};
    }
  // Where nothing arrives, motion goes on in place.
  for (size_t p = 0; p < next.pixel_count(); ++p)
    if (speed2.data()[p] < 0)
      next.data()[p] = {2 * last.data()[p].u - before.data()[p].u, 2 * last.data()[p].v - before.data()[p].v};
  return next;
}

}  // namespace

absl::StatusOr<NeighbourFlow> FlowBetweenNeighbours(const Window& window, bool everywhere, bool recover,
                                                    const StageRunner& run) {
  const int pairs = window.size() - 1;
  const auto is_needed = [&](int pair) {
    return everywhere || std::any_of(window.located.begin(), window.located.end(), [&](const Key& key) {
             return key.toward >= 0 && std::min(key.color_index, key.toward) - window.first == pair;
           });
  };
  NeighbourFlow flow;
  flow.forward.resize(pairs);
  flow.backward.resize(pairs);
  RETURN_IF_ERROR(run.SideBySide(2 * pairs, [&](int i) -> absl::Status {
    const int pair = i / 2;
    if (!is_needed(pair)) return absl::OkStatus();
    const auto& a = window.luma[pair];
    const auto& b = window.luma[pair + 1];
    if (i % 2 == 0) {
      ASSIGN_OR_RETURN(flow.forward[pair], DenseFlow(a, b, kNeighbourFlow));
    } else {
      ASSIGN_OR_RETURN(flow.backward[pair], DenseFlow(b, a, kNeighbourFlow));
    }
    return absl::OkStatus();
  }));
  RETURN_IF_ERROR(run.SideBySide(pairs, [&](int pair) {
    if (recover && is_needed(pair))
      RecoverLostMotion(window.luma[pair], window.luma[pair + 1], flow.forward[pair], flow.backward[pair]);
    return absl::OkStatus();
  }));
  return flow;
}

Tracks NoTracks(const Window& window) {
  Tracks tracks;
  for (auto& side : tracks) side.resize(window.size());
  return tracks;
}

absl::StatusOr<KeyTracks> ComposeAndRefine(const Window& window, const NeighbourFlow& flow, int finest_scale,
                                           const StageRunner& run) {
  const int count = window.size();
  const DenseFlowOptions far = FlowToKeyOptions(finest_scale);
  const DenseFlowOptions near = NearFlowToKeyOptions(finest_scale);
  KeyTracks tracks{NoTracks(window), NoTracks(window)};
  RETURN_IF_ERROR(run.SideBySide(2, [&](int side) {
    const int key = window.KeyFrame(side);
    std::vector<Image<Flow2>>& composed = tracks.composed[side];
    composed[key] = Image<Flow2>(window.color[key].width(), window.color[key].height());
    for (int s = key + 1; s < count; ++s) composed[s] = Compose(flow.backward[s - 1], composed[s - 1]);
    for (int s = key - 1; s >= 0; --s) composed[s] = Compose(flow.forward[s], composed[s + 1]);
    return absl::OkStatus();
  }));
  RETURN_IF_ERROR(run.SideBySide(2 * window.target_count, [&](int i) -> absl::Status {
    const int side = i % 2, frame = window.Target(i / 2), key = window.KeyFrame(side);
    const Image<Flow2>& start = tracks.composed[side][frame];
    Image<Flow2>& refined = tracks.refined[side][frame];
    if (frame == key) {
      refined = start.Clone();
      return absl::OkStatus();
    }
    const bool is_near = std::abs(frame - key) <= kNearFrames && MeanLength(start) <= kNearMotionPx;
    ASSIGN_OR_RETURN(refined, DenseFlow(window.luma[frame], window.luma[key], is_near ? near : far, &start));
    return absl::OkStatus();
  }));
  return tracks;
}

absl::StatusOr<KeyTracks> FollowOutward(const Window& window, int finest_scale, const StageRunner& run) {
  const DenseFlowOptions options = NearFlowToKeyOptions(finest_scale);
  KeyTracks tracks{NoTracks(window), NoTracks(window)};
  RETURN_IF_ERROR(run.SideBySide(4, [&](int i) -> absl::Status {
    const int side = i % 2, step = i < 2 ? 1 : -1, key = window.KeyFrame(side);
    const int width = window.color[key].width(), height = window.color[key].height();
    std::vector<Image<Flow2>>& motion = tracks.refined[side];
    if (step > 0) motion[key] = Image<Flow2>(width, height);
    const Image<Flow2> still(width, height);
    const int last_needed = window.Target(step > 0 ? window.target_count - 1 : 0);
    for (int frame = key + step; step * frame <= step * last_needed; frame += step) {
      const Image<Flow2>& last = frame - step == key ? still : motion[frame - step];
      const Image<Flow2>& before = std::abs(frame - key) <= 2 ? still : motion[frame - 2 * step];
      const Image<Flow2> start = Extrapolate(before, last);
      ASSIGN_OR_RETURN(motion[frame], DenseFlow(window.luma[frame], window.luma[key], options, &start));
    }
    return absl::OkStatus();
  }));
  return tracks;
}

}  // namespace depthtween
