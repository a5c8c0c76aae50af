#include "core/upsample/pipeline.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/fill/weighted_median.h"
#include "core/flow/dense_flow.h"
#include "core/flow/lost_motion.h"
#include "core/upsample/causal.h"
#include "core/upsample/choose.h"
#include "core/upsample/fuse.h"
#include "core/upsample/key_surface.h"
#include "core/upsample/keys.h"
#include "core/upsample/motion_options.h"
#include "core/upsample/silhouettes.h"
#include "core/upsample/stage_runner.h"
#include "core/upsample/thin_motion.h"
#include "core/upsample/uncertainty.h"

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

// Motion to a key as it would be one frame further from it, had everything gone on as it went: what moves takes its
// motion along, and where things meet the faster wins, which hides the slower more often than not.
Image<Flow2> GoOn(const Image<Flow2>& before, const Image<Flow2>& last) {
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
  // What nothing came to goes on in place.
  for (size_t p = 0; p < next.pixel_count(); ++p)
    if (speed2.data()[p] < 0)
      next.data()[p] = {2 * last.data()[p].u - before.data()[p].u, 2 * last.data()[p].v - before.data()[p].v};
  return next;
}

// The colour frames that one interval looks at: its own and those of its keys.
struct Window {
  int first = 0;
  std::vector<Image<Rgb8>> color;
  std::vector<Image<uint8_t>> luma;
  int size() const { return static_cast<int>(color.size()); }
};

// Runs the stages of one interval, timing each.
class IntervalRun {
 public:
  IntervalRun(const FrameSource& source, const ClipConstants& constants, const Interval& interval,
              const PipelineOptions& options, const RunContext& context)
      : source_(source),
        interval_(interval),
        options_(options),
        context_(context),
        noise_{static_cast<float>(constants.noise_a_m), static_cast<float>(constants.noise_b_per_m)},
        stages_(context) {}

  absl::StatusOr<IntervalSummary> Run(const FrameSink& sink) {
    if (interval_.Held()) {
      RETURN_IF_ERROR(stages_.Stage("hold", [&] { return Hold(sink); }));
    } else {
      RETURN_IF_ERROR(stages_.Stage("read", [&] { return Read(); }));
      RETURN_IF_ERROR(stages_.Stage("flow", [&] { return FlowBetweenNeighbours(); }));
      RETURN_IF_ERROR(stages_.Stage("keys", [&] { return PrepareKeys(); }));
      RETURN_IF_ERROR(stages_.Stage("track", [&] { return FlowToKeys(); }));
      RETURN_IF_ERROR(stages_.Stage("solve", [&] { return SolveMotion(); }));
      RETURN_IF_ERROR(stages_.Stage("draw", [&] { return DrawKeys(); }));
      RETURN_IF_ERROR(stages_.Stage("thin", [&] { return FollowThinThings(); }));
      RETURN_IF_ERROR(stages_.Stage("choose", [&] { return ChooseAndFuse(); }));
      RETURN_IF_ERROR(stages_.Stage("edges", [&] { return SettleEdges(); }));
      RETURN_IF_ERROR(stages_.Stage("silhouettes", [&] { return DecideSilhouettes(); }));
      RETURN_IF_ERROR(stages_.Stage("deliver", [&] { return Deliver(sink); }));
    }
    return stages_.Complete(interval_.frame_count);
  }

 private:
  int FrameInWindow(int i) const { return interval_.first_frame + i - window_.first; }
  int KeyInWindow(int side) const { return keys_[side].color_index - window_.first; }
  // The frame's time between the keys, 0..1; stamps decide, not indices.
  float Tau(int in_window) const {
    const auto since =
        static_cast<double>(source_.sequence().color[window_.first + in_window].time_ns - keys_[0].time_ns);
    return static_cast<float>(std::clamp(since / static_cast<double>(keys_[1].time_ns - keys_[0].time_ns), 0.0, 1.0));
  }

