// A camera in JSON, as camera.json of a sequence folder has it and a server keeps it: `width height fx fy cx cy [k1 k2
// p1 p2 k3] depth_scale`.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CAMERA_JSON_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CAMERA_JSON_H_

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/geometry/camera.h"

namespace depthtween {

struct CameraFile {
  Camera camera;
  double depth_scale = 0.0;  // stored 16-bit units per metre
  // What is there and has no effect, in sentences for people.
  std::vector<std::string> warnings;
};

// Reads what is there; whether the numbers make a camera is for Violations(Sequence) to say.
// InvalidArgument names the field that is missing or not a number (NaN and infinity, which some writers put there, are
// not JSON), and refuses a `depth_camera`: depth must be registered to colour. Fields it does not know are
// ignored, and named in a warning. A byte-order mark of UTF-8 is skipped.
absl::StatusOr<CameraFile> ParseCameraJson(std::string_view text);
// The same of JSON that was parsed already.
absl::StatusOr<CameraFile> CameraFromJson(const nlohmann::json& object);

// The inverse, to the last bit. Distortion is left out when there is none.
nlohmann::json CameraToJson(const Camera& camera, double depth_scale);
std::string FormatCameraJson(const Camera& camera, double depth_scale);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CAMERA_JSON_H_
