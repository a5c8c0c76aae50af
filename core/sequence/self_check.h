// What a self-check found (core/tools measures it), as everybody who keeps or shows it has it, and its one form in
// JSON. It lies here for the reason that upsample_names.h gives.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_SELF_CHECK_H_
#define DEPTHTWEEN_CORE_SEQUENCE_SELF_CHECK_H_

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

// How far the result of an upsampling will be from depth that was measured and held out.
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
  // What consecutive depth maps differ by where nothing moves.
  struct Floor {
    double rmse_mm = 0.0, mae_mm = 0.0;
  };

  std::string summary;  // what it comes to, in one sentence for people
  std::string reason;   // why nothing could be checked; empty if it was, and only then is the rest set
  int maps_checked = 0;
  int maps_held_out = 0;              // that could have been checked
  int64_t pixels = 0;                 // scored, of all maps
  std::vector<Method> methods;        // ours, flow-warp, linear, hold
  std::vector<Frame> worst_frames;    // the worst of ours first
  std::optional<Floor> sensor_floor;  // none when the camera moves
  double seconds = 0.0;               // wall time of the check
};

// The members; of one with a reason, that and the summary. The field "self_check" of report.json, the answer of
// `depthtween-core task self-check`, and what a server keeps.
nlohmann::json ToJson(const SelfCheck& check);
// The inverse. InvalidArgument for what ToJson did not make.
absl::StatusOr<SelfCheck> ParseSelfCheck(std::string_view json);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_SELF_CHECK_H_
