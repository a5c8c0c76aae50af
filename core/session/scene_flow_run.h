// The scene flow of a recording, in the steps that `depthtween-core sceneflow` takes in one process and the server in
// several: PlanPairs, ComputePair for any pair in any order and process, FinishSceneFlow. The bits do not depend on how
// the work was divided.
#ifndef DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_RUN_H_
#define DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_RUN_H_

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/options/scene_flow_options.h"
#include "core/sceneflow/scene_flow.h"

namespace depthtween {

// Two colour frames, and the depth frame of each.
struct FramePair {
  int from = 0, to = 0;
  int from_depth = 0, to_depth = 0;
};

// FailedPrecondition when a colour frame has no depth within half a frame, or when there are too few frames for one
// pair.
absl::StatusOr<std::vector<FramePair>> PlanPairs(const Sequence& sequence, int every);

// As ToJson of a ClipPlan: each pair is an interval of one frame, that which it starts from.
nlohmann::json PairsToJson(const std::vector<FramePair>& pairs, const Sequence& sequence);

// What is said of one pair.
struct PairSummary {
  std::string from, to;
  double seconds = 0.0, median_m = 0.0, hidden_share = 0.0, answered_share = 0.0;
};
nlohmann::json ToJson(const PairSummary& summary);
absl::StatusOr<PairSummary> ParsePairSummary(std::string_view text);

// What a picture shows of one pair: a column of it.
struct PicturedPair {
  Image<Rgb8> color;
  Image<Flow2> flow_px;
  Image<Float3> motion_m;
  Image<uint8_t> valid;
};
// Some pairs out of `count`, spread over the clip, ascending.
std::vector<int> PairsToPicture(int count);

// Computes a pair and writes its files under `dir`, which MakeSceneFlowFolders has made. `on_item` is as in
// SceneFlowOptions. Errors name the pair.
struct ComputedPair {
  PairSummary summary;
  PicturedPair picture;
};
absl::StatusOr<ComputedPair> ComputePair(const SequenceFolder& recording, const FramePair& pair,
                                         const SceneFlowOrder& order, std::stop_token stop, const std::string& dir,
                                         const std::function<void()>& on_item = nullptr);
// The picture of a pair whose NPZ is in `dir`. DataLoss when that is not what ComputePair wrote.
absl::StatusOr<PicturedPair> ReadPicture(const SequenceFolder& recording, const FramePair& pair,
                                         const std::string& dir);

// Writes preview.png and report.json, durable; returns the report. `pictured` must not be empty.
absl::StatusOr<nlohmann::json> FinishSceneFlow(const SceneFlowOrder& order, const std::string& dir,
                                               const std::vector<PairSummary>& pairs,
                                               const std::vector<PicturedPair>& pictured);

// All of these steps at once: writes the scene flow of `recording` into the folder `out`, which ClearResult makes
// ready, and returns the report. `on_pair` is called before each pair, from the calling thread. Errors: those of the
// steps and of ClearResult. Cancelled when `stop` fires.
absl::StatusOr<nlohmann::json> ComputeSceneFlow(const SequenceFolder& recording, const SceneFlowOrder& order,
                                                const std::string& out, bool force, std::stop_token stop,
                                                const std::function<void(int done, int total)>& on_pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_RUN_H_
