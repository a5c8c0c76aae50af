// How good ours is on the user's own clip, measured before anything is computed from it.
//
// Every second depth frame of the input is held out: keys 0, 2, 4... are input, 1, 3, 5... are truth. Ours and the
// quick baselines answer the colour frame nearest in time to a held-out one, at most 3 ms away, and are scored as
// `evaluate` scores. The result itself is better than that: its gaps are half as wide. At most kMaxMapsChecked maps are
// scored, spread evenly over the clip, each for the price of a gap of double width: a check costs at most what 2 x
// kMaxMapsChecked intervals of the upsampling cost, whatever the length of the clip.
#ifndef DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_H_
#define DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_H_

#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/metrics/scores.h"
#include "core/tools/upsample_run.h"

namespace depthtween::tools {

inline constexpr int kMaxMapsChecked = 12;
inline constexpr int kWorstFramesTold = 5;

struct SelfCheck {
  struct Method {
    std::string name;
    double rmse_mm = 0.0, mae_mm = 0.0;       // on the pixels that all methods fill
    std::optional<double> edge_band_rmse_mm;  // none where the truth has no edge
    double completeness = 0.0;                // share of truth pixels filled, [0,1]
    std::optional<double> within_one_sigma;   // share of errors below the predicted deviation; a Gaussian: 0.683
  };
  struct Frame {
    int frame = -1;  // of the recording
    std::string stem;
    int64_t time_ns = 0;
    double rmse_mm = 0.0;  // of ours
  };

  std::string reason;  // why nothing could be checked; empty if it was, and only then is the rest set
  int maps_checked = 0;
  int maps_held_out = 0;            // that could have been checked
  int64_t pixels = 0;               // scored, of all maps
  std::vector<Method> methods;      // ours, flow-warp, linear, hold
  std::vector<Frame> worst_frames;  // by RMSE of ours, at most kWorstFramesTold
  // What consecutive depth maps differ by where nothing moves; none when the camera moves.
  std::optional<DepthScore> sensor_floor;
  double seconds = 0.0;  // wall time of the check
};

// `options.self_check` does not matter; `options.threads` does not change the numbers. `on_map` is called before each
// map, from the calling thread; may be empty. A clip that cannot be checked is a SelfCheck with a reason.
// Errors: InvalidArgument for options; Cancelled when `stop` fires; else what reading files returns.
absl::StatusOr<SelfCheck> CheckSelf(const SequenceFolder& recording, const UpsampleOptions& options,
                                    std::stop_token stop = {},
                                    const std::function<void(int done, int total)>& on_map = nullptr);

// CheckSelf if `options.self_check`, for a person at a terminal: counts maps on stderr and prints the table to stdout.
// Returns what AssembleResult takes: null if nobody asked.
absl::StatusOr<nlohmann::json> CheckSelfAloud(const SequenceFolder& recording, const UpsampleOptions& options,
                                              std::stop_token stop);

// What it comes to, in one sentence for people.
std::string Summary(const SelfCheck& check);
// The sentence, then a table of the methods and the worst frames.
std::string FormatTable(const SelfCheck& check);
// The field "self_check" of report.json, and the answer of `task self-check`: the members, and "summary".
nlohmann::json ToJson(const SelfCheck& check);

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_H_
