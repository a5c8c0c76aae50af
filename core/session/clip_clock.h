// Which clock the depth frames of a clip are taken by, and the list of frames as an upsampling sees it.
#ifndef DEPTHTWEEN_CORE_SESSION_CLIP_CLOCK_H_
#define DEPTHTWEEN_CORE_SESSION_CLIP_CLOCK_H_

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>

#include "core/base/status.h"
#include "core/capture/synchronise.h"
#include "core/sequence/clock.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// The clock of one clip: what the choice comes to, decided once and then frozen.
struct ClipClock {
  ClockModel model;                       // the identity for stamps and index
  int color_per_depth = 0;                // > 0: pair by index
  std::optional<ClockEstimate> estimate;  // how sure `model` is, if it was measured
};

// EstimateClock, where the streams may be any time apart: those that do not overlap are first brought together so that
// their first frames meet, and the model says both. If it cannot be trusted, the model is that first step.
absl::StatusOr<ClockEstimate> EstimateAnyClock(const FrameSource& recording, const SynchroniseOptions& options);

// Decides. Only an estimate looks at frames, of all depth frames of the recording; it takes `threads`, which do not
// change it, and the rest as SynchroniseOptions has it. Errors: of EstimateClock.
absl::StatusOr<ClipClock> DecideClock(const FrameSource& recording, const ClockChoice& choice, int threads,
                                      std::stop_token stop = {},
                                      const std::function<void(int done, int total)>& on_progress = nullptr);

nlohmann::json ToJson(const ClipClock& clock);
// The field "clock" of a clip plan or report. Throws nlohmann::json::exception if ToJson did not make it.
ClipClock ClockOf(const nlohmann::json& plan_or_report);

// The recording with the stamps of its depth frames put right, where its stamps mean anything: on the colour camera's
// clock, and equal to that of the colour frame they were taken with, as far as jitter allows to tell. What pairing by
// index says does not count.
Sequence ByStamps(const Sequence& recording, const ClipClock& clock);

// The recording as an upsampling sees it: by stamps or by index, with every `key_every`-th depth frame kept.
Sequence InputOf(const Sequence& recording, const ClipClock& clock, int key_every);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_CLIP_CLOCK_H_
