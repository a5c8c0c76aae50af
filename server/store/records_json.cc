#include "server/store/records_json.h"

#include "nlohmann/json.hpp"

namespace depthtween::server {
namespace {

using nlohmann::json;

json FromStatus(const absl::Status& status) {
  return {{"code", static_cast<int>(status.code())}, {"message", std::string(status.message())}};
}

absl::Status ToStatus(const json& value) {
  return absl::Status(static_cast<absl::StatusCode>(value.at("code").get<int>()),
                      value.at("message").get<std::string>());
}

json FromRecording(const Recording& recording) {
  const Camera& c = recording.camera;
  return {{"camera",
           {{"width", c.width},
            {"height", c.height},
            {"fx", c.fx},
            {"fy", c.fy},
            {"cx", c.cx},
            {"cy", c.cy},
            {"k1", c.k1},
            {"k2", c.k2},
            {"p1", c.p1},
            {"p2", c.p2},
            {"k3", c.k3}}},
          {"depth_scale", recording.depth_scale},
          {"color_frame_count", recording.color_frame_count},
          {"depth_frame_count", recording.depth_frame_count},
          {"first_time_ns", recording.first_time_ns},
          {"last_time_ns", recording.last_time_ns},
          {"median_depth_m", recording.median_depth_m}};
}

Recording ToRecording(const json& value) {
  const json& c = value.at("camera");
  return {.camera = {.width = c.at("width"),
                     .height = c.at("height"),
                     .fx = c.at("fx"),
                     .fy = c.at("fy"),
                     .cx = c.at("cx"),
                     .cy = c.at("cy"),
                     .k1 = c.at("k1"),
                     .k2 = c.at("k2"),
                     .p1 = c.at("p1"),
                     .p2 = c.at("p2"),
                     .k3 = c.at("k3")},
          .depth_scale = value.at("depth_scale"),
          .color_frame_count = value.at("color_frame_count"),
          .depth_frame_count = value.at("depth_frame_count"),
          .first_time_ns = value.at("first_time_ns"),
          .last_time_ns = value.at("last_time_ns"),
          .median_depth_m = value.at("median_depth_m")};
}

// Messages quote what clients sent: bytes that are not UTF-8 are replaced.
std::string Dump(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

template <typename T, typename Convert>
absl::StatusOr<T> Parse(const std::string& text, Convert convert) {
  try {
    return convert(json::parse(text));
  } catch (const json::exception& error) {
    return absl::DataLossError(absl::StrCat("database: damaged record: ", error.what()));
  }
}

}  // namespace

std::string ToJson(const Recording& recording) { return Dump(FromRecording(recording)); }

std::string ToJson(const ValidationResult& result) {
  json value = {{"violations", json::array()}, {"warnings", result.warnings}, {"error", FromStatus(result.error)}};
  for (const FileViolation& violation : result.violations) {
    value["violations"].push_back({{"file", violation.file}, {"status", FromStatus(violation.status)}});
  }
  if (result.recording) value["recording"] = FromRecording(*result.recording);
  return Dump(value);
}

std::string ToJson(const RenderRecord& render) {
  return Dump({{"name", render.name},
               {"options", render.options},
               {"reach_frames", render.reach_frames},
               {"anchor_frame", render.anchor_frame},
               {"uses_motion", render.uses_motion},
               {"streams", render.streams},
               {"extension", render.extension},
               {"videos", render.videos}});
}

std::string ToJson(const ClockEstimate& estimate) {
  return Dump({{"summary", estimate.summary},
               {"reason", estimate.reason},
               {"reference_ns", estimate.reference_ns},
               {"offset_ns", estimate.offset_ns},
               {"offset_sigma_ns", estimate.offset_sigma_ns},
               {"drift_ppm", estimate.drift_ppm},
               {"drift_sigma_ppm", estimate.drift_sigma_ppm},
               {"stamp_sigma_ns", estimate.stamp_sigma_ns},
               {"row_time_ns", estimate.row_time_ns},
               {"row_time_sigma_ns", estimate.row_time_sigma_ns},
               {"keys", estimate.keys},
               {"edges", estimate.edges}});
}

std::string ToJson(const ErrorInfo& info) { return Dump({{"reason", info.reason}, {"metadata", info.metadata}}); }

absl::StatusOr<ErrorInfo> ErrorInfoFromJson(const std::string& text) {
  return Parse<ErrorInfo>(text, [](const json& value) {
    return ErrorInfo{.reason = value.at("reason"),
                     .metadata = value.at("metadata").get<std::map<std::string, std::string>>()};
  });
}

absl::StatusOr<ClockEstimate> ClockEstimateFromJson(const std::string& text) {
  return Parse<ClockEstimate>(text, [](const json& value) {
    return ClockEstimate{.summary = value.at("summary"),
                         .reason = value.at("reason"),
                         .reference_ns = value.at("reference_ns"),
                         .offset_ns = value.at("offset_ns"),
                         .offset_sigma_ns = value.at("offset_sigma_ns"),
                         .drift_ppm = value.at("drift_ppm"),
                         .drift_sigma_ppm = value.at("drift_sigma_ppm"),
                         .stamp_sigma_ns = value.at("stamp_sigma_ns"),
                         .row_time_ns = value.at("row_time_ns"),
                         .row_time_sigma_ns = value.at("row_time_sigma_ns"),
                         .keys = value.at("keys"),
                         .edges = value.at("edges")};
  });
}

absl::StatusOr<RenderRecord> RenderRecordFromJson(const std::string& text) {
  return Parse<RenderRecord>(text, [](const json& value) {
    return RenderRecord{.name = value.at("name"),
                        .options = value.at("options"),
                        .reach_frames = value.at("reach_frames"),
                        .anchor_frame = value.at("anchor_frame"),
                        .uses_motion = value.at("uses_motion"),
                        .streams = value.at("streams").get<std::vector<std::string>>(),
                        .extension = value.at("extension"),
                        .videos = value.at("videos").get<std::vector<std::string>>()};
  });
}

absl::StatusOr<Recording> RecordingFromJson(const std::string& text) { return Parse<Recording>(text, ToRecording); }

absl::StatusOr<ValidationResult> ValidationResultFromJson(const std::string& text) {
  return Parse<ValidationResult>(text, [](const json& value) {
    ValidationResult result;
    for (const json& violation : value.at("violations")) {
      result.violations.push_back({.file = violation.at("file"), .status = ToStatus(violation.at("status"))});
    }
    result.warnings = value.at("warnings").get<std::vector<std::string>>();
    result.error = ToStatus(value.at("error"));
    if (value.contains("recording")) result.recording = ToRecording(value.at("recording"));
    return result;
  });
}

}  // namespace depthtween::server
