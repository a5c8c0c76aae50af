// A scene of the library, seen by a depth camera that stands beside the colour camera or has another lens.
#ifndef DEPTHTWEEN_TESTS_CORE_CAPTURE_RIG_SOURCE_H_
#define DEPTHTWEEN_TESTS_CORE_CAPTURE_RIG_SOURCE_H_

#include <memory>
#include <string>
#include <utility>

#include "core/synthetic/synthetic_sequence.h"
#include "gtest/gtest.h"

namespace depthtween {

struct Rig {
  std::string scene;
  double right_px = 0, down_px = 0;  // by which the depth image is shifted
  double scale = 1;                  // of the depth image
  double beside_m = 0;               // the depth camera stands to the left of the colour camera
};

class RigSource : public FrameSource {
 public:
  explicit RigSource(const Rig& rig) : rig_(rig) {
    auto made = SyntheticSequence::Create({.scene = rig.scene, .frames = 17, .width = 320, .height = 240}, 2);
    EXPECT_TRUE(made.ok()) << made.status();
    recording_ = *std::move(made);
    camera_ = recording_->sequence().camera;
    camera_.fx *= rig.scale, camera_.fy *= rig.scale;
    const double middle_x = 0.5 * (camera_.width - 1), middle_y = 0.5 * (camera_.height - 1);
    camera_.cx = middle_x + rig.scale * (camera_.cx - middle_x) + rig.right_px;
    camera_.cy = middle_y + rig.scale * (camera_.cy - middle_y) + rig.down_px;
  }
  const Sequence& sequence() const override { return recording_->sequence(); }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return recording_->Color(index); }
  absl::StatusOr<Image<float>> Depth(int index) const override {
    const double time_s = 1e-9 * static_cast<double>(sequence().depth[index].time_ns);
    Pose pose = recording_->scene().WorldFromCamera(time_s);
    pose.translate(Vec3(-rig_.beside_m, 0, 0));
    const Renderer view(recording_->scene(), camera_, pose, time_s);
    return recording_->RecordedDepth(view.Surface(2), index);
  }
  // Where colour sees what the depth camera sees at (x, y), z.
  Vec2 Seen(double x, double y, double z) const {
    return sequence().camera.Project(camera_.Unproject({x, y}, z) - Vec3(rig_.beside_m, 0, 0));
  }

 private:
  const Rig rig_;
  std::unique_ptr<SyntheticSequence> recording_;
  Camera camera_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_CAPTURE_RIG_SOURCE_H_
