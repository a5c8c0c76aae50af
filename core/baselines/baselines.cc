#include "core/baselines/baselines.h"

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/baselines/dolson.h"
#include "core/baselines/flow_warp.h"
#include "core/baselines/per_pixel.h"
#include "core/baselines/tracking.h"

namespace depthtween {

const std::vector<std::string>& QuickBaselineNames() {
  static const auto* const kNames = new std::vector<std::string>{"hold", "nearest", "linear", "flow-warp"};
  return *kNames;
}

absl::StatusOr<std::unique_ptr<Upsampler>> MakeBaseline(std::string_view name) {
  if (name == "hold") return std::make_unique<PerPixelBaseline>("hold", HoldPixel);
  if (name == "nearest") return std::make_unique<PerPixelBaseline>("nearest", NearestPixel);
  if (name == "linear") return std::make_unique<PerPixelBaseline>("linear", LinearPixel);
  if (name == "dolson") return std::make_unique<DolsonBaseline>(DolsonOptions{});
  if (name == "dolson-mode") return std::make_unique<DolsonBaseline>(DolsonOptions{.seek_mode = true});
  if (name == "tracking") return std::make_unique<TrackingBaseline>();
  if (name == "flow-warp") return std::make_unique<FlowWarpBaseline>();
  return absl::InvalidArgumentError(absl::StrFormat("baseline '%s' is not known: the baselines are %s",
                                                    std::string(name), absl::StrJoin(BaselineNames(), ", ")));
}

}  // namespace depthtween
