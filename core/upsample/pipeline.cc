#include "core/upsample/pipeline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "core/fill/key_cleaning.h"
#include "core/fill/weighted_median.h"
#include "core/upsample/choose.h"
#include "core/upsample/fuse.h"
#include "core/upsample/key_surface.h"
#include "core/upsample/keys.h"
#include "core/upsample/motion_options.h"
#include "core/upsample/stage_runner.h"
#include "core/upsample/thin_motion.h"
#include "core/upsample/tracks.h"
#include "core/upsample/uncertainty.h"
#include "core/upsample/window.h"

namespace depthtween {
namespace {

using Keys = std::array<Key, 2>;

// Every source of motion to the keys: what the choice is among.
struct Proposals {
  KeyTracks tracks;
  Tracks drawn;  // by the keys' surfaces, moved and splatted
  Tracks thin;   // of thin things
};

// Per target: what was chosen and what it comes to.
struct Answers {
  std::vector<Choice> choices;
  std::vector<Fused> fused;
};

using DepthMaps = std::vector<Image<float>>;  // per target, metres

// The depth of key `side` of the window, filtered over time. The depth frames before and after a key are witnesses of
// what stood still; those beyond them too, as long as the camera itself did: a plain wall looks still however the
// camera moves.
absl::StatusOr<Image<float>> Settle(const FrameSource& source, int depth_index, ImageView<const float> measured_m,
                                    const Image<Rgb8>& here, int reach, const DepthNoise& noise) {
  std::vector<Image<float>> depth;
  std::vector<Image<Rgb8>> color;
  for (const int direction : {-1, 1})
    for (int d = 1; d <= reach; ++d) {
      const int other = depth_index + direction * d;
      if (other < 0 || other >= static_cast<int>(source.sequence().depth.size())) break;
      ASSIGN_OR_RETURN(Image<Rgb8> there, source.Color(LocateKey(source.sequence(), other).color_index));
      const bool stood_still = CameraStoodStill(here, there);
      if (d > 1 && !stood_still) break;
      ASSIGN_OR_RETURN(depth.emplace_back(), ReadDepthFrame(source, other));
      color.push_back(std::move(there));
      if (!stood_still) break;
    }
  std::vector<DepthWitness> witnesses;
  for (size_t i = 0; i < depth.size(); ++i) witnesses.push_back({depth[i], color[i]});
  return SettleWhereStill(measured_m, here, witnesses, noise, 1);
}

absl::StatusOr<Keys> PrepareKeys(const FrameSource& source, const Interval& interval, const Window& window,
                                 const NeighbourFlow& flow, int settle_reach, const DepthNoise& noise,
                                 const StageRunner& run) {
  Keys keys;
  RETURN_IF_ERROR(run.SideBySide(2, [&](int side) -> absl::Status {
    const int at = window.KeyFrame(side), depth_index = side == 0 ? interval.key_before : interval.key_after;
    Key& key = keys[side] = LocateKey(source.sequence(), depth_index);
    Image<float> moved_m;
    ImageView<const float> measured_m = window.measured_m[side];
    if (key.toward >= 0) {
      const Image<Flow2>& step = key.toward > key.color_index ? flow.forward[at] : flow.backward[at - 1];
      moved_m = MoveDepthToColorFrame(measured_m, step, key.fraction);
      measured_m = moved_m;
    }
    ASSIGN_OR_RETURN(const Image<float> settled,
                     Settle(source, depth_index, measured_m, window.color[at], settle_reach, noise));
    PrepareKey(settled, window.color[at], noise, 1, key);
    return absl::OkStatus();
  }));
  return keys;
}

// The way from one key to the other, at the stamps of the colour frames that the keys are seen in.
SolveProblem PathFrom(const Sequence& sequence, const Window& window, const Keys& keys, const NeighbourFlow& flow,
                      int side, const DepthNoise& noise) {
  const auto seen = [&](int s) {
    return SolveKey{keys[s].depth_m, window.color[window.KeyFrame(s)], window.luma[window.KeyFrame(s)]};
  };
  SolveProblem path{.camera = sequence.camera, .key = seen(side), .other = seen(1 - side), .noise = noise};
  const int key = window.KeyFrame(side), other = window.KeyFrame(1 - side), step = side == 0 ? 1 : -1;
  const auto stamp = [&](int frame) { return static_cast<double>(sequence.color[window.first + frame].time_ns); };
  for (int s = key; s != other; s += step) {
    const int pair = std::min(s, s + step);
    path.frames.push_back({.time = static_cast<float>((stamp(s + step) - stamp(key)) / (stamp(other) - stamp(key))),
                           .luma = window.luma[s + step],
                           .forward = side == 0 ? flow.forward[pair] : flow.backward[pair],
                           .back = side == 0 ? flow.backward[pair] : flow.forward[pair]});
  }
  return path;
}

// Each key's surface on its way to the other key: solved for, or along composed flow.
absl::StatusOr<std::vector<KeySurface>> MoveSurfaces(const Sequence& sequence, const Window& window, const Keys& keys,
                                                     const NeighbourFlow& flow, const PipelineOptions& options,
                                                     const DepthNoise& noise, const StageRunner& run) {
  std::array<absl::StatusOr<KeySurface>, 2> made = {absl::UnknownError(""), absl::UnknownError("")};
  RETURN_IF_ERROR(run.SideBySide(2, [&](int side) {
    const SolveProblem path = PathFrom(sequence, window, keys, flow, side, noise);
    made[side] = options.solve ? KeySurface::Solved(path, options.solver) : KeySurface::AlongFlow(path);
    return made[side].status();
  }));
  std::vector<KeySurface> surfaces;
  for (auto& surface : made) surfaces.push_back(*std::move(surface));
  return surfaces;
}

// Motion to the keys as each target sees their moved surfaces.
absl::StatusOr<Tracks> DrawSurfaces(const Window& window, const std::vector<KeySurface>& surfaces,
                                    const StageRunner& run) {
  Tracks drawn = NoTracks(window);
  RETURN_IF_ERROR(run.SideBySide(2 * window.target_count, [&](int i) {
    const int side = i % 2, frame = window.Target(i / 2), steps = std::abs(frame - window.KeyFrame(side));
    if (steps > 0) drawn[side][frame] = surfaces[side].MotionSeenIn(steps - 1);
    return absl::OkStatus();
  }));
  return drawn;
}

// Both ways from both keys, as targets before the first key's frame or after the last one's may be asked for. Without
// flow, nothing moves from frame to frame.
absl::StatusOr<Tracks> FollowThinThings(const Window& window, const Keys& keys, const NeighbourFlow& flow,
                                        bool has_flow, const DepthNoise& noise, const StageRunner& run) {
  Tracks thin = NoTracks(window);
  RETURN_IF_ERROR(run.SideBySide(4, [&](int i) {
    const int side = i % 2, step = i < 2 ? 1 : -1, key = window.KeyFrame(side);
    const int last = window.Target(step > 0 ? window.target_count - 1 : 0);
    if (step * key >= step * last) return absl::OkStatus();
    ThinMotion things(keys[side], window.color[key], noise);
    const Image<Flow2> nothing_moves;
    for (int frame = key + step; step * frame <= step * last; frame += step) {
      const Image<Flow2>& from_last = step > 0 ? flow.forward[frame - 1] : flow.backward[frame];
      thin[side][frame] = things.Follow(window.color[frame], has_flow ? from_last : nothing_moves);
    }
    return absl::OkStatus();
  }));
  return thin;
}

// Takes the proposals: those of a target are freed when it is decided, as a long interval holds many.
absl::StatusOr<Answers> ChooseAndFuse(const Window& window, const Keys& keys, Proposals proposals, int sweeps,
                                      const DepthNoise& noise, const StageRunner& run) {
  Answers answers;
  answers.choices.resize(window.target_count);
  answers.fused.resize(window.target_count);
  const int inner = window.ThreadsPerTarget(run.threads());
  RETURN_IF_ERROR(run.SideBySide(window.target_count, [&](int i) {
    const int frame = window.Target(i);
    const auto& color = window.color[frame];
    const MatchImage target(color);
    const Image<Flow2> still(color.width(), color.height());
    ChooseInput input{.target = &target, .keys = {&keys[0], &keys[1]}, .tau = window.tau[frame], .noise = noise};
    for (int side = 0; side < 2; ++side) {
      for (const Image<Flow2>* motion :
           {&std::as_const(proposals.tracks.refined[side][frame]),
            &std::as_const(proposals.tracks.composed[side][frame]), &std::as_const(proposals.drawn[side][frame]),
            &std::as_const(proposals.thin[side][frame]), &still})
        if (!motion->empty()) input.proposals[side].push_back(*motion);
      input.thin[side] = proposals.thin[side][frame];
    }
    answers.choices[i] = Choose(input, {.sweeps = sweeps}, inner);
    answers.fused[i] = Fuse(input, answers.choices[i], inner);
    for (Tracks* tracks : {&proposals.tracks.composed, &proposals.tracks.refined, &proposals.drawn, &proposals.thin})
      for (auto& side : *tracks) side[frame] = {};
    return absl::OkStatus();
  }));
  return answers;
}

// Targets were decided one by one, so near silhouettes each errs in its own way: a median over the frames around it
// moves an edge to where most of them, and the colours of this one, see it.
absl::StatusOr<DepthMaps> RefineEdges(const Window& window, const Keys& keys, const NeighbourFlow& flow,
                                      const std::vector<Fused>& fused, const PipelineOptions& options,
                                      const DepthNoise& noise, const StageRunner& run) {
  Image<float> key_confidence[2];
  for (int side = 0; side < 2; ++side) {
    const Image<float>& distance = keys[side].distance;
    key_confidence[side] = Image<float>(distance.width(), distance.height());
    for (size_t p = 0; p < distance.pixel_count(); ++p)
      key_confidence[side].data()[p] = 1.0F / (1.0F + distance.data()[p]);
  }
  // Who may vote for a frame of the window: its own answer, else the key that is seen in it.
  const auto voters_of = [&](int frame) -> MedianVoters {
    const int i = frame - window.first_target;
    if (i >= 0 && i < window.target_count) return {fused[i].depth_m, fused[i].confidence, window.color[frame]};
    for (int side = 0; side < 2; ++side)
      if (window.KeyFrame(side) == frame) return {keys[side].depth_m, key_confidence[side], window.color[frame]};
    return {};
  };
  DepthMaps depth(window.target_count);
  const int inner = window.ThreadsPerTarget(run.threads());
  RETURN_IF_ERROR(run.SideBySide(window.target_count, [&](int i) {
    const int frame = window.Target(i);
    std::vector<MedianWitness> witnesses;
    for (const int direction : {-1, 1}) {
      std::vector<ImageView<const Flow2>> steps;
      for (int d = 1; options.witnesses && options.median_radius > 0 && d <= kWitnessFrames; ++d) {
        const int at = frame + direction * d;
        if (at < 0 || at >= window.size()) break;
        const MedianVoters voters = voters_of(at);
        if (voters.depth_m.empty()) break;
        steps.push_back(direction > 0 ? flow.forward[at - 1] : flow.backward[at]);
        witnesses.push_back({voters, [steps](int x, int y) { return FollowFlows(steps, x, y); },
                             std::pow(kWitnessWeight, static_cast<float>(d))});
      }
    }
    depth[i] = MedianNearJumps(fused[i], window.color[frame], witnesses, options.median_radius, noise, inner);
    return absl::OkStatus();
  }));
  return depth;
}

// What is left are pixels beside a depth edge; all frames of the interval together know better on which side they lie.
// Each pass sees what the one before decided.
absl::StatusOr<DepthMaps> DecideSilhouettes(const Window& window, const Keys& keys, const Answers& answers,
                                            DepthMaps depth, int passes, const SilhouetteDecision& decide,
                                            const DepthNoise& noise, const StageRunner& run) {
  std::vector<Image<uint8_t>> changed(window.target_count);  // by the pass before
  for (int pass = 0; pass < passes; ++pass) {
    std::vector<SilhouetteFrame> frames(window.size());
    for (int k = 0; k < window.size(); ++k) {
      const int i = k - window.first_target;
      frames[k] = {.tau = window.tau[k], .color = window.color[k]};
      if (i >= 0 && i < window.target_count) frames[k].depth_m = depth[i];
    }
    DepthMaps decided(window.target_count);
    RETURN_IF_ERROR(run.SideBySide(window.target_count, [&](int i) {
      const std::vector<SilhouettePixel> pixels = LookAtSilhouettes({.window = frames,
                                                                     .target = window.Target(i),
                                                                     .fused = &answers.fused[i],
                                                                     .choice = &answers.choices[i],
                                                                     .keys = {&keys[0], &keys[1]},
                                                                     .noise = noise,
                                                                     .changed = changed[i]});
      decided[i] = depth[i].Clone();
      changed[i] = decide(window.first + window.Target(i), pass, pixels, decided[i]);
      return absl::OkStatus();
    }));
    depth = std::move(decided);
  }
  return depth;
}

absl::Status Deliver(const Window& window, const Keys& keys, const NeighbourFlow& flow, const std::vector<Fused>& fused,
                     DepthMaps depth, const DepthNoise& noise, const StageRunner& run, const FrameSink& sink) {
  for (int i = 0; i < window.target_count; ++i) {
    const int frame = window.Target(i);
    DepthResult result{.color_index = window.first + frame, .depth_m = std::move(depth[i])};
    result.sigma_m = PredictSigma(result.depth_m, fused[i], noise, kBetweenKeys, run.threads());
    result.provenance = fused[i].provenance.Clone();
    for (int side = 0; side < 2; ++side)
      if (window.KeyFrame(side) == frame) MarkMeasured(keys[side], window.measured_m[side], result.provenance);
    if (run.want_motion() && frame < static_cast<int>(flow.forward.size())) {
      result.motion_next = flow.forward[frame].Clone();
      result.motion_back = flow.backward[frame].Clone();
    }
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return absl::OkStatus();
}

// Outside the first and last key nothing says how depth goes on: the key stands still, and is marked so.
absl::Status Hold(const FrameSource& source, const Interval& interval, const DepthNoise& noise, const FrameSink& sink) {
  const int key = interval.key_before >= 0 ? interval.key_before : interval.key_after;
  ASSIGN_OR_RETURN(const Image<float> depth, ReadDepthFrame(source, key));
  const int64_t key_time = source.sequence().depth[key].time_ns;
  for (int i = 0; i < interval.frame_count; ++i) {
    const int frame = interval.first_frame + i;
    const bool coincides = source.sequence().color[frame].time_ns == key_time;
    DepthResult result{.color_index = frame,
                       .depth_m = depth.Clone(),
                       .sigma_m = Image<float>(depth.width(), depth.height()),
                       .provenance = Image<Provenance>(depth.width(), depth.height())};
    for (size_t p = 0; p < depth.pixel_count(); ++p) {
      const float z = depth.data()[p];
      if (z <= 0) continue;
      result.sigma_m.data()[p] = noise.At(z);
      result.provenance.data()[p] = coincides ? Provenance::kMeasured : Provenance::kHeld;
    }
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return absl::OkStatus();
}

class Pipeline : public Upsampler {
 public:
  Pipeline(const PipelineOptions& options, SilhouetteDecision decide) : options_(options), decide_(std::move(decide)) {}
  std::string_view name() const override { return "ours"; }
  // Witnesses of what stood still lie on both sides.
  KeyReach reach() const override { return {options_.settle_reach, options_.settle_reach}; }

  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override {
    const DepthNoise noise{static_cast<float>(constants.noise_a_m), static_cast<float>(constants.noise_b_per_m)};
    const PipelineOptions& o = options_;
    StageRunner run(context);
    if (interval.Held()) {
      RETURN_IF_ERROR(run.Stage("hold", [&] { return Hold(source, interval, noise, sink); }));
      return run.Complete(interval.frame_count);
    }
    // Who follows motion outward needs flow between neighbours only to move depth frames taken between two colour
    // frames.
    const bool flow_proposes = !o.follow || o.draw || o.witnesses;

    ASSIGN_OR_RETURN(const Window window, run.Stage("read", [&] { return ReadWindow(source, interval, run); }));
    ASSIGN_OR_RETURN(const NeighbourFlow flow, run.Stage("flow", [&] {
      return FlowBetweenNeighbours(window, flow_proposes || run.want_motion(), o.recover, run);
    }));
    ASSIGN_OR_RETURN(const Keys keys, run.Stage("keys", [&] {
      return PrepareKeys(source, interval, window, flow, o.settle_reach, noise, run);
    }));
    Proposals proposals{.drawn = NoTracks(window), .thin = NoTracks(window)};
    ASSIGN_OR_RETURN(proposals.tracks, run.Stage("track", [&] {
      return o.follow ? FollowOutward(window, o.flow_finest_scale, run)
                      : ComposeAndRefine(window, flow, o.flow_finest_scale, run);
    }));
    if (o.draw) {
      ASSIGN_OR_RETURN(const std::vector<KeySurface> surfaces, run.Stage("solve", [&] {
        return MoveSurfaces(source.sequence(), window, keys, flow, o, noise, run);
      }));
      ASSIGN_OR_RETURN(proposals.drawn, run.Stage("draw", [&] { return DrawSurfaces(window, surfaces, run); }));
    }
    if (o.thin) {
      ASSIGN_OR_RETURN(proposals.thin, run.Stage("thin", [&] {
        return FollowThinThings(window, keys, flow, flow_proposes, noise, run);
      }));
    }
    ASSIGN_OR_RETURN(const Answers answers, run.Stage("choose", [&] {
      return ChooseAndFuse(window, keys, std::move(proposals), o.sweeps, noise, run);
    }));
    ASSIGN_OR_RETURN(DepthMaps refined,
                     run.Stage("edges", [&] { return RefineEdges(window, keys, flow, answers.fused, o, noise, run); }));
    ASSIGN_OR_RETURN(DepthMaps depth, run.Stage("silhouettes", [&] {
      return DecideSilhouettes(window, keys, answers, std::move(refined), o.silhouette_passes, decide_, noise, run);
    }));
    RETURN_IF_ERROR(run.Stage(
        "deliver", [&] { return Deliver(window, keys, flow, answers.fused, std::move(depth), noise, run, sink); }));
    return run.Complete(interval.frame_count);
  }

 private:
  const PipelineOptions options_;
  const SilhouetteDecision decide_;
};

}  // namespace

std::unique_ptr<Upsampler> MakePipeline(const PipelineOptions& options, SilhouetteDecision decide) {
  return std::make_unique<Pipeline>(options, std::move(decide));
}

}  // namespace depthtween
