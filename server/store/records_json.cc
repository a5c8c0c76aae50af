#include "server/store/records_json.h"

#include "core/sequence/camera_json.h"
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
  return {{"camera", CameraToJson(recording.camera, recording.depth_scale)},
          {"color_frame_count", recording.color_frame_count},
          {"depth_frame_count", recording.depth_frame_count},
          {"first_time_ns", recording.first_time_ns},
          {"last_time_ns", recording.last_time_ns},
          {"median_depth_m", recording.median_depth_m}};
}

absl::StatusOr<Recording> ToRecording(const json& value) {
  ASSIGN_OR_RETURN(const CameraFile file, CameraFromJson(value.at("camera")));
  return Recording{.camera = file.camera,
                   .depth_scale = file.depth_scale,
                   .color_frame_count = value.at("color_frame_count"),
                   .depth_frame_count = value.at("depth_frame_count"),
                   .first_time_ns = value.at("first_time_ns"),
                   .last_time_ns = value.at("last_time_ns"),
                   .median_depth_m = value.at("median_depth_m")};
}

// Messages quote what clients sent: bytes that are not UTF-8 are replaced.
std::string Dump(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

// `convert` returns the value or an error, or throws what nlohmann::json throws.
template <typename T, typename Convert>
absl::StatusOr<T> Parse(const std::string& text, Convert convert) {
  absl::StatusOr<T> value;
  try {
    value = convert(json::parse(text));
  } catch (const json::exception& error) {
    value = absl::DataLossError(error.what());
  }
  if (value.ok()) return value;
  return absl::DataLossError(absl::StrCat("database: damaged record: ", value.status().message()));
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

std::string ToJson(const ErrorInfo& info) { return Dump({{"reason", info.reason}, {"metadata", info.metadata}}); }

absl::StatusOr<ErrorInfo> ErrorInfoFromJson(const std::string& text) {
  return Parse<ErrorInfo>(text, [](const json& value) {
    return ErrorInfo{.reason = value.at("reason"),
                     .metadata = value.at("metadata").get<std::map<std::string, std::string>>()};
  });
}

absl::StatusOr<ClockEstimate> ReadClockEstimate(const std::string& text) {
  return Parse<ClockEstimate>(text, ClockEstimateFromJson);
}

absl::StatusOr<std::vector<std::string>> ReadWarnings(const std::string& text) {
  return Parse<std::vector<std::string>>(text, [](const json& value) { return value.get<std::vector<std::string>>(); });
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
  return Parse<ValidationResult>(text, [](const json& value) -> absl::StatusOr<ValidationResult> {
    ValidationResult result;
    for (const json& violation : value.at("violations")) {
      result.violations.push_back({.file = violation.at("file"), .status = ToStatus(violation.at("status"))});
    }
    result.warnings = value.at("warnings").get<std::vector<std::string>>();
    result.error = ToStatus(value.at("error"));
    if (value.contains("recording")) {
      ASSIGN_OR_RETURN(result.recording, ToRecording(value.at("recording")));
    }
    return result;
  });
}

}  // namespace depthtween::server