  absl::Status Read() {
    keys_[0] = LocateKey(source_.sequence(), interval_.key_before);
    keys_[1] = LocateKey(source_.sequence(), interval_.key_after);
    int first = interval_.first_frame, last = interval_.first_frame + interval_.frame_count - 1;
    for (const Key& key : keys_)
      for (const int index : {key.color_index, key.toward})
        if (index >= 0) first = std::min(first, index), last = std::max(last, index);
    window_.first = first;
    const int count = last - first + 1;
    window_.color.resize(count);
    window_.luma.resize(count);
    return stages_.SideBySide(count + 2, [&](int i) -> absl::Status {
      if (i < 2) {
        ASSIGN_OR_RETURN(measured_[i], source_.Depth(i == 0 ? interval_.key_before : interval_.key_after));
        return absl::OkStatus();
      }
      ASSIGN_OR_RETURN(window_.color[i - 2], source_.Color(first + i - 2));
      window_.luma[i - 2] = Luma(window_.color[i - 2]);
      return absl::OkStatus();
    });
  }

  // Whether depth is computed from flow between neighbours. Who follows motion to the keys needs it only to move depth
  // frames that were taken between two colour frames.
  bool TakesNeighbourFlow() const { return !options_.follow || options_.draw || options_.witnesses; }
  bool NeedsFlowOf(int pair) const {
    if (TakesNeighbourFlow() || context_.want_motion) return true;
    return std::any_of(std::begin(keys_), std::end(keys_), [&](const Key& key) {
      return key.toward >= 0 && std::min(key.color_index, key.toward) - window_.first == pair;
    });
  }

  absl::Status FlowBetweenNeighbours() {
    const int pairs = window_.size() - 1;
    forward_.resize(pairs);
    backward_.resize(pairs);
    RETURN_IF_ERROR(stages_.SideBySide(2 * pairs, [&](int i) -> absl::Status {
      const int pair = i / 2;
      if (!NeedsFlowOf(pair)) return absl::OkStatus();
      const auto& a = window_.luma[pair];
      const auto& b = window_.luma[pair + 1];
      if (i % 2 == 0) {
        ASSIGN_OR_RETURN(forward_[pair], DenseFlow(a, b, kNeighbourFlow));
      } else {
        ASSIGN_OR_RETURN(backward_[pair], DenseFlow(b, a, kNeighbourFlow));
      }
      return absl::OkStatus();
    }));
    return stages_.SideBySide(pairs, [&](int pair) {
      if (options_.recover && NeedsFlowOf(pair))
        RecoverLostMotion(window_.luma[pair], window_.luma[pair + 1], forward_[pair], backward_[pair]);
      return absl::OkStatus();
    });
  }

  absl::Status PrepareKeys() {
    return stages_.SideBySide(2, [&](int side) -> absl::Status {
      Key& key = keys_[side];
      const int at = KeyInWindow(side);
      if (key.toward >= 0) {
        const auto& flow = key.toward > key.color_index ? forward_[at] : backward_[at - 1];
        measured_[side] = MoveDepthToColorFrame(measured_[side], flow, key.fraction);
      }
      ASSIGN_OR_RETURN(const Image<float> settled, Settle(side));
      PrepareKey(settled, window_.color[at], noise_, 1, key);
      return absl::OkStatus();
    });
  }

  // The depth frames before and after a key are witnesses of what stood still; those beyond them too, as long as the
  // camera itself did: a plain wall looks still however the camera moves.
  absl::StatusOr<Image<float>> Settle(int side) {
    const int index = side == 0 ? interval_.key_before : interval_.key_after;
    const Image<Rgb8>& here = window_.color[KeyInWindow(side)];
    std::vector<Image<float>> depth;
    std::vector<Image<Rgb8>> color;
    for (const int direction : {-1, 1})
      for (int d = 1; d <= options_.settle_reach; ++d) {
        const int other = index + direction * d;
        if (other < 0 || other >= static_cast<int>(source_.sequence().depth.size())) break;
        ASSIGN_OR_RETURN(Image<Rgb8> there, source_.Color(LocateKey(source_.sequence(), other).color_index));
        const bool stood_still = CameraStoodStill(here, there);
        if (d > 1 && !stood_still) break;
        ASSIGN_OR_RETURN(depth.emplace_back(), source_.Depth(other));
        color.push_back(std::move(there));
        if (!stood_still) break;
      }
    std::vector<DepthWitness> witnesses;
    for (size_t i = 0; i < depth.size(); ++i) witnesses.push_back({depth[i], color[i]});
    return SettleWhereStill(measured_[side], here, witnesses, noise_, 1);
  }

