#include "core/upsample/causal.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/fill/key_cleaning.h"
#include "core/fill/weighted_median.h"
#include "core/flow/dense_flow.h"
#include "core/upsample/choose.h"
#include "core/upsample/fuse.h"
#include "core/upsample/keys.h"
#include "core/upsample/motion_options.h"
#include "core/upsample/stage_runner.h"
#include "core/upsample/thin_motion.h"
#include "core/upsample/uncertainty.h"

namespace depthtween {
namespace {

// Frames are taken together to keep the threads busy, few enough to be held in memory. The bits do not depend on it.
constexpr int kFramesTogether = 8;
// Keys farther apart than so many colour frames say nothing of how a surface goes on.
constexpr int kLongestGapFrames = 64;
// The trend of a pixel is the mean over its layer this far around, pixels: single pixels tell mostly of noise.
constexpr int kTrendRadius = 3;
// A trend goes on for this many gaps between keys; then the surface stands still, for nothing confirms it any more.
constexpr double kTrendGaps = 1.0;
// Two pixels of the frame farther apart than this, in pixels, that land on one pixel of the key are not a stretched
// surface: one of them shows what was hidden, and it is the one that matches worse, by at least this much (sRGB units).
constexpr float kApartPx = 4.0F;
constexpr float kWorseMatch = 2.0F;
// What a filled pixel's vote on edges counts.
constexpr float kGuessConfidence = 0.02F;

// Colour frames that follow one key, or none.
struct Stretch {
  int key = -1;  // into Sequence::depth; -1: nothing was measured yet
  int first_frame = 0;
  int frame_count = 0;
};

// An interval's frames by the last key at or before each: the frame at the very time of the key after belongs to that.
std::vector<Stretch> Stretches(const Sequence& sequence, const Interval& interval) {
  std::vector<Stretch> stretches = {{interval.key_before, interval.first_frame, interval.frame_count}};
  const int last = interval.first_frame + interval.frame_count - 1;
  if (interval.key_after < 0 || sequence.color[last].time_ns < sequence.depth[interval.key_after].time_ns)
    return stretches;
  stretches[0].frame_count -= 1;
  stretches.push_back({interval.key_after, last, 1});
  if (stretches[0].frame_count == 0) stretches.erase(stretches.begin());
  return stretches;
}

// 1 where what a pixel shows was hidden in the key, or outside of it: another pixel has the better claim to the place
// where it lands.
Image<uint8_t> HiddenInKey(const SideChoice& side) {
  const int width = side.motion.width(), height = side.motion.height();
  Image<int> owner(width, height, -1);  // the pixel of the frame that matches best, y * width + x
  const auto landing = [&](int x, int y) {
    const Flow2 m = side.motion(x, y);
    return std::pair(static_cast<int>(std::lround(static_cast<float>(x) + m.u)),
                     static_cast<int>(std::lround(static_cast<float>(y) + m.v)));
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const auto [kx, ky] = landing(x, y);
      if (!owner.Contains(kx, ky)) continue;
      int& best = owner(kx, ky);
      if (best < 0 || side.cost(x, y) < side.cost.data()[best]) best = y * width + x;
    }
  Image<uint8_t> hidden(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const auto [kx, ky] = landing(x, y);
      if (!owner.Contains(kx, ky)) {
        hidden(x, y) = 1;
        continue;
      }
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int claim = owner.Contains(kx + dx, ky + dy) ? owner(kx + dx, ky + dy) : -1;
          if (claim < 0) continue;
          const float apart = std::hypot(static_cast<float>(claim % width - x), static_cast<float>(claim / width - y));
          if (apart > kApartPx && side.cost.data()[claim] + kWorseMatch < side.cost(x, y)) hidden(x, y) = 1;
        }
    }
  return hidden;
}

// What is known of one colour frame.
struct Frame {
  int index = -1;
  Image<Rgb8> color;
  Image<uint8_t> luma;
  Image<Flow2> step_back;          // to the frame before; empty for the key's own
  Image<Flow2> composed, refined;  // to the key
  Image<Flow2> thin;               // the same, of thin things alone; may be empty
  Fused fused;
  DepthResult result;
};

// One interval, frame after frame.
class CausalRun {
 public:
  CausalRun(const FrameSource& source, const ClipConstants& constants, const Interval& interval,
            const PipelineOptions& options, const RunContext& context)
      : source_(source),
        interval_(interval),
        options_(options),
        context_(context),
        noise_{static_cast<float>(constants.noise_a_m), static_cast<float>(constants.noise_b_per_m)},
        stages_(context) {}

