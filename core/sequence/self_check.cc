#include "core/sequence/self_check.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"

namespace depthtween {

using nlohmann::json;

json ToJson(const SelfCheck& check) {
  json value = {{"summary", check.summary}};
  if (!check.reason.empty()) {
    value["reason"] = check.reason;
    return value;
  }
  json methods = json::array(), frames = json::array();
  for (const SelfCheck::Method& method : check.methods) {
    json& added = methods.emplace_back(json{{"name", method.name},
                                            {"rmse_mm", method.rmse_mm},
                                            {"mae_mm", method.mae_mm},
                                            {"completeness", method.completeness}});
    if (method.edge_band_rmse_mm) added["edge_band_rmse_mm"] = *method.edge_band_rmse_mm;
    if (method.within_one_sigma) added["within_one_sigma"] = *method.within_one_sigma;
  }
  for (const SelfCheck::Frame& frame : check.worst_frames)
    frames.push_back(
        {{"frame", frame.frame}, {"stem", frame.stem}, {"time_ns", frame.time_ns}, {"rmse_mm", frame.rmse_mm}});
  value.update({{"maps_checked", check.maps_checked},
                {"maps_held_out", check.maps_held_out},
                {"pixels", check.pixels},
                {"methods", std::move(methods)},
                {"worst_frames", std::move(frames)},
                {"seconds", check.seconds}});
  if (check.sensor_floor)
    value["sensor_floor"] = {{"rmse_mm", check.sensor_floor->rmse_mm}, {"mae_mm", check.sensor_floor->mae_mm}};
  return value;
}

absl::StatusOr<SelfCheck> ParseSelfCheck(std::string_view text) {
  try {
    const json value = json::parse(text);
    SelfCheck check = {.summary = value.at("summary")};
    if (value.contains("reason")) {
      check.reason = value.at("reason");
      return check;
    }
    const auto optional = [](const json& of, const char* name) {
      return of.contains(name) ? std::optional<double>(of.at(name)) : std::nullopt;
    };
    check.maps_checked = value.at("maps_checked");
    check.maps_held_out = value.at("maps_held_out");
    check.pixels = value.at("pixels");
    check.seconds = value.at("seconds");
    for (const json& method : value.at("methods")) {
      check.methods.push_back({.name = method.at("name"),
                               .rmse_mm = method.at("rmse_mm"),
                               .mae_mm = method.at("mae_mm"),
                               .edge_band_rmse_mm = optional(method, "edge_band_rmse_mm"),
                               .completeness = method.at("completeness"),
                               .within_one_sigma = optional(method, "within_one_sigma")});
    }
    for (const json& frame : value.at("worst_frames")) {
      check.worst_frames.push_back({.frame = frame.at("frame"),
                                    .stem = frame.at("stem"),
                                    .time_ns = frame.at("time_ns"),
                                    .rmse_mm = frame.at("rmse_mm")});
    }
    if (value.contains("sensor_floor")) {
      const json& floor = value.at("sensor_floor");
      check.sensor_floor = SelfCheck::Floor{.rmse_mm = floor.at("rmse_mm"), .mae_mm = floor.at("mae_mm")};
    }
    return check;
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("self-check: ", error.what()));
  }
}

}  // namespace depthtween
