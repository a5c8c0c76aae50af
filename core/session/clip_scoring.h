// Scores any number of methods on the same clip against the same truth: what `evaluate` and the self-check share.
//
// A method is an Upsampler; a stored result is one too (StoredResult). What methods answer is rounded to the units that
// results are stored in, so that a method computed here gets the numbers that its stored result gets.
#ifndef DEPTHTWEEN_CORE_SESSION_CLIP_SCORING_H_
#define DEPTHTWEEN_CORE_SESSION_CLIP_SCORING_H_

#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"
#include "core/metrics/comparison.h"
#include "core/session/clip_truth.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

struct ScoredMethod {
  std::string name;
  const Upsampler* upsampler = nullptr;  // not null
  bool any_frame = false;       // Run also takes a part of an interval, as baselines do: only frames with truth are run
  bool predicts_sigma = false;  // its uncertainty is scored
};

struct ScoringOptions {
  ClipAlignment alignment;
  int key_every = 1;
  ClipConstants constants;
  float far_m = kFarthestTruthM;  // truth beyond is not scored
  int threads = 1;                // does not change the numbers. >= 1
  std::stop_token stop = {};
  // What the sensor floor is measured on: runs of consecutive depth maps of the reference. None: all of them.
  std::optional<std::vector<std::vector<int>>> floor_runs = std::nullopt;
  // Called before each scored frame, from the calling thread. May be empty.
  std::function<void(int done, int total)> on_frame = nullptr;
  // Called whenever some of the work on a frame is done, from any thread. May be empty.
  std::function<void()> on_item = nullptr;
  // Called with each scored frame and what the methods, in their order, say of it; valid during the call. May be empty.
  std::function<void(const TruthFrame& truth, std::span<const MethodFrame> estimates)> on_scored = nullptr;
};

struct ClipScores {
  int key_every = 1;
  std::string truth;                     // "gt/depth" or "left-out depth maps"
  float far_m = kFarthestTruthM;         // truth beyond was not scored
  ComparisonScore score;                 // methods in the order given
  std::vector<std::string> frame_stems;  // of score.frames
  // What consecutive depth maps of a real sensor differ by where nothing moves; only without gt/depth, and when the
  // camera stands still.
  std::optional<DepthScore> sensor_floor;
  std::vector<std::string> notes;  // truth that was not scored, and why
};

// `truth` is that of `reference` by options.clock and options.key_every. In memory at a time: of each method, one frame
// if all take any frame, else the frames of one interval. Errors: Cancelled when `stop` fires; else what reading and
// methods return.
absl::StatusOr<ClipScores> ScoreMethods(const SequenceFolder& reference, ClipTruth truth,
                                        std::span<const ScoredMethod> methods, const ScoringOptions& options);

// Depth and uncertainty as they come back from a result folder.
DepthResult AsStored(DepthResult result, double depth_scale);

// A finished result as a method: answers from its files; nothing for frames that it does not have.
class StoredResult : public Upsampler {
 public:
  // `frame_of` says which frame of the result each colour frame is, or -1.
  StoredResult(const ResultFolder& result, std::vector<int> frame_of)
      : result_(result), frame_of_(std::move(frame_of)) {}
  std::string_view name() const override { return "stored result"; }
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override;

 private:
  const ResultFolder& result_;
  const std::vector<int> frame_of_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_CLIP_SCORING_H_
