// Writes MP4 videos for people to look at. Depth itself never goes through a video codec.
#ifndef DEPTHTWEEN_CORE_IO_VIDEO_H_
#define DEPTHTWEEN_CORE_IO_VIDEO_H_

#include <memory>
#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"

namespace depthtween {

// Grammar of use:  Create Write* Finish  - the file appears under its name when Finish succeeds; a writer destroyed
// before that leaves nothing behind.
class VideoWriter {
 public:
  // H.264 where libavcodec has an encoder for it, else MPEG-4 part 2. Width and height must be even (chroma is halved)
  // and frames_per_second positive. Unimplemented when libavcodec offers no encoder at all.
  static absl::StatusOr<VideoWriter> Create(const std::string& path, int width, int height, int frames_per_second);
  ~VideoWriter();
  VideoWriter(VideoWriter&&) noexcept;
  VideoWriter& operator=(VideoWriter&&) noexcept;

  // The next frame. InvalidArgument when its size is not that of the video.
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
