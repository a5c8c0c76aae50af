// Scene flow of a frame as files, durable as WriteFileDurably (core/io/file.h) makes them.
//
// NPZ     sceneflow/STEM.npz: `flow` H x W x 2 (u, v: pixels), `motion` H x W x 3 (x right, y down, z forward: metres,
//         the point in the camera's frame at the next frame minus the point now), `depth` H x W (metres, that the
//         motion starts from), `confidence` H x W half floats (0 = no answer, then all is 0), `hidden` H x W bool.
// .flo    flow/STEM.flo (Middlebury) and depth_change/STEM.pfm: metres along z, positive = away.
// KITTI   as of the scene flow benchmark of 2015: kitti/flow/STEM.png (u = (R - 2^15) / 64, v likewise, B = valid),
//         kitti/disp_0/STEM.png and kitti/disp_1/STEM.png, 16 bits: disparity times 256 of a pixel now and of the same
//         pixel's point at the next frame; disparity = fx * baseline / z pixels, 0 = unknown.
#ifndef DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_FILES_H_
#define DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_FILES_H_

#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/geometry/camera.h"
#include "core/sceneflow/scene_flow.h"
#include "core/sequence/sequence.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

std::string SceneFlowNpzName(const std::string& stem);  // sceneflow/STEM.npz

// The folders that the formats need, under `dir`.
absl::Status MakeSceneFlowFolders(const std::string& dir, const std::vector<std::string>& formats);
// Errors: what writing returns.
absl::Status WriteSceneFlow(const std::string& dir, const std::string& stem, const std::vector<std::string>& formats,
                            const Camera& camera, double baseline_m, const SceneFlow& flow);

// Adds NPZ to a result folder whose frames and motion are there, for every frame that has motion to a next one: all but
// held ones. Files that are there already are whole, and stay. `on_frame` is told how many are there, first of all and
// after each, from one thread at a time; may be empty. Returns how many frames have one. Errors: Cancelled when `stop`
// fires; what reading and writing return.
absl::StatusOr<int> AddSceneFlow(const std::string& dir, const Sequence& sequence, const ClipConstants& constants,
                                 int threads, const std::stop_token& stop = {},
                                 const std::function<void(int done, int total)>& on_frame = nullptr);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_SCENE_FLOW_FILES_H_