  // Motion from each frame of the window to the keys.
  absl::Status FlowToKeys() {
    for (int side = 0; side < 2; ++side) composed_[side].resize(window_.size()), refined_[side].resize(window_.size());
    return options_.follow ? FollowToKeys() : ComposeToKeys();
  }

  // Frame by frame outward from the key. What one frame gets wrong the next starts from: with the coarser search that
  // does for refining, errors are up to 15 % higher where motion is fast.
  absl::Status FollowToKeys() {
    const DenseFlowOptions options = NearFlowToKeyOptions(options_.flow_finest_scale);
    return stages_.SideBySide(4, [&](int i) -> absl::Status {
      const int side = i % 2, step = i < 2 ? 1 : -1, key = KeyInWindow(side);
      const int width = window_.color[key].width(), height = window_.color[key].height();
      std::vector<Image<Flow2>>& motion = refined_[side];
      if (step > 0) motion[key] = Image<Flow2>(width, height);
      const Image<Flow2> still(width, height);
      const int last_needed = FrameInWindow(step > 0 ? interval_.frame_count - 1 : 0);
      for (int frame = key + step; step * frame <= step * last_needed; frame += step) {
        const Image<Flow2>& last = frame - step == key ? still : motion[frame - step];
        const Image<Flow2>& before = std::abs(frame - key) <= 2 ? still : motion[frame - 2 * step];
        const Image<Flow2> start = GoOn(before, last);
        ASSIGN_OR_RETURN(motion[frame], DenseFlow(window_.luma[frame], window_.luma[key], options, &start));
      }
      return absl::OkStatus();
    });
  }

  // Composed step by step outward from the key, then refined directly.
  absl::Status ComposeToKeys() {
    const int count = window_.size();
    const DenseFlowOptions far = FlowToKeyOptions(options_.flow_finest_scale);
    const DenseFlowOptions near = NearFlowToKeyOptions(options_.flow_finest_scale);
    RETURN_IF_ERROR(stages_.SideBySide(2, [&](int side) {
      const int key = KeyInWindow(side);
      composed_[side][key] = Image<Flow2>(window_.color[key].width(), window_.color[key].height());
      for (int s = key + 1; s < count; ++s) composed_[side][s] = Compose(backward_[s - 1], composed_[side][s - 1]);
      for (int s = key - 1; s >= 0; --s) composed_[side][s] = Compose(forward_[s], composed_[side][s + 1]);
      return absl::OkStatus();
    }));
    return stages_.SideBySide(2 * interval_.frame_count, [&](int i) -> absl::Status {
      const int side = i % 2, frame = FrameInWindow(i / 2), key = KeyInWindow(side);
      if (frame == key) {
        refined_[side][frame] = composed_[side][frame].Clone();
        return absl::OkStatus();
      }
      const Image<Flow2>& start = composed_[side][frame];
      const bool is_near = std::abs(frame - key) <= kNearFrames && MeanLength(start) <= kNearMotionPx;
      ASSIGN_OR_RETURN(refined_[side][frame],
                       DenseFlow(window_.luma[frame], window_.luma[key], is_near ? near : far, &start));
      return absl::OkStatus();
    });
  }

  // The way from one key to the other, at the stamps of the colour frames that the keys are seen in.
  SolveProblem PathFrom(int side) const {
    const auto seen = [&](int s) {
      return SolveKey{keys_[s].depth_m, window_.color[KeyInWindow(s)], window_.luma[KeyInWindow(s)]};
    };
    SolveProblem path{.camera = source_.sequence().camera, .key = seen(side), .other = seen(1 - side), .noise = noise_};
    const int key = KeyInWindow(side), other = KeyInWindow(1 - side), step = side == 0 ? 1 : -1;
    const auto stamp = [&](int frame) {
      return static_cast<double>(source_.sequence().color[window_.first + frame].time_ns);
    };
    for (int s = key; s != other; s += step) {
      const int pair = std::min(s, s + step);
      path.frames.push_back({.time = static_cast<float>((stamp(s + step) - stamp(key)) / (stamp(other) - stamp(key))),
                             .luma = window_.luma[s + step],
                             .forward = side == 0 ? forward_[pair] : backward_[pair],
                             .back = side == 0 ? backward_[pair] : forward_[pair]});
    }
    return path;
  }

