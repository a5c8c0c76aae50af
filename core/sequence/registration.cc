#include "core/sequence/registration.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace depthtween {

using nlohmann::json;

Flow2 Registration::Displacement(int width, int height, double x, double y, double z) const {
  const double nearness = 1.0 / z - 1.0 / reference_m;
  return {static_cast<float>(right_px + (scale - 1) * (x - 0.5 * (width - 1)) + parallax_x_px_m * nearness),
          static_cast<float>(down_px + (scale - 1) * (y - 0.5 * (height - 1)) + parallax_y_px_m * nearness)};
}

bool RegistrationEstimate::IsOff() const {
  constexpr double kNoticed = 1.0, kSignificant = 3.0;  // pixels, standard deviations
  return reason.empty() && moves_px > kNoticed && moves_px > kSignificant * moves_sigma_px;
}

std::string Summary(const RegistrationEstimate& estimate) {
  if (!estimate.reason.empty())
    return absl::StrCat("the images do not tell whether depth is registered to colour: ", estimate.reason);
  const Registration& model = estimate.model;
  std::string summary = absl::StrFormat("depth edges lie %.1f px (+-%.1f px) beside those of colour", estimate.moves_px,
                                        estimate.moves_sigma_px);
  if (!estimate.IsOff())
    return absl::StrFormat("%s, which is registered; from %d edge pixels of %d depth frames", summary, estimate.edges,
                           estimate.keys);
  absl::StrAppendFormat(&summary, ": depth at %.2f m must move by %+.1f px right and %+.1f px down (+-%.1f px)",
                        model.reference_m, model.right_px, model.down_px, estimate.shift_sigma_px);
  if (model.scale != 1)
    absl::StrAppendFormat(&summary, ", grow by a factor of %.3f (+-%.3f)", model.scale, estimate.scale_sigma);
  if (model.parallax_x_px_m != 0 || model.parallax_y_px_m != 0)
    absl::StrAppendFormat(&summary, ", and by a parallax of %+.1f and %+.1f px for each 1/m (+-%.1f px)",
                          model.parallax_x_px_m, model.parallax_y_px_m, estimate.parallax_sigma_px_m);
  absl::StrAppendFormat(&summary, "; from %d edge pixels of %d depth frames", estimate.edges, estimate.keys);
  return summary;
}

json ToJson(const Registration& registration) {
  return {{"right_px", registration.right_px},
          {"down_px", registration.down_px},
          {"scale", registration.scale},
          {"parallax_x_px_m", registration.parallax_x_px_m},
          {"parallax_y_px_m", registration.parallax_y_px_m},
          {"reference_m", registration.reference_m}};
}

Registration RegistrationFromJson(const json& registration) {
  return {.right_px = registration.at("right_px").get<double>(),
          .down_px = registration.at("down_px").get<double>(),
          .scale = registration.at("scale").get<double>(),
          .parallax_x_px_m = registration.at("parallax_x_px_m").get<double>(),
          .parallax_y_px_m = registration.at("parallax_y_px_m").get<double>(),
          .reference_m = registration.at("reference_m").get<double>()};
}

json ToJson(const RegistrationEstimate& estimate) {
  return {{"trusted", estimate.reason.empty()},
          {"reason", estimate.reason},
          {"summary", Summary(estimate)},
          {"model", ToJson(estimate.model)},
          {"shift_sigma_px", estimate.shift_sigma_px},
          {"scale_sigma", estimate.scale_sigma},
          {"parallax_sigma_px_m", estimate.parallax_sigma_px_m},
          {"moves_px", estimate.moves_px},
          {"moves_sigma_px", estimate.moves_sigma_px},
          {"keys", estimate.keys},
          {"edges", estimate.edges}};
}

RegistrationEstimate RegistrationEstimateFromJson(const json& estimate) {
  return {.reason = estimate.at("reason").get<std::string>(),
          .model = RegistrationFromJson(estimate.at("model")),
          .shift_sigma_px = estimate.at("shift_sigma_px").get<double>(),
          .scale_sigma = estimate.at("scale_sigma").get<double>(),
          .parallax_sigma_px_m = estimate.at("parallax_sigma_px_m").get<double>(),
          .moves_px = estimate.at("moves_px").get<double>(),
          .moves_sigma_px = estimate.at("moves_sigma_px").get<double>(),
          .keys = estimate.at("keys").get<int>(),
          .edges = estimate.at("edges").get<int64_t>()};
}

}  // namespace depthtween
