// Upsampling a clip, in the steps that `depthtween-core upsample` takes in one process and the server in several.
//
// Grammar of use:  PrepareClip RunIntervals* AssembleResult  - once per clip; then any intervals, in any order,
// batching and process, all writing into one result folder; then once, when every interval is there. What passes
// between the steps has an exact JSON form, so the bits do not depend on how the work was divided.
#ifndef DEPTHTWEEN_CORE_SESSION_UPSAMPLE_RUN_H_
#define DEPTHTWEEN_CORE_SESSION_UPSAMPLE_RUN_H_

#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/io/result_folder.h"
#include "core/options/upsample_options.h"
#include "core/session/clip_alignment.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// What is decided once per clip.
struct ClipPlan {
  ClipConstants constants;
  ClipAlignment alignment;
  std::vector<Interval> intervals;
};

// From here on the clip is read through ClipSource(recording, plan.alignment, options.key_every).
// Only a clock that is to be estimated takes time: it heeds `stop` and tells `on_clock`, which may be empty, how many
// of its looks at frames are done.
absl::StatusOr<ClipPlan> PrepareClip(const FrameSource& recording, const UpsampleOptions& options,
                                     std::stop_token stop = {},
                                     const std::function<void(int done, int total)>& on_clock = nullptr);

// {"constants": {...}, "clock": {...}, "intervals": [{"index", "first_frame", "frame_count", "held"}], "frames":
// [{"index", "time_ns", "stem"}]}; constants and clock survive the round trip to the last bit.
nlohmann::json ToJson(const ClipPlan& plan, const Sequence& recording);
// FailedPrecondition if the plan was made for another recording or other options.
absl::StatusOr<ClipPlan> ParseClipPlan(std::string_view json, const Sequence& recording,
                                       const UpsampleOptions& options);

nlohmann::json ToJson(const ClipConstants& constants);
// Throws nlohmann::json::exception for JSON that ToJson did not make.
ClipConstants ConstantsFromJson(const nlohmann::json& constants);

// InvalidArgument unless a clip of `interval_count` intervals has [first, first + count), at least one.
absl::Status CheckIntervals(size_t interval_count, int first, int count);

// What became of one interval.
struct IntervalReport {
  int index = -1;
  double seconds = 0.0;  // wall time, writing included; stages add "write", what was left to wait for
  IntervalSummary summary;
  int motion_frames = 0;  // whose motion was written
};

nlohmann::json ToJson(const IntervalReport& report);
absl::StatusOr<IntervalReport> ParseIntervalReport(std::string_view json);

// Is told how a run gets on, on the thread that runs unless said otherwise.
class RunObserver {
 public:
  virtual ~RunObserver() = default;
  virtual void OnStage(int interval, std::string_view stage) = 0;
  // Some more of the stage is done. From any thread.
  virtual void OnItem() {}
  // The frame's files are on the disk.
  virtual void OnFrame(int interval, int frame) = 0;
  // An error ends the run and is returned by it.
  virtual absl::Status OnIntervalDone(const IntervalReport& report) = 0;
};

// Runs plan.intervals[first .. first + count), writes their frames, and reports on each. Of `options` only `threads`
// and NeedsMotion() matter here. Errors: InvalidArgument if there are no such intervals; Cancelled when `stop` fires;
// what source, upsampler, writer and observer return. Frames written before an error are whole and stay.
absl::StatusOr<std::vector<IntervalReport>> RunIntervals(const Upsampler& upsampler, const FrameSource& source,
                                                         const ClipPlan& plan, int first, int count,
                                                         const UpsampleOptions& options, std::stop_token stop,
                                                         const ResultWriter& writer, RunObserver& observer);

// While a result is ended: what takes time heeds `stop`, and is told of, from one thread at a time.
struct AssemblyContext {
  std::stop_token stop;
  std::function<void(int done, int total)> on_scene_flow;  // frames that have it; may be empty
};

// Ends a result: adds scene flow if that was asked for, lists its frames and writes report.json. `reports` are those of
// all intervals, in any order; `sequence_dir` is where the input came from, for those who look at the result later on
// the same machine, or empty; `renders` is a JSON list of what was rendered from it, `self_check` the JSON form of a
// SelfCheck, or null. FailedPrecondition names an interval or frame that is missing, DataLoss an interval that
// has less motion than was written, when scene flow is made from it; Cancelled when `context.stop`
// fires.
absl::Status AssembleResult(const UpsampleOptions& options, const std::string& sequence_dir, const Sequence& sequence,
                            const ClipPlan& plan, const std::vector<IntervalReport>& reports, nlohmann::json renders,
                            nlohmann::json self_check, const ResultWriter& writer, const AssemblyContext& context = {});

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_UPSAMPLE_RUN_H_