  absl::Status SolveMotion() {
    if (!options_.draw) return absl::OkStatus();
    return stages_.SideBySide(2, [&](int side) -> absl::Status {
      if (options_.solve) {
        ASSIGN_OR_RETURN(surfaces_[side], KeySurface::Solved(PathFrom(side), options_.solver));
      } else {
        surfaces_[side] = KeySurface::AlongFlow(PathFrom(side));
      }
      return absl::OkStatus();
    });
  }

  // Each key's surface as each frame sees it.
  absl::Status DrawKeys() {
    for (int side = 0; side < 2; ++side) drawn_[side].resize(window_.size());
    if (!options_.draw) return absl::OkStatus();
    RETURN_IF_ERROR(stages_.SideBySide(2 * interval_.frame_count, [&](int i) {
      const int side = i % 2, frame = FrameInWindow(i / 2), steps = std::abs(frame - KeyInWindow(side));
      if (steps > 0) drawn_[side][frame] = surfaces_[side]->MotionSeenIn(steps - 1);
      return absl::OkStatus();
    }));
    for (std::optional<KeySurface>& surface : surfaces_) surface.reset();
    return absl::OkStatus();
  }

  // Both ways from both keys, as frames before the first key's or after the last one's may be asked for.
  absl::Status FollowThinThings() {
    for (int side = 0; side < 2; ++side) thin_[side].resize(window_.size());
    if (!options_.thin) return absl::OkStatus();
    return stages_.SideBySide(4, [&](int i) {
      const int side = i % 2, step = i < 2 ? 1 : -1, key = KeyInWindow(side);
      const int last = FrameInWindow(step > 0 ? interval_.frame_count - 1 : 0);
      if (step * key >= step * last) return absl::OkStatus();
      ThinMotion things(keys_[side], window_.color[key], noise_);
      const Image<Flow2> nothing_moves;
      for (int frame = key + step; step * frame <= step * last; frame += step) {
        const Image<Flow2>& from_last = step > 0 ? forward_[frame - 1] : backward_[frame];
        thin_[side][frame] = things.Follow(window_.color[frame], TakesNeighbourFlow() ? from_last : nothing_moves);
      }
      return absl::OkStatus();
    });
  }

  absl::Status ChooseAndFuse() {
    fused_.resize(interval_.frame_count);
    choices_.resize(interval_.frame_count);
    const int inner = ThreadsPerFrame();
    return stages_.SideBySide(interval_.frame_count, [&](int i) {
      const int frame = FrameInWindow(i);
      const auto& color = window_.color[frame];
      const MatchImage target(color);
      const Image<Flow2> still(color.width(), color.height());
      ChooseInput input{.target = &target, .keys = {&keys_[0], &keys_[1]}, .tau = Tau(frame), .noise = noise_};
      for (int side = 0; side < 2; ++side)
        for (const Image<Flow2>* motion :
             {&std::as_const(refined_[side][frame]), &std::as_const(composed_[side][frame]),
              &std::as_const(drawn_[side][frame]), &std::as_const(thin_[side][frame]), &still})
          if (!motion->empty()) input.proposals[side].push_back(*motion);
      for (int side = 0; side < 2; ++side) input.thin[side] = thin_[side][frame];
      choices_[i] = Choose(input, {.sweeps = options_.sweeps}, inner);
      fused_[i] = Fuse(input, choices_[i], inner);
      // Nothing else looks at these again; a long interval holds many.
      for (auto* motions : {composed_, refined_, drawn_, thin_})
        for (int side = 0; side < 2; ++side) motions[side][frame] = {};
      return absl::OkStatus();
    });
  }

  int ThreadsPerFrame() const { return std::max(1, context_.threads / std::max(1, interval_.frame_count)); }

