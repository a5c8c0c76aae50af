// A synthetic recording of a scene with the given frame rates, sensor and clocks, in memory or as a sequence folder
// with full ground truth.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_SYNTHETIC_SEQUENCE_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_SYNTHETIC_SEQUENCE_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "core/base/status.h"
#include "core/sequence/sequence.h"
#include "core/synthetic/render.h"
#include "core/synthetic/scene.h"
#include "core/synthetic/sensor.h"

namespace depthtween {

struct SyntheticOptions {
  std::string scene = "kick";  // one of SceneList()
  int frames = 33;             // colour frames; 33 at 240 fps span four intervals at 30 fps
  double color_fps = 240.0;
  double depth_fps = 30.0;     // at most color_fps; the ratio need not be whole
  double depth_phase_s = 0.0;  // first depth exposure after the first colour frame, stamped as such; >= 0
  int width = 512, height = 424;
  SensorModel sensor = Kinect2Sensor();
  DepthClock depth_clock;  // shifts the stamps of depth frames, not what they show
  uint64_t seed = 1;       // of textures, clutter and noise

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Stored units per metre of every synthetic recording: steps of 0.2 mm up to 13.1 m.
inline constexpr double kSyntheticDepthScale = 5000.0;

// Frames rendered on demand: nothing is kept. Colour frame i shows the scene at i / color_fps seconds.
// Threads: safe to call concurrently.
class SyntheticSequence : public FrameSource {
 public:
  // Errors: what Validate and MakeScene return. `threads` (>= 1) is used by each rendering call.
  static absl::StatusOr<std::unique_ptr<SyntheticSequence>> Create(const SyntheticOptions& options, int threads = 1);

  const Sequence& sequence() const override { return sequence_; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return RecordedColor(ColorView(index), index); }
  absl::StatusOr<Image<float>> Depth(int index) const override {
    return RecordedDepth(DepthView(index).Surface(threads_), index);
  }

  const Scene& scene() const { return *scene_; }
  // What happens at a frame, for exact truth of any kind.
  Renderer ColorView(int index) const { return RendererAt(*scene_, sequence_.camera, index / options_.color_fps); }
  Renderer DepthView(int index) const { return RendererAt(*scene_, sequence_.camera, DepthTime(index)); }
  // The same frames through the sensor.
  Image<Rgb8> RecordedColor(const Renderer& view, int index) const;
  Image<float> RecordedDepth(const SurfaceTruth& truth, int index) const;

 private:
  SyntheticSequence(const SyntheticOptions& options, std::unique_ptr<const Scene> scene, int threads);
  double DepthTime(int index) const { return options_.depth_phase_s + index / options_.depth_fps; }

  const SyntheticOptions options_;
  const std::unique_ptr<const Scene> scene_;
  const int threads_;
  Sequence sequence_;
};

struct SyntheticWriteOptions {
  bool truth = true;  // gt/ and depth_clean/ beside the recording
  int threads = 1;    // does not change the files. >= 1
  std::stop_token stop = {};
  // Called after each frame's files, from the calling thread. May be empty.
  std::function<void(int done, int total)> on_progress = nullptr;
};

// Writes the sequence folder `dir`: what a sensor would record (rgb/ as JPEG of quality 96, depth/), and, with truth,
// depth_clean/ and gt/{depth,flow,occ,object,flow_key,sceneflow_key} with gt/objects.json. Frames are numbered per
// stream. Errors: AlreadyExists when the folder holds a sequence; Cancelled when `stop` fires: frames may be there, but
// no lists.
absl::Status WriteSyntheticSequence(const SyntheticOptions& options, const std::string& dir,
                                    const SyntheticWriteOptions& write_options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_SYNTHETIC_SEQUENCE_H_
