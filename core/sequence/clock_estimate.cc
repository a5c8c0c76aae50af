#include "core/sequence/clock_estimate.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"

namespace depthtween {

using nlohmann::json;

std::string Summary(const ClockEstimate& estimate) {
  if (!estimate.reason.empty())
    return absl::StrCat("the images do not tell the depth camera's clock: ", estimate.reason);
  const ClockModel& model = estimate.model;
  std::string summary = absl::StrFormat("the depth camera's clock is %.2f ms %s at the first colour frame (+-%.2f ms)",
                                        1e-6 * std::abs(model.offset_ns), model.offset_ns < 0 ? "behind" : "ahead",
                                        1e-6 * estimate.offset_sigma_ns);
  if (model.drift_ppm != 0)
    absl::StrAppendFormat(&summary, " and %s %.0f ppm (+-%.0f ppm)", model.drift_ppm < 0 ? "loses" : "gains",
                          std::abs(model.drift_ppm), estimate.drift_sigma_ppm);
  else
    absl::StrAppendFormat(&summary, "; no drift can be told (+-%.0f ppm)", estimate.drift_sigma_ppm);
  absl::StrAppendFormat(&summary, "; from %d edge pixels of %d depth frames", estimate.edges, estimate.keys);
  return summary;
}

json ToJson(const ClockEstimate& estimate) {
  return {{"trusted", estimate.reason.empty()},
          {"reason", estimate.reason},
          {"summary", Summary(estimate)},
          {"reference_ns", estimate.model.reference_ns},
          {"offset_ns", estimate.model.offset_ns},
          {"offset_sigma_ns", estimate.offset_sigma_ns},
          {"drift_ppm", estimate.model.drift_ppm},
          {"drift_sigma_ppm", estimate.drift_sigma_ppm},
          {"stamp_sigma_ns", estimate.stamp_sigma_ns},
          {"row_time_ns", estimate.row_time_ns},
          {"row_time_sigma_ns", estimate.row_time_sigma_ns},
          {"keys", estimate.keys},
          {"edges", estimate.edges}};
}

ClockEstimate ClockEstimateFromJson(const json& estimate) {
  return {.reason = estimate.at("reason").get<std::string>(),
          .model = {.reference_ns = estimate.at("reference_ns").get<int64_t>(),
                    .offset_ns = estimate.at("offset_ns").get<double>(),
                    .drift_ppm = estimate.at("drift_ppm").get<double>()},
          .offset_sigma_ns = estimate.at("offset_sigma_ns").get<double>(),
          .drift_sigma_ppm = estimate.at("drift_sigma_ppm").get<double>(),
          .stamp_sigma_ns = estimate.at("stamp_sigma_ns").get<double>(),
          .row_time_ns = estimate.at("row_time_ns").get<double>(),
          .row_time_sigma_ns = estimate.at("row_time_sigma_ns").get<double>(),
          .keys = estimate.at("keys").get<int>(),
          .edges = estimate.at("edges").get<int64_t>()};
}

}  // namespace depthtween
