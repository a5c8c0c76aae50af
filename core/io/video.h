// Writes videos: MP4 (H.264) for people to look at, Matroska (FFV1) without any loss. Depth itself never goes through a
// video codec.
//
// The same frames give the same bytes on every machine with the same libavcodec: the encoders run on one thread, and
// nothing random or dated is written.
#ifndef DEPTHTWEEN_CORE_IO_VIDEO_H_
#define DEPTHTWEEN_CORE_IO_VIDEO_H_

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"

namespace depthtween {

enum class VideoContainer {
  kMp4,       // H.264 where libavcodec has an encoder for it, else MPEG-4 part 2; both lose a little
  kMatroska,  // FFV1 on RGB: every pixel comes back as it was
};

// Frames per second as a fraction: 240/1, 30000/1001.
struct FrameRate {
  int numerator = 30;
  int denominator = 1;
  double PerSecond() const { return static_cast<double>(numerator) / denominator; }
  friend bool operator==(const FrameRate& a, const FrameRate& b) {
    return a.numerator == b.numerator && a.denominator == b.denominator;
  }
};

// The clock of a stream of ascending stamps: its rate, and for each frame the tick of that clock on which it is shown.
// A dropped frame leaves a tick out, so that the video keeps time; stamps that wander by less than half a period do
// not show. Rates within 0.1 % of n or n * 1000/1001 are taken to be that. A single frame is shown for 1/30 s.
// Where the rate changes, the clock ticks so fast that every frame is shown at its stamp, to 1/120,000 s.
struct FrameClock {
  FrameRate rate;              // of frames; their mean where it changes
  FrameRate tick_rate;         // of the clock: `rate` unless that changes
  std::vector<int64_t> ticks;  // ascending from 0, one for each stamp
};
FrameClock ClockOf(const std::vector<int64_t>& time_ns);

// What a player has to know of a frame that holds the images of both eyes.
enum class VideoStereo { kNone, kSideBySide, kTopBottom };  // the left eye is the left or the upper half

struct VideoOptions {
  VideoContainer container = VideoContainer::kMp4;
  int width = 0, height = 0;  // pixels, > 0; even for MP4 unless full_chroma
  FrameRate frame_rate;
  FrameRate tick_rate = {0, 1};  // of the clock that frames are shown by; 0: one tick for each frame
  // Colour at full resolution (4:4:4), which anaglyphs need; fewer players can show it. Matroska always has it.
  bool full_chroma = false;
  // Written into the container, and into H.264 as frame packing, so that a stereo display switches by itself.
  VideoStereo stereo = VideoStereo::kNone;

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Grammar of use:  Create Write* Finish  - the file appears under its name when Finish succeeds; a writer destroyed
// before that leaves nothing behind.
class VideoWriter {
 public:
  // Unimplemented when libavcodec offers no encoder for it.
  static absl::StatusOr<VideoWriter> Create(const std::string& path, const VideoOptions& options);
  ~VideoWriter();
  VideoWriter(VideoWriter&&) noexcept;
  VideoWriter& operator=(VideoWriter&&) noexcept;

  // The next frame, shown from that tick on. InvalidArgument when its size is not that of the video,
  // or the tick not after the one before.
  absl::Status Write(ImageView<const Rgb8> frame, int64_t tick);
  // One period of the frame rate after the one before.
  absl::Status Write(ImageView<const Rgb8> frame);
  absl::Status Finish();

  // The encoder in use, as libavcodec calls it.
  std::string_view encoder() const;

 private:
  struct Impl;
  explicit VideoWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_VIDEO_H_
