// How good a result folder is, measured against the sequence it was made from, beside the baselines on the same inputs.
//
// Truth: clip_truth.h. Definitions of all numbers: core/metrics.
#ifndef DEPTHTWEEN_CORE_SESSION_EVALUATION_H_
#define DEPTHTWEEN_CORE_SESSION_EVALUATION_H_

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/session/clip_scoring.h"

namespace depthtween {

struct EvaluationOptions {
  std::string result_dir;     // what `upsample` left: its report says which depth maps were input
  std::string reference_dir;  // the sequence it was made from
  std::vector<std::string>
      baselines;                  // computed on the same inputs; names of core/baselines. The result's own is left out
  float far_m = kFarthestTruthM;  // truth beyond is not scored
  int threads = 1;                // does not change the numbers. >= 1
  std::stop_token stop = {};
  // Called before each scored frame, from the calling thread. May be empty.
  std::function<void(int done, int total)> on_progress = nullptr;
};

// The result is score.methods[0], the baselines follow.
struct Evaluation : ClipScores {
  std::string result_dir, reference_dir;
  std::string method;  // of the result, as its report says
};

// One frame of each method is in memory at a time, however long the clip.
// Errors: InvalidArgument: an unknown baseline; result and reference do not belong together. FailedPrecondition: the
// result is not finished, or there is no truth to score. Cancelled when `stop` fires. Else what reading files returns.
absl::StatusOr<Evaluation> Evaluate(const EvaluationOptions& options);

// Everything: all scores by method and region, curves, ratios of the first method to each other, RMSE of each frame.
nlohmann::json ToJson(const ClipScores& scores);
nlohmann::json ToJson(const Evaluation& evaluation);  // and which result it was

// For people: the scores in a table, their ratios to each baseline, and the `worst_frames` frames of largest RMSE.
std::string FormatTable(const Evaluation& evaluation, int worst_frames = 0);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_EVALUATION_H_
