#include <algorithm>
#include <filesystem>
#include <iostream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "core/io/png.h"
#include "core/io/video.h"
#include "core/sequence/interval.h"
#include "core/session/finished_clip.h"
#include "core/session/preview.h"
#include "core/tools/commands.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

constexpr int kVideoFramesPerSecond = 30;  // 240 fps shown at this speed is slow motion by 8: every frame can be seen
constexpr int kSheetColumns = 5;

struct PreviewArguments {
  std::string result, file, sequence;
  int frame = -1;
};

PreviewRange RangeOf(const FinishedClip& clip) {
  return {.near_m = static_cast<float>(clip.constants.preview_near_m),
          .far_m = static_cast<float>(clip.constants.preview_far_m)};
}

absl::StatusOr<PreviewFrame> ReadFrame(const FinishedClip& clip, int index) {
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
std::vector<int> ChooseFrames(const FinishedClip& clip, int wanted) {
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

absl::Status WriteSheet(const FinishedClip& clip, const PreviewArguments& arguments) {
  std::vector<PreviewFrame> frames;
  for (const int index : ChooseFrames(clip, arguments.frame)) {
    ASSIGN_OR_RETURN(frames.emplace_back(), ReadFrame(clip, index));
  }
  const Image<Rgb8> sheet = DrawContactSheet(frames, RangeOf(clip));
  RETURN_IF_ERROR(WritePngRgb8(arguments.file, sheet));
  std::cout << absl::StrFormat("%s: frames %d to %d, %d x %d\n", arguments.file, frames.front().index,
                               frames.back().index, sheet.width(), sheet.height());
  return absl::OkStatus();
}

absl::Status WriteVideo(const FinishedClip& clip, const PreviewArguments& arguments, std::stop_token stop) {
  PreviewTimeline timeline{.duration_ns = std::max<int64_t>(1, clip.input.color.back().time_ns - clip.start_ns())};
  for (const FrameRef& key : clip.input.depth) timeline.key_times_ns.push_back(key.time_ns - clip.start_ns());
  std::optional<VideoWriter> video;
  for (int i = 0; i < clip.frame_count(); ++i) {
    if (stop.stop_requested()) return absl::CancelledError("stopped; no video was written");
    ASSIGN_OR_RETURN(const PreviewFrame frame, ReadFrame(clip, i));
    const Image<Rgb8> picture = DrawVideoFrame(frame, timeline, RangeOf(clip));
    if (!video) {
      ASSIGN_OR_RETURN(video,
                       VideoWriter::Create(arguments.file, {.width = picture.width(),
                                                            .height = picture.height(),
                                                            .frame_rate = {.numerator = kVideoFramesPerSecond}}));
    }
    RETURN_IF_ERROR(video->Write(picture));
  }
  RETURN_IF_ERROR(video->Finish());
  const double shown_seconds = static_cast<double>(clip.frame_count()) / kVideoFramesPerSecond;
  std::cout << absl::StrFormat("%s: %d frames at %d per second (%.3g times real time), %s\n", arguments.file,
                               clip.frame_count(), kVideoFramesPerSecond,
                               static_cast<double>(timeline.duration_ns) * 1e-9 / shown_seconds, video->encoder());
  return absl::OkStatus();
}

absl::Status Preview(const PreviewArguments& arguments) {
  StopOnSignals signals;
  const bool is_video = absl::EndsWithIgnoreCase(arguments.file, ".mp4");
  if (!is_video && !absl::EndsWithIgnoreCase(arguments.file, ".png"))
    return absl::InvalidArgumentError(absl::StrFormat("-o %s: must end in .png or .mp4", arguments.file));
  if (is_video && arguments.frame >= 0)
    return absl::InvalidArgumentError("--frame chooses what a .png shows; a .mp4 shows every frame");
  ASSIGN_OR_RETURN(const FinishedClip clip, OpenFinishedClip(arguments.result, arguments.sequence));
  if (arguments.frame >= clip.frame_count())
    return absl::InvalidArgumentError(
        absl::StrFormat("--frame %d: the clip has frames 0 to %d", arguments.frame, clip.frame_count() - 1));
  return is_video ? WriteVideo(clip, arguments, signals.token()) : WriteSheet(clip, arguments);
}

}  // namespace

void AddPreviewCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<PreviewArguments>();
  CLI::App* const command = app.add_subcommand("preview", "Show a result: colour, depth and uncertainty side by side");
  command->footer(
      "A .png shows frames from one depth frame to the next; a .mp4 shows every frame, at 30 per second.\n"
      "A colour stands for the same distance in the whole clip.\n"
      "\n"
      "Example:  depthtween-core preview result -o result.png\n"
      "Example:  depthtween-core preview result -o result.mp4\n");
  command->add_option("result", arguments->result, "Folder that upsample wrote")->required()->type_name("OUT");
  command->add_option("-o,--out", arguments->file, "Picture (.png) or video (.mp4) to write")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--sequence", arguments->sequence,
                   "The recording, if it is no longer where upsample read it, or if a server did")
      ->type_name("SEQ");
  command->add_option("--frame", arguments->frame, "Show the interval with this frame [the middle one]")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");
  command->callback([=] { *exit_code = ReportStatus(Preview(*arguments)); });
}

}  // namespace depthtween::tools