  absl::StatusOr<IntervalSummary> Run(const FrameSink& sink) {
    for (const Stretch& stretch : Stretches(source_.sequence(), interval_)) {
      if (stretch.key < 0) {
        RETURN_IF_ERROR(stages_.Stage("deliver", [&] { return DeliverUnknown(stretch, sink); }));
        continue;
      }
      RETURN_IF_ERROR(stages_.Stage("keys", [&] { return TakeKey(stretch.key); }));
      RETURN_IF_ERROR(stages_.Stage("trend", [&] { return FindTrend(stretch.key); }));
      const int end = stretch.first_frame + stretch.frame_count;
      for (int first = stretch.first_frame; first < end; first += kFramesTogether) {
        const int count = std::min(kFramesTogether, end - first);
        RETURN_IF_ERROR(stages_.Stage("read", [&] { return Read(first, count); }));
        RETURN_IF_ERROR(stages_.Stage("flow", [&] { return StepBack(); }));
        RETURN_IF_ERROR(stages_.Stage("track", [&] { return FlowToKey(); }));
        RETURN_IF_ERROR(stages_.Stage("thin", [&] { return FollowThinThings(); }));
        RETURN_IF_ERROR(stages_.Stage("choose", [&] { return ChooseAndGoOn(); }));
        RETURN_IF_ERROR(stages_.Stage("edges", [&] { return SettleEdges(); }));
        RETURN_IF_ERROR(stages_.Stage("deliver", [&] { return Deliver(sink); }));
      }
    }
    return stages_.Complete(interval_.frame_count);
  }

 private:
  absl::StatusOr<Frame> ReadFrame(int index) const {
    Frame frame{.index = index};
    ASSIGN_OR_RETURN(frame.color, source_.Color(index));
    frame.luma = Luma(frame.color);
    return frame;
  }

  // A depth frame on the grid of its colour frame `frame`.
  absl::StatusOr<Image<float>> Measured(int depth_index, const Key& key, const Frame& frame) const {
    ASSIGN_OR_RETURN(Image<float> depth, ReadDepthFrame(source_, depth_index));
    if (key.toward < 0) return depth;
    ASSIGN_OR_RETURN(const Frame toward, ReadFrame(key.toward));
    ASSIGN_OR_RETURN(const Image<Flow2> flow, DenseFlow(frame.luma, toward.luma, kNeighbourFlow));
    return MoveDepthToColorFrame(depth, flow, key.fraction);
  }

  // Reads the key and makes it ready; the depth frame before is the only witness of what stood still.
  absl::Status TakeKey(int depth_index) {
    key_ = LocateKey(source_.sequence(), depth_index);
    ASSIGN_OR_RETURN(key_frame_, ReadFrame(key_.color_index));
    key_frame_.composed = Image<Flow2>(key_frame_.color.width(), key_frame_.color.height());
    ASSIGN_OR_RETURN(key_measured_m_, Measured(depth_index, key_, key_frame_));
    Image<float> settled = key_measured_m_.Clone();
    if (options_.settle_reach > 0 && depth_index > 0) {
      ASSIGN_OR_RETURN(const Image<float> depth, ReadDepthFrame(source_, depth_index - 1));
      ASSIGN_OR_RETURN(const Image<Rgb8> color,
                       source_.Color(LocateKey(source_.sequence(), depth_index - 1).color_index));
      const std::vector<DepthWitness> witnesses = {{depth, color}};
      settled = SettleWhereStill(settled, key_frame_.color, witnesses, noise_, context_.threads);
    }
    PrepareKey(settled, key_frame_.color, noise_, context_.threads, key_);
    if (options_.thin) thin_things_.emplace(key_, key_frame_.color, noise_);
    last_.clear();
    return absl::OkStatus();
  }

