#include "core/sequence/camera_json.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/base/byte_order_mark.h"

namespace depthtween {
namespace {

using nlohmann::json;

// Values come from a stranger: what is quoted is short and valid UTF-8.
std::string Quote(const json& value) {
  std::string text = value.dump(-1, ' ', /*ensure_ascii=*/true, json::error_handler_t::replace);
  if (text.size() > 60) text = text.substr(0, 57) + "...";
  return text;
}

absl::Status ReadNumber(const json& object, const char* field, bool required, double& out) {
  const auto it = object.find(field);
  if (it == object.end()) {
    if (!required) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrFormat("field %s is missing, must be a number", field));
  }
  if (!it->is_number())
    return absl::InvalidArgumentError(absl::StrFormat("%s = %s, must be a number", field, Quote(*it)));
  out = it->get<double>();
  return absl::OkStatus();
}

absl::Status ReadPixels(const json& object, const char* field, int& out) {
  double value = 0.0;
  RETURN_IF_ERROR(ReadNumber(object, field, /*required=*/true, value));
  if (value != std::floor(value) || std::abs(value) > std::numeric_limits<int>::max())
    return absl::InvalidArgumentError(
        absl::StrFormat("%s = %s, must be a whole number of pixels", field, Quote(object[field])));
  out = static_cast<int>(value);
  return absl::OkStatus();
}

// Parses with exceptions, because they say where; remembers the field, which they do not.
absl::StatusOr<json> ParseText(std::string_view text) {
  std::string last_field;
  const auto where = [&] { return last_field.empty() ? "" : absl::StrCat(" at or after field ", last_field); };
  const auto remember_field = [&last_field](int, json::parse_event_t event, json& parsed) {
    if (event == json::parse_event_t::key) last_field = Quote(parsed);
    return true;
  };
  try {
    return json::parse(text, remember_field);
  } catch (const json::parse_error& error) {
    const auto line = 1 + std::count(text.begin(), text.begin() + std::min(error.byte, text.size()), '\n');
    return absl::InvalidArgumentError(
        absl::StrFormat("line %d%s: not JSON (NaN and Infinity are not JSON either)", line, where()));
  } catch (const json::out_of_range&) {
    return absl::InvalidArgumentError(absl::StrCat("number too large", where()));
  }
}

// Names what has no effect, so that nobody believes it has: distortion, above all, has many names.
std::optional<std::string> UnknownFields(const json& object) {
  constexpr size_t kNamed = 8;
  constexpr std::array<std::string_view, 12> kKnown = {"width", "height", "fx", "fy", "cx", "cy",
                                                       "k1",    "k2",     "p1", "p2", "k3", "depth_scale"};
  std::vector<std::string> unknown;
  bool distortion = false;
  for (const auto& [field, value] : object.items()) {
    if (std::find(kKnown.begin(), kKnown.end(), field) != kKnown.end()) continue;
    unknown.push_back(Quote(field));
    std::string lower = field;
    std::transform(lower.begin(), lower.end(), lower.begin(), [](unsigned char c) { return std::tolower(c); });
    distortion = distortion || lower.starts_with("dist") || lower == "d" || lower.starts_with("coef") ||
                 lower == "k4" || lower == "k5" || lower == "k6";
  }
  if (unknown.empty()) return std::nullopt;
  const size_t hidden = unknown.size() - std::min(unknown.size(), kNamed);
  unknown.resize(unknown.size() - hidden);
  std::string text = absl::StrCat("camera.json: unknown and ignored: ", absl::StrJoin(unknown, ", "));
  if (hidden > 0) absl::StrAppendFormat(&text, " and %d more", hidden);
  if (distortion)
    absl::StrAppend(&text,
                    "; lens distortion is not applied from there: give it as k1, k2, p1, p2, k3 (OpenCV's order "
                    "of a list of five), or undistort the images");
  return text;
}

}  // namespace

absl::StatusOr<CameraFile> ParseCameraJson(std::string_view text) {
  if (LooksLikeUtf16(text))
    return absl::InvalidArgumentError("is UTF-16 text, must be UTF-8: save it in that encoding");
  ASSIGN_OR_RETURN(const json object, ParseText(SkipByteOrderMark(text)));
  return CameraFromJson(object);
}

absl::StatusOr<CameraFile> CameraFromJson(const json& object) {
  if (!object.is_object()) return absl::InvalidArgumentError("must be a JSON object");
  if (object.contains("depth_camera"))
    return absl::InvalidArgumentError(
        "depth_camera is given, but depth of a camera of its own cannot be aligned yet: register the depth images to "
        "the "
        "colour camera and remove the field");
  CameraFile file;
  Camera& camera = file.camera;
  RETURN_IF_ERROR(ReadPixels(object, "width", camera.width));
  RETURN_IF_ERROR(ReadPixels(object, "height", camera.height));
  RETURN_IF_ERROR(ReadNumber(object, "fx", /*required=*/true, camera.fx));
  RETURN_IF_ERROR(ReadNumber(object, "fy", /*required=*/true, camera.fy));
  RETURN_IF_ERROR(ReadNumber(object, "cx", /*required=*/true, camera.cx));
  RETURN_IF_ERROR(ReadNumber(object, "cy", /*required=*/true, camera.cy));
  RETURN_IF_ERROR(ReadNumber(object, "k1", /*required=*/false, camera.k1));
  RETURN_IF_ERROR(ReadNumber(object, "k2", /*required=*/false, camera.k2));
  RETURN_IF_ERROR(ReadNumber(object, "p1", /*required=*/false, camera.p1));
  RETURN_IF_ERROR(ReadNumber(object, "p2", /*required=*/false, camera.p2));
  RETURN_IF_ERROR(ReadNumber(object, "k3", /*required=*/false, camera.k3));
  RETURN_IF_ERROR(ReadNumber(object, "depth_scale", /*required=*/true, file.depth_scale));
  if (std::optional<std::string> warning = UnknownFields(object)) file.warnings.push_back(*std::move(warning));
  return file;
}

json CameraToJson(const Camera& camera, double depth_scale) {
  json object = {{"width", camera.width}, {"height", camera.height}, {"fx", camera.fx},           {"fy", camera.fy},
                 {"cx", camera.cx},       {"cy", camera.cy},         {"depth_scale", depth_scale}};
  if (camera.HasDistortion()) {
    object["k1"] = camera.k1;
    object["k2"] = camera.k2;
    object["p1"] = camera.p1;
    object["p2"] = camera.p2;
    object["k3"] = camera.k3;
  }
  return object;
}

std::string FormatCameraJson(const Camera& camera, double depth_scale) {
  return CameraToJson(camera, depth_scale).dump(1) + "\n";
}

}  // namespace depthtween