  // Frames were decided one by one, so near silhouettes each errs in its own way: a median over the frames around it
  // moves an edge to where most of them, and the colours of this one, see it.
  absl::Status SettleEdges() {
    settled_.resize(interval_.frame_count);
    Image<float> key_confidence[2];
    for (int side = 0; side < 2; ++side) {
      const Image<float>& distance = keys_[side].distance;
      key_confidence[side] = Image<float>(distance.width(), distance.height());
      for (size_t p = 0; p < distance.pixel_count(); ++p)
        key_confidence[side].data()[p] = 1.0F / (1.0F + distance.data()[p]);
    }
    // Who may vote for a frame of the window: its own result, else the key that is seen in it.
    const auto voters_of = [&](int frame) -> MedianVoters {
      const int i = frame - FrameInWindow(0);
      if (i >= 0 && i < interval_.frame_count) return {fused_[i].depth_m, fused_[i].confidence, window_.color[frame]};
      for (int side = 0; side < 2; ++side)
        if (KeyInWindow(side) == frame) return {keys_[side].depth_m, key_confidence[side], window_.color[frame]};
      return {};
    };
    const int inner = ThreadsPerFrame();
    return stages_.SideBySide(interval_.frame_count, [&](int i) {
      const int frame = FrameInWindow(i);
      std::vector<MedianWitness> witnesses;
      for (const int direction : {-1, 1}) {
        std::vector<ImageView<const Flow2>> steps;
        for (int d = 1; options_.witnesses && options_.median_radius > 0 && d <= kWitnessFrames; ++d) {
          const int at = frame + direction * d;
          if (at < 0 || at >= window_.size()) break;
          const MedianVoters voters = voters_of(at);
          if (voters.depth_m.empty()) break;
          steps.push_back(direction > 0 ? forward_[at - 1] : backward_[at]);
          witnesses.push_back({voters, [steps](int x, int y) { return FollowFlows(steps, x, y); },
                               std::pow(kWitnessWeight, static_cast<float>(d))});
        }
      }
      settled_[i] = MedianNearJumps(fused_[i], window_.color[frame], witnesses, options_.median_radius, noise_, inner);
      return absl::OkStatus();
    });
  }

  // What is left are pixels beside a jump; all frames of the interval together know better on which side they lie. Each
  // pass sees what the one before decided.
  absl::Status DecideSilhouettes() {
    std::vector<Image<uint8_t>> changed(interval_.frame_count);  // by the pass before
    for (int pass = 0; pass < options_.silhouette_passes; ++pass) {
      const SilhouetteWeights& weights =
          options_.silhouette_weights[std::min(static_cast<size_t>(pass), options_.silhouette_weights.size() - 1)];
      std::vector<SilhouetteFrame> window(window_.size());
      for (int k = 0; k < window_.size(); ++k) {
        const int i = k - FrameInWindow(0);
        window[k] = {.tau = Tau(k), .color = window_.color[k]};
        if (i >= 0 && i < interval_.frame_count) window[k].depth_m = settled_[i];
      }
      std::vector<Image<float>> decided(interval_.frame_count);
      RETURN_IF_ERROR(stages_.SideBySide(interval_.frame_count, [&](int i) {
        const std::vector<SilhouettePixel> pixels = LookAtSilhouettes({.window = window,
                                                                       .target = FrameInWindow(i),
                                                                       .fused = &fused_[i],
                                                                       .choice = &choices_[i],
                                                                       .keys = {&keys_[0], &keys_[1]},
                                                                       .noise = noise_,
                                                                       .changed = changed[i]});
        if (options_.on_silhouettes) options_.on_silhouettes(interval_.first_frame + i, pass, pixels);
        decided[i] = settled_[i].Clone();
        changed[i] = SettleSilhouettes(pixels, weights, decided[i]);
        return absl::OkStatus();
      }));
      settled_ = std::move(decided);
    }
    return absl::OkStatus();
  }

  DepthResult ResultOf(int i) {
    const int frame = FrameInWindow(i);
    DepthResult result{.color_index = interval_.first_frame + i, .depth_m = std::move(settled_[i])};
    result.sigma_m = PredictSigma(result.depth_m, fused_[i], noise_, kBetweenKeys, context_.threads);
    result.provenance = fused_[i].provenance.Clone();
    for (int side = 0; side < 2; ++side)
      if (KeyInWindow(side) == frame) MarkMeasured(keys_[side], result.provenance);
    if (context_.want_motion && frame < static_cast<int>(forward_.size())) {
      result.motion_next = forward_[frame].Clone();
      result.motion_back = backward_[frame].Clone();
    }
    return result;
  }