  // How fast each pixel of the key comes or goes, from where its surface was in the key before.
  absl::Status FindTrend(int depth_index) {
    const int width = key_.depth_m.width(), height = key_.depth_m.height();
    trend_mps_ = Image<float>(width, height);
    trend_limit_s_ = 0;
    if (depth_index == 0) return absl::OkStatus();
    Key before = LocateKey(source_.sequence(), depth_index - 1);
    const int steps = key_.color_index - before.color_index;
    if (steps < 1 || steps > kLongestGapFrames) return absl::OkStatus();
    ASSIGN_OR_RETURN(const Frame before_frame, ReadFrame(before.color_index));
    ASSIGN_OR_RETURN(const Image<float> measured, Measured(depth_index - 1, before, before_frame));
    PrepareKey(measured, before_frame.color, noise_, context_.threads, before);

    std::vector<Frame> between(steps + 1);  // from the key before to the key
    std::vector<Image<Flow2>> back(steps);  // [i]: from i + 1 to i
    RETURN_IF_ERROR(stages_.SideBySide(steps + 1, [&](int i) -> absl::Status {
      ASSIGN_OR_RETURN(between[i], ReadFrame(before.color_index + i));
      return absl::OkStatus();
    }));
    RETURN_IF_ERROR(stages_.SideBySide(steps, [&](int i) -> absl::Status {
      ASSIGN_OR_RETURN(back[i], DenseFlow(between[i + 1].luma, between[i].luma, kNeighbourFlow));
      return absl::OkStatus();
    }));
    Image<Flow2> composed = back[steps - 1].Clone();
    for (int i = steps - 2; i >= 0; --i) composed = Compose(composed, back[i]);
    ASSIGN_OR_RETURN(const Image<Flow2> motion, DenseFlow(between[steps].luma, between[0].luma,
                                                          FlowToKeyOptions(options_.flow_finest_scale), &composed));

    const double gap_s = static_cast<double>(key_.time_ns - before.time_ns) * 1e-9;
    Image<float> change(width, height);  // metres; 0 also where it is not known
    Image<uint8_t> known(width, height);
    ParallelRows(height, context_.threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < width; ++x) {
          const Flow2 m = motion(x, y);
          const float u = static_cast<float>(x) + m.u, v = static_cast<float>(y) + m.v;
          const int bx = static_cast<int>(std::lround(u)), by = static_cast<int>(std::lround(v));
          if (key_.distance(x, y) > 0 || !before.distance.Contains(bx, by) || before.distance(bx, by) > 0) continue;
          const float z = key_.depth_m(x, y), was = SampleDepthInLayer(before.depth_m, u, v, noise_);
          if (was <= 0 || z <= 0 || std::abs(z - was) > kSameSurface * std::min(z, was)) continue;
          change(x, y) = z - was;
          known(x, y) = 1;
        }
    });
    trend_limit_s_ = kTrendGaps * gap_s;
    ParallelRows(height, context_.threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y)
        for (int x = 0; x < width; ++x) trend_mps_(x, y) = static_cast<float>(LayerMean(change, known, x, y) / gap_s);
    });
    return absl::OkStatus();
  }

  // The mean of `change` over the layer around a pixel of the key, drawn towards 0 by as much as the changes there
  // scatter about it: a surface that stands still, seen through noise, is to stand still.
  float LayerMean(const Image<float>& change, const Image<uint8_t>& known, int x, int y) const {
    const float z = key_.depth_m(x, y);
    double sum = 0, squares = 0, count = 0;
    for (int ny = std::max(0, y - kTrendRadius); ny <= std::min(change.height() - 1, y + kTrendRadius); ++ny)
      for (int nx = std::max(0, x - kTrendRadius); nx <= std::min(change.width() - 1, x + kTrendRadius); ++nx) {
        if (!known(nx, ny) || !SameLayer(z, key_.depth_m(nx, ny), noise_)) continue;
        const double c = change(nx, ny);
        sum += c, squares += c * c, ++count;
      }
    if (count < 3) return 0.0F;
    const double mean = sum / count, variance = std::max(0.0, squares / count - mean * mean);
    const double noise = static_cast<double>(noise_.At(z));
    return static_cast<float>(mean * mean * mean / (mean * mean + variance + noise * noise));
  }

  absl::Status Read(int first, int count) {
    frames_.clear();
    frames_.resize(count);
    return stages_.SideBySide(count, [&](int i) -> absl::Status {
      ASSIGN_OR_RETURN(frames_[i], ReadFrame(first + i));
      return absl::OkStatus();
    });
  }

  // The frame before frames_[i], none for the key's own.
  const Frame* Before(size_t i) const {
    if (i > 0) return &frames_[i - 1];
    if (!last_.empty()) return &last_.back();
    return frames_[0].index == key_frame_.index ? nullptr : &key_frame_;
  }

  absl::Status StepBack() {
    RETURN_IF_ERROR(stages_.SideBySide(static_cast<int>(frames_.size()), [&](int i) -> absl::Status {
      const Frame* const before = Before(static_cast<size_t>(i));
      if (before == nullptr) return absl::OkStatus();
      ASSIGN_OR_RETURN(frames_[i].step_back, DenseFlow(frames_[i].luma, before->luma, kNeighbourFlow));
      return absl::OkStatus();
    }));
    for (size_t i = 0; i < frames_.size(); ++i) {
      const Frame* const before = Before(i);
      frames_[i].composed =
          before == nullptr ? key_frame_.composed.Clone() : Compose(frames_[i].step_back, before->composed);
    }
    return absl::OkStatus();
  }

  absl::Status FlowToKey() {
    return stages_.SideBySide(static_cast<int>(frames_.size()), [&](int i) -> absl::Status {
      Frame& frame = frames_[i];
      if (frame.index == key_frame_.index) {
        frame.refined = frame.composed.Clone();
        return absl::OkStatus();
      }
      ASSIGN_OR_RETURN(frame.refined, DenseFlow(frame.luma, key_frame_.luma,
                                                FlowToKeyOptions(options_.flow_finest_scale), &frame.composed));
      return absl::OkStatus();
    });
  }

  absl::Status FollowThinThings() {
    if (!thin_things_) return absl::OkStatus();
    for (Frame& frame : frames_)
      if (frame.index != key_frame_.index) frame.thin = thin_things_->Follow(frame.color, {});
    return absl::OkStatus();
  }

  int ThreadsPerFrame() const { return std::max(1, context_.threads / static_cast<int>(frames_.size())); }

  absl::Status ChooseAndGoOn() {
    const int inner = ThreadsPerFrame();
    return stages_.SideBySide(static_cast<int>(frames_.size()), [&](int i) {
      Frame& frame = frames_[i];
      const MatchImage target(frame.color);
      const Image<Flow2> still(frame.color.width(), frame.color.height());
      ChooseInput input{.target = &target, .keys = {&key_, nullptr}, .tau = 0, .noise = noise_};
      input.proposals[0] = {frame.refined, frame.composed, still};
      input.thin[0] = frame.thin;
      if (!frame.thin.empty()) input.proposals[0].push_back(frame.thin);
      const Choice choice = Choose(input, {.sweeps = options_.sweeps}, inner);
      frame.fused = Fuse(input, choice, inner);
      GoOn(choice.sides[0], frame);
      FillHidden(choice.sides[0], frame);
      return absl::OkStatus();
    });
  }

  // Depth goes on as it came.
  void GoOn(const SideChoice& side, Frame& frame) const {
    const double since_s = static_cast<double>(source_.sequence().color[frame.index].time_ns - key_.time_ns) * 1e-9;
    const auto ahead_s = static_cast<float>(std::clamp(since_s, 0.0, trend_limit_s_));
    if (ahead_s <= 0) return;
    Fused& fused = frame.fused;
    for (int y = 0; y < fused.depth_m.height(); ++y)
      for (int x = 0; x < fused.depth_m.width(); ++x) {
        float& z = fused.depth_m(x, y);
        if (z <= 0) continue;
        const Flow2 m = side.motion(x, y);
        const float change = trend_mps_.view().Clamped(static_cast<int>(std::lround(static_cast<float>(x) + m.u)),
                                                       static_cast<int>(std::lround(static_cast<float>(y) + m.v))) *
                             ahead_s;
        const float limited = std::clamp(change, -kSameSurface * z, kSameSurface * z);
        z += limited;
        fused.change_m(x, y) = limited;
      }
  }

  // What the key did not see is beside what it saw, on the side whose colours it has.
  void FillHidden(const SideChoice& side, Frame& frame) const {
    if (frame.index == key_frame_.index) return;
    const Image<uint8_t> hidden = HiddenInKey(side);
    Image<float> seen = frame.fused.depth_m.Clone();
    for (size_t p = 0; p < seen.pixel_count(); ++p)
      if (hidden.data()[p]) seen.data()[p] = 0;
    FilledDepth filled = FillAlongColor(seen, frame.color);
    for (size_t p = 0; p < seen.pixel_count(); ++p) {
      if (!hidden.data()[p] || filled.depth_m.data()[p] <= 0) continue;
      frame.fused.depth_m.data()[p] = filled.depth_m.data()[p];
      frame.fused.confidence.data()[p] = kGuessConfidence;
      frame.fused.provenance.data()[p] = Provenance::kInferred;
    }
  }

  absl::Status SettleEdges() {
    const int inner = ThreadsPerFrame();
    return stages_.SideBySide(static_cast<int>(frames_.size()), [&](int i) {
      Frame& frame = frames_[i];
      std::vector<ImageView<const Flow2>> steps;
      std::vector<MedianWitness> witnesses;
      const Frame* at = &frame;
      for (int d = 0; options_.witnesses && options_.median_radius > 0 && d < kWitnessFrames; ++d) {
        // Index of what lies d + 1 frames before: in this batch, or in the one before.
        const int index = i - d - 1;
        const int in_last = static_cast<int>(last_.size()) + index;
        const Frame* const before = index >= 0 ? &frames_[index] : in_last >= 0 ? &last_[in_last] : nullptr;
        if (before == nullptr || at->step_back.empty()) break;
        steps.push_back(at->step_back);
        witnesses.push_back({{before->fused.depth_m, before->fused.confidence, before->color},
                             [steps](int x, int y) { return FollowFlows(steps, x, y); },
                             std::pow(kWitnessWeight, static_cast<float>(d + 1))});
        at = before;
      }
      frame.result = ResultOf(frame, witnesses, inner);
      return absl::OkStatus();
    });
  }

  DepthResult ResultOf(const Frame& frame, const std::vector<MedianWitness>& witnesses, int threads) const {
    DepthResult result{
        .color_index = frame.index,
        .depth_m = MedianNearJumps(frame.fused, frame.color, witnesses, options_.median_radius, noise_, threads)};
    result.sigma_m = PredictSigma(result.depth_m, frame.fused, noise_, kAfterKey, threads);
    result.provenance = frame.fused.provenance.Clone();
    if (frame.index == key_.color_index) MarkMeasured(key_, key_measured_m_, result.provenance);
    return result;
  }

  absl::Status Deliver(const FrameSink& sink) {
    for (Frame& frame : frames_) {
      RETURN_IF_ERROR(sink(std::move(frame.result)));
      last_.push_back(std::move(frame));
      if (last_.size() > kWitnessFrames) last_.pop_front();
    }
    return absl::OkStatus();
  }

  // Nothing was measured yet.
  absl::Status DeliverUnknown(const Stretch& stretch, const FrameSink& sink) {
    const Camera& camera = source_.sequence().camera;
    for (int i = 0; i < stretch.frame_count; ++i)
      RETURN_IF_ERROR(sink({.color_index = stretch.first_frame + i,
                            .depth_m = Image<float>(camera.width, camera.height),
                            .sigma_m = Image<float>(camera.width, camera.height),
                            .provenance = Image<Provenance>(camera.width, camera.height)}));
    return absl::OkStatus();
  }

  const FrameSource& source_;
  const Interval interval_;
  const PipelineOptions options_;
  const RunContext& context_;
  const DepthNoise noise_;
  StageRunner stages_;

  Key key_;
  Image<float> key_measured_m_;  // its depth frame, in the place of the colour frame it is seen in
  Frame key_frame_;
  std::optional<ThinMotion> thin_things_;  // of the key, followed up to the frame computed last
  Image<float> trend_mps_;  // per pixel of the key, metres a second; 0 where it stands still or nothing is known
  double trend_limit_s_ = 0;
  std::vector<Frame> frames_;  // being computed
  std::deque<Frame> last_;     // the ones before them, of this key
};

class CausalUpsampler : public Upsampler {
 public:
  explicit CausalUpsampler(const PipelineOptions& options) : options_(options) {}
  std::string_view name() const override { return "ours"; }
  KeyReach reach() const override { return {.before = 1}; }  // depth goes on from the key before
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override {
    return CausalRun(source, constants, interval, options_, context).Run(sink);
  }

 private:
  const PipelineOptions options_;
};

}  // namespace

std::unique_ptr<Upsampler> MakeCausalUpsampler(const PipelineOptions& options) {
  return std::make_unique<CausalUpsampler>(options);
}

}  // namespace depthtween
