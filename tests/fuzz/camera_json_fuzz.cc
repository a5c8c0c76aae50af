// Any bytes as camera.json: a status, or a camera that is written and read to itself.
#include "core/sequence/camera_json.h"

#include <cstdlib>

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto file = ParseCameraJson({reinterpret_cast<const char*>(data), size});
  if (!file.ok()) return 0;
  const auto again = ParseCameraJson(FormatCameraJson(file->camera, file->depth_scale));
  if (!again.ok() || again->camera.fx != file->camera.fx || again->depth_scale != file->depth_scale) std::abort();
  return 0;
}
