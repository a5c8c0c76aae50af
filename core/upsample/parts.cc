// The parts of the pipeline that can be left out, by name.
#include <algorithm>
#include <iterator>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/options/upsample_options.h"
#include "core/upsample/pipeline.h"

namespace depthtween {
namespace {

// What PartNames() names, but for the parts of the solve.
struct Part {
  std::string_view name;
  bool (*used)(const PipelineOptions& options);
  void (*leave_out)(PipelineOptions& options);
};
constexpr Part kParts[] = {
    {"settle", [](const auto& o) { return o.settle_reach > 0; }, [](auto& o) { o.settle_reach = 0; }},
    {"recover", [](const auto& o) { return o.recover; }, [](auto& o) { o.recover = false; }},
    {"thin", [](const auto& o) { return o.thin; }, [](auto& o) { o.thin = false; }},
    {"draw", [](const auto& o) { return o.draw; }, [](auto& o) { o.draw = false; }},
    {"solve", [](const auto& o) { return o.draw && o.solve; }, [](auto& o) { o.solve = false; }},
    {"propagation", [](const auto& o) { return o.sweeps > 0; }, [](auto& o) { o.sweeps = 0; }},
    {"median", [](const auto& o) { return o.median_radius > 0; }, [](auto& o) { o.median_radius = 0; }},
    {"witnesses", [](const auto& o) { return o.witnesses; }, [](auto& o) { o.witnesses = false; }},
    {"silhouettes", [](const auto& o) { return o.silhouette_passes > 0; }, [](auto& o) { o.silhouette_passes = 0; }},
};
const Part* FindPart(std::string_view name) {
  const auto* const part =
      std::find_if(std::begin(kParts), std::end(kParts), [&](const Part& p) { return p.name == name; });
  return part == std::end(kParts) ? nullptr : part;
}

}  // namespace

bool PipelineOptions::Uses(std::string_view part) const {
  const Part* const known = FindPart(part);
  return known != nullptr ? known->used(*this) : draw && solve && solver.Uses(part);
}

absl::Status PipelineOptions::SwitchOff(std::string_view part) {
  const Part* const known = FindPart(part);
  if (known == nullptr && solver.SwitchOff(part).ok()) return absl::OkStatus();
  if (known == nullptr)
    return absl::InvalidArgumentError(absl::StrFormat("'%s' cannot be switched off: the parts are %s",
                                                      std::string(part), absl::StrJoin(PartNames(), ", ")));
  known->leave_out(*this);
  return absl::OkStatus();
}

}  // namespace depthtween
