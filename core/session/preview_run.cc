#include <algorithm>
#include <iterator>
#include <optional>

#include "absl/strings/str_format.h"
#include "core/io/png.h"
#include "core/io/video.h"
#include "core/sequence/interval.h"
#include "core/session/preview.h"

namespace depthtween {
namespace {

constexpr int kVideoFramesPerSecond = 30;  // 240 fps shown at this speed is slow motion by 8: every frame can be seen
constexpr int kSheetColumns = 5;

PreviewRange RangeOf(const FinishedClip& clip) {
  return {.near_m = static_cast<float>(clip.constants.preview_near_m),
          .far_m = static_cast<float>(clip.constants.preview_far_m)};
}

absl::StatusOr<PreviewFrame> ReadPreviewFrame(const FinishedClip& clip, int index) {
  PreviewFrame frame{.index = index, .time_ns = clip.input.color[index].time_ns - clip.start_ns()};
  ASSIGN_OR_RETURN(frame.color, clip.recording->Color(index));
  ASSIGN_OR_RETURN(frame.depth_m, clip.result.Depth(index));
  ASSIGN_OR_RETURN(frame.sigma_m, clip.result.Sigma(index));
  ASSIGN_OR_RETURN(const Image<Provenance> provenance, clip.result.ProvenanceAt(index));
  const auto any = [&](Provenance wanted) {
    return std::find(provenance.data(), provenance.data() + provenance.pixel_count(), wanted) !=
           provenance.data() + provenance.pixel_count();
  };
  // The result is the witness: a colour frame next to a depth frame in time is one only if the upsampler took it so.
  if (any(Provenance::kHeld))
    frame.kind = FrameKind::kHeld;
  else if (any(Provenance::kMeasured))
    frame.kind = FrameKind::kKey;
  return frame;
}

// Frames evenly spread over one interval, from its key to the next: the interval with frame `wanted` in it, or the one
// in the middle of the clip.
std::vector<int> ChooseSheetFrames(const FinishedClip& clip, int wanted) {
  const std::vector<Interval> intervals = PlanIntervals(clip.input);
  if (wanted < 0) {
    std::vector<Interval> between;
    std::copy_if(intervals.begin(), intervals.end(), std::back_inserter(between),
                 [](const Interval& interval) { return !interval.Held(); });
    const std::vector<Interval>& candidates = between.empty() ? intervals : between;
    wanted = candidates[candidates.size() / 2].first_frame;
  }
  const Interval& interval = *std::find_if(intervals.begin(), intervals.end(), [&](const Interval& candidate) {
    return wanted < candidate.first_frame + candidate.frame_count;
  });
  const int first = interval.first_frame;
  int last = first + interval.frame_count - 1;
  if (!interval.Held()) {  // on to the next key: the first frame of the next interval, or of this one if it is the last
    const int64_t key_ns = clip.input.depth[interval.key_after].time_ns;
    while (last > first && clip.input.color[last - 1].time_ns >= key_ns) --last;
    if (clip.input.color[last].time_ns < key_ns && last + 1 < clip.frame_count()) ++last;
  }
  const int columns = std::min(kSheetColumns, last - first + 1);
  std::vector<int> frames;
  for (int i = 0; i < columns; ++i) frames.push_back(columns == 1 ? first : first + (last - first) * i / (columns - 1));
  return frames;
}

}  // namespace

absl::StatusOr<std::string> WritePreviewSheet(const FinishedClip& clip, int frame, const std::string& file) {
  std::vector<PreviewFrame> frames;
  for (const int index : ChooseSheetFrames(clip, frame)) {
    ASSIGN_OR_RETURN(frames.emplace_back(), ReadPreviewFrame(clip, index));
  }
  const Image<Rgb8> sheet = DrawContactSheet(frames, RangeOf(clip));
  RETURN_IF_ERROR(WritePngRgb8(file, sheet));
  return absl::StrFormat("frames %d to %d, %d x %d", frames.front().index, frames.back().index, sheet.width(),
                         sheet.height());
}

absl::StatusOr<std::string> WritePreviewVideo(const FinishedClip& clip, const std::string& file, std::stop_token stop) {
  PreviewTimeline timeline{.duration_ns = std::max<int64_t>(1, clip.input.color.back().time_ns - clip.start_ns())};
  for (const FrameRef& key : clip.input.depth) timeline.key_times_ns.push_back(key.time_ns - clip.start_ns());
  std::optional<VideoWriter> video;
  for (int i = 0; i < clip.frame_count(); ++i) {
    if (stop.stop_requested()) return absl::CancelledError("stopped; no video was written");
    ASSIGN_OR_RETURN(const PreviewFrame frame, ReadPreviewFrame(clip, i));
    const Image<Rgb8> picture = DrawVideoFrame(frame, timeline, RangeOf(clip));
    if (!video) {
      ASSIGN_OR_RETURN(video, VideoWriter::Create(file, {.width = picture.width(),
                                                         .height = picture.height(),
                                                         .frame_rate = {.numerator = kVideoFramesPerSecond}}));
    }
    RETURN_IF_ERROR(video->Write(picture));
  }
  RETURN_IF_ERROR(video->Finish());
  const double shown_seconds = static_cast<double>(clip.frame_count()) / kVideoFramesPerSecond;
  return absl::StrFormat("%d frames at %d per second (%.3g times real time), %s", clip.frame_count(),
                         kVideoFramesPerSecond, static_cast<double>(timeline.duration_ns) * 1e-9 / shown_seconds,
                         video->encoder());
}

}  // namespace depthtween
