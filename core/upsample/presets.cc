// What each preset of PipelineOptions is, and which numbers it may hold.
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/fill/key_cleaning.h"
#include "core/options/upsample_options.h"
#include "core/upsample/pipeline.h"

namespace depthtween {

absl::StatusOr<PipelineOptions> PipelineOptions::ForPreset(std::string_view name) {
  if (name == "fast")
    return PipelineOptions{.sweeps = 1,
                           .silhouette_passes = 0,
                           .settle_reach = 1,
                           .flow_finest_scale = 1,
                           .follow = true,
                           .witnesses = false};
  if (name == "balanced") return PipelineOptions{};
  if (name == "best") return PipelineOptions{.sweeps = 3, .silhouette_passes = 4, .draw = true};
  if (name == "reference") {
    PipelineOptions options{.sweeps = 3, .silhouette_passes = 4, .draw = true, .solve = true};
    options.solver = SolveOptions::Reference();
    return options;
  }
  return absl::InvalidArgumentError(absl::StrFormat("preset '%s' is not known: the presets are %s", std::string(name),
                                                    absl::StrJoin(PresetNames(), ", ")));
}

absl::Status PipelineOptions::Validate() const {
  const auto error = [](const char* field, int value, const char* rule) {
    return absl::InvalidArgumentError(absl::StrFormat("PipelineOptions.%s = %d, must be %s", field, value, rule));
  };
  if (sweeps < 0 || sweeps > 20) return error("sweeps", sweeps, "between 0 and 20");
  if (median_radius < 0 || median_radius > 15) return error("median_radius", median_radius, "between 0 and 15");
  if (silhouette_passes < 0 || silhouette_passes > 20)
    return error("silhouette_passes", silhouette_passes, "between 0 and 20");
  if (settle_reach < 0 || settle_reach > kMaxWitnesses / 2)
    return error("settle_reach", settle_reach, "between 0 and 4");
  if (flow_finest_scale < 0 || flow_finest_scale > 5)
    return error("flow_finest_scale", flow_finest_scale, "between 0 and 5");
  return solver.Validate();
}

}  // namespace depthtween