  absl::Status Deliver(const FrameSink& sink) {
    for (int i = 0; i < interval_.frame_count; ++i) RETURN_IF_ERROR(sink(ResultOf(i)));
    return absl::OkStatus();
  }

  // Outside the first and last key nothing says how depth goes on: the key stands still, and is marked so.
  absl::Status Hold(const FrameSink& sink) {
    const int key = interval_.key_before >= 0 ? interval_.key_before : interval_.key_after;
    ASSIGN_OR_RETURN(const Image<float> depth, source_.Depth(key));
    const int64_t key_time = source_.sequence().depth[key].time_ns;
    for (int i = 0; i < interval_.frame_count; ++i) {
      const int frame = interval_.first_frame + i;
      const bool coincides = source_.sequence().color[frame].time_ns == key_time;
      DepthResult result{.color_index = frame,
                         .depth_m = depth.Clone(),
                         .sigma_m = Image<float>(depth.width(), depth.height()),
                         .provenance = Image<Provenance>(depth.width(), depth.height())};
      for (size_t p = 0; p < depth.pixel_count(); ++p) {
        const float z = depth.data()[p];
        if (z <= 0) continue;
        result.sigma_m.data()[p] = noise_.At(z);
        result.provenance.data()[p] = coincides ? Provenance::kMeasured : Provenance::kHeld;
      }
      RETURN_IF_ERROR(sink(std::move(result)));
    }
    return absl::OkStatus();
  }

  const FrameSource& source_;
  const Interval interval_;
  const PipelineOptions options_;
  const RunContext& context_;
  const DepthNoise noise_;
  StageRunner stages_;

  Window window_;
  Image<float> measured_[2];
  Key keys_[2];
  std::vector<Image<Flow2>> forward_, backward_;                             // [i]: frame i <-> i + 1 of the window
  std::vector<Image<Flow2>> composed_[2], refined_[2], drawn_[2], thin_[2];  // [side][frame of the window]: to the key
  std::optional<KeySurface> surfaces_[2];
  std::vector<Choice> choices_;        // [frame of the interval]
  std::vector<Fused> fused_;           // [frame of the interval]
  std::vector<Image<float>> settled_;  // [frame of the interval]: depth, metres
};

class Pipeline : public Upsampler {
 public:
  explicit Pipeline(const PipelineOptions& options) : options_(options) {}
  std::string_view name() const override { return "ours"; }
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override {
    if (options_.causal) return RunCausally(source, constants, interval, options_, context, sink);
    return IntervalRun(source, constants, interval, options_, context).Run(sink);
  }

 private:
  const PipelineOptions options_;
};

// What PartNames() names, but for the parts of the solve.
struct Part {
  std::string_view name;
  bool (*used)(const PipelineOptions& options);
  void (*leave_out)(PipelineOptions& options);
};
constexpr Part kParts[] = {
    {"settle", [](const auto& o) { return o.settle_reach > 0; }, [](auto& o) { o.settle_reach = 0; }},
    {"recover", [](const auto& o) { return o.recover; }, [](auto& o) { o.recover = false; }},
    {"thin", [](const auto& o) { return o.thin; }, [](auto& o) { o.thin = false; }},
    {"draw", [](const auto& o) { return o.draw; }, [](auto& o) { o.draw = false; }},
    {"solve", [](const auto& o) { return o.draw && o.solve; }, [](auto& o) { o.solve = false; }},
    {"propagation", [](const auto& o) { return o.sweeps > 0; }, [](auto& o) { o.sweeps = 0; }},
    {"median", [](const auto& o) { return o.median_radius > 0; }, [](auto& o) { o.median_radius = 0; }},
    {"witnesses", [](const auto& o) { return o.witnesses; }, [](auto& o) { o.witnesses = false; }},
    {"silhouettes", [](const auto& o) { return o.silhouette_passes > 0; }, [](auto& o) { o.silhouette_passes = 0; }},
};
const Part* FindPart(std::string_view name) {
  const auto* const part =
      std::find_if(std::begin(kParts), std::end(kParts), [&](const Part& p) { return p.name == name; });
  return part == std::end(kParts) ? nullptr : part;
}

}  // namespace

