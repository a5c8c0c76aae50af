// Pairs of RGB-D frames with what is known of the true motion between them, from the library's scenes and from folders.
#ifndef DEPTHTWEEN_TESTS_BENCH_MOTION_PAIRS_H_
#define DEPTHTWEEN_TESTS_BENCH_MOTION_PAIRS_H_

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/float3.h"
#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/metrics/scene_flow_errors.h"
#include "core/synthetic/synthetic_sequence.h"

namespace depthtween {

// kKeys: from one measured depth map to the next. kFrames: from one colour frame to the next, with exact depth.
enum class PairStep { kKeys, kFrames };
std::string_view PairStepName(PairStep step);  // "key to key", "frame to frame"

struct MotionPair {
  Image<Rgb8> from_color, to_color;
  Image<float> from_m, to_m;
  std::optional<Camera> to_camera;  // where it is not the first frame's
  bool has_truth = false;           // else the rest is empty
  Image<Flow2> flow_px;
  Image<Float3> motion_m;
  Image<uint8_t> valid, hidden;  // `hidden` may be empty
  Image<float> true_depth_m;     // of the first frame

  TrueSceneFlow Truth() const { return {{flow_px, motion_m, valid}, true_depth_m, hidden}; }
};

class MotionPairs {
 public:
  virtual ~MotionPairs() = default;
  virtual const Camera& camera() const = 0;
  virtual PairStep step() const = 0;
  virtual int count() const = 0;
  virtual absl::StatusOr<MotionPair> Read(int index) const = 0;
};

// At most `most` pairs of each kind, spread over the clip.
//
// Of a scene, both kinds, all truth exact. `clip` must outlive them.
std::vector<std::unique_ptr<MotionPairs>> ScenePairs(const SyntheticSequence& clip, int frames_per_key, int most,
                                                     int threads);

// Of a folder, what it has truth for:
//   key to key      gt/sceneflow_key/A_B.npz: `sf` and `valid`; its `flow`, or else gt/flow_key/fwd_A_B.png; hidden
//                   pixels from gt/flow_key/occ_A_B.png. True depth is depth_clean, if present.
//   frame to frame  gt/depth of both frames and gt/flow: motion is known where the flow ends on one surface in sight.
// One that has neither gives its first depth maps without truth. If there is a camera_second.json, the second frame of
// each pair is seen by that camera. Errors: what reading returns; FailedPrecondition when the folder has no pair.
absl::StatusOr<std::vector<std::unique_ptr<MotionPairs>>> FolderPairs(const std::string& dir, int most);

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_MOTION_PAIRS_H_
