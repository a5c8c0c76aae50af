// Pictures for people: colour, depth and uncertainty side by side, with legends, on one fixed scale per clip so that a
// colour means the same distance in every frame.
#ifndef DEPTHTWEEN_CORE_SESSION_PREVIEW_H_
#define DEPTHTWEEN_CORE_SESSION_PREVIEW_H_

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/session/finished_clip.h"

namespace depthtween {

// Depths shown, metres. 0 < near_m < far_m. Depth outside takes the colour of the nearer end.
struct PreviewRange {
  float near_m = 0.5F;
  float far_m = 5.0F;
};

// Near is warm, far is cold (Turbo, logarithmic in depth); unknown is dark grey.
Image<Rgb8> ColorizeDepth(ImageView<const float> depth_m, const PreviewRange& range);
// 1 mm is black, 1 m is bright, in decades (Inferno); unknown (0) is dark grey.
Image<Rgb8> ColorizeSigma(ImageView<const float> sigma_m);

// Where a frame's depth comes from, as a whole.
enum class FrameKind { kKey, kBetween, kHeld };

// One colour frame and what was found for it. All images have the same size.
struct PreviewFrame {
  int index = 0;
  int64_t time_ns = 0;  // since the clip's first frame
  FrameKind kind = FrameKind::kBetween;
  Image<Rgb8> color;
  Image<float> depth_m;
  Image<float> sigma_m;
};

// Where the frame of a video stands in its clip.
struct PreviewTimeline {
  int64_t duration_ns = 0;            // > 0
  std::vector<int64_t> key_times_ns;  // since the clip's first frame
};

// A frame of the preview video: three panels, legends below depth and uncertainty, a time line with the keys below
// colour. Width and height are even and depend only on the size of the frame's images.
Image<Rgb8> DrawVideoFrame(const PreviewFrame& frame, const PreviewTimeline& timeline, const PreviewRange& range);

// A still picture: a column for each of `frames` (>= 1, all of one size), rows colour, depth, uncertainty.
Image<Rgb8> DrawContactSheet(const std::vector<PreviewFrame>& frames, const PreviewRange& range);

// Writes the contact sheet of one interval of `clip` as a PNG: at most five of its frames, evenly spread from its key
// to the next one. The interval has `frame` in it, 0 to clip.frame_count() - 1; -1: the one in the middle of the clip.
// Returns what the picture shows, in words for people. Errors: what reading and writing files returns.
absl::StatusOr<std::string> WritePreviewSheet(const FinishedClip& clip, int frame, const std::string& file);

// Writes every frame as an MP4, 30 per second; returns likewise. Errors: likewise, and Cancelled when `stop` fires:
// then there is no file. Memory: one frame at a time.
absl::StatusOr<std::string> WritePreviewVideo(const FinishedClip& clip, const std::string& file, std::stop_token stop);

// Errors of at least this show in full colour, metres.
inline constexpr float kErrorShownM = 0.1F;
// Estimate minus truth: too near is blue, too far is red, right is white; where either is unknown (0), dark grey.
Image<Rgb8> ColorizeError(ImageView<const float> estimate_m, ImageView<const float> truth_m);

// One frame of several methods beside the truth. All images have the same size.
struct StripFrame {
  int index = 0;
  int64_t time_ns = 0;  // since the clip's first frame
  Image<Rgb8> color;
  Image<float> truth_m;
  std::vector<Image<float>> estimates_m;  // one for each method
};

// A column for each of `frames` (>= 1, all of one size), rows: colour, depth of the first of `methods` (>= 1), error of
// each method, all errors on one scale.
Image<Rgb8> DrawErrorStrip(const std::vector<StripFrame>& frames, const std::vector<std::string>& methods,
                           const PreviewRange& range);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_PREVIEW_H_