absl::StatusOr<PipelineOptions> PipelineOptions::ForPreset(std::string_view name) {
  if (name == "fast")
    return PipelineOptions{.sweeps = 1,
                           .silhouette_passes = 0,
                           .settle_reach = 1,
                           .flow_finest_scale = 1,
                           .follow = true,
                           .witnesses = false};
  if (name == "balanced") return PipelineOptions{};
  if (name == "best") return PipelineOptions{.sweeps = 3, .silhouette_passes = 4, .draw = true};
  if (name == "reference") {
    PipelineOptions options{.sweeps = 3, .silhouette_passes = 4, .draw = true, .solve = true};
    options.solver = SolveOptions::Reference();
    return options;
  }
  return absl::InvalidArgumentError(absl::StrFormat("preset '%s' is not known: the presets are %s", std::string(name),
                                                    absl::StrJoin(PresetNames(), ", ")));
}

bool PipelineOptions::Uses(std::string_view part) const {
  const Part* const known = FindPart(part);
  return known != nullptr ? known->used(*this) : draw && solve && solver.Uses(part);
}

absl::Status PipelineOptions::SwitchOff(std::string_view part) {
  const Part* const known = FindPart(part);
  if (known == nullptr && solver.SwitchOff(part).ok()) return absl::OkStatus();
  if (known == nullptr)
    return absl::InvalidArgumentError(absl::StrFormat("'%s' cannot be switched off: the parts are %s",
                                                      std::string(part), absl::StrJoin(PartNames(), ", ")));
  known->leave_out(*this);
  return absl::OkStatus();
}

absl::Status PipelineOptions::Validate() const {
  const auto error = [](const char* field, int value, const char* rule) {
    return absl::InvalidArgumentError(absl::StrFormat("PipelineOptions.%s = %d, must be %s", field, value, rule));
  };
  if (sweeps < 0 || sweeps > 20) return error("sweeps", sweeps, "between 0 and 20");
  if (median_radius < 0 || median_radius > 15) return error("median_radius", median_radius, "between 0 and 15");
  if (silhouette_passes < 0 || silhouette_passes > 20)
    return error("silhouette_passes", silhouette_passes, "between 0 and 20");
  if (silhouette_weights.empty())
    return absl::InvalidArgumentError(
        "PipelineOptions.silhouette_weights is empty, must have a set for one pass at least");
  if (settle_reach < 0 || settle_reach > kMaxWitnesses / 2)
    return error("settle_reach", settle_reach, "between 0 and 4");
  if (flow_finest_scale < 0 || flow_finest_scale > 5)
    return error("flow_finest_scale", flow_finest_scale, "between 0 and 5");
  return solver.Validate();
}

const std::vector<PipelineParameter>& PipelineParameters() {
  using Options = PipelineOptions;
  static const auto* const kParameters = new std::vector<PipelineParameter>{
      {"sweeps",
       {0, 1, 2, 3, 5},
       [](const Options& o) { return static_cast<double>(o.sweeps); },
       [](Options& o, double value) { o.sweeps = static_cast<int>(value); }},
      {"median_radius",
       {0, 1, 2, 3, 4, 6},
       [](const Options& o) { return static_cast<double>(o.median_radius); },
       [](Options& o, double value) { o.median_radius = static_cast<int>(value); }},
      {"silhouette_passes",
       {0, 1, 2, 4},
       [](const Options& o) { return static_cast<double>(o.silhouette_passes); },
       [](Options& o, double value) { o.silhouette_passes = static_cast<int>(value); }},
      {"settle_reach",
       {0, 1, 2, 3, 4},
       [](const Options& o) { return static_cast<double>(o.settle_reach); },
       [](Options& o, double value) { o.settle_reach = static_cast<int>(value); }},
      {"flow_finest_scale",
       {0, 1, 2},
       [](const Options& o) { return static_cast<double>(o.flow_finest_scale); },
       [](Options& o, double value) { o.flow_finest_scale = static_cast<int>(value); }},
  };
  return *kParameters;
}

std::unique_ptr<Upsampler> MakePipeline(const PipelineOptions& options) { return std::make_unique<Pipeline>(options); }

}  // namespace depthtween
