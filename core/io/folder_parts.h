// The parts that sequence and result folders share, read with their problems collected.
#ifndef DEPTHTWEEN_CORE_IO_FOLDER_PARTS_H_
#define DEPTHTWEEN_CORE_IO_FOLDER_PARTS_H_

#include <string>
#include <vector>

#include "core/io/frame_list.h"
#include "core/io/violation_list.h"
#include "core/sequence/camera_json.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// OK when dir is a folder, NotFound otherwise.
absl::Status CheckFolder(const std::string& dir);

// dir/camera.json; a default CameraFile when it cannot be read.
CameraFile ReadCameraPart(const std::string& dir, ViolationList& violations);

// dir/<list_name>: its frames in their order, also those whose file is not there. Every listed file must be a regular
// file inside dir, symbolic links followed.
FrameList ReadListPart(const std::string& dir, const std::string& list_name, ViolationList& violations);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FOLDER_PARTS_H_
