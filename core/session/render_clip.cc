#include <unistd.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/api/make_upsampler.h"
#include "core/io/file.h"
#include "core/session/finished_clip.h"
#include "core/session/render_run.h"
#include "core/session/write_queue.h"

namespace depthtween {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// What will be there in the end: the videos, or the folder.
absl::StatusOr<std::vector<std::string>> FilesToWrite(const ClipRender& order, const Sequence& sequence) {
  const RenderOptions& options = order.options;
  ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, sequence, "options"));
  std::vector<std::string> files;
  if (!options.container) files.push_back(order.out);
  for (size_t i = 0; options.container && i < plan.streams.size(); ++i) {
    const std::string ending = VideoFileName(options, "", i, *options.container);
    // "out" of "out.mp4", and of "out_LRF_Full_SBS.mp4" where that ending comes anyway.
    const size_t cut = absl::EndsWith(order.out, ending) ? ending.size() : std::string(".mp4").size();
    files.push_back(order.out.substr(0, order.out.size() - cut) + ending);
  }
  for (const std::string& file : files) {
    std::error_code error;
    const bool folder = fs::is_directory(file, error);
    if (!order.force && fs::exists(file, error) && !(folder && fs::is_empty(file, error)))
      return absl::AlreadyExistsError(
          absl::StrCat(file, " is there already: name another, or use --force to replace it"));
  }
  return files;
}

// Upsamples the recording into the folder `result`, with motion.
absl::Status UpsampleForRender(const SequenceFolder& recording, const ClipRender& order, const std::string& result,
                               const std::stop_token& stop) {
  UpsampleOptions options = order.upsample;
  options.keep_motion = true;
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(options));
  ASSIGN_OR_RETURN(const ClipPlan plan, PrepareClip(recording, options, stop));
  const ClipSource source(recording, plan.alignment, options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(result, source.sequence(), true));
  ASSIGN_OR_RETURN(json self_check, order.self_check(recording));
  const std::unique_ptr<RunObserver> observer = order.observe(plan);
  ASSIGN_OR_RETURN(const std::vector<IntervalReport> reports,
                   RunIntervals(*upsampler, source, plan, 0, static_cast<int>(plan.intervals.size()), options, stop,
                                writer, *observer));
  return AssembleResult(options, recording.dir(), source.sequence(), plan, reports, json::array(),
                        std::move(self_check), writer);
}

}  // namespace

bool IsRecording(const std::string& dir) {
  return FileExists(JoinPath(dir, "rgb.txt")) && !FileExists(JoinPath(dir, "report.json"));
}

absl::StatusOr<ClipRendered> RenderClip(const ClipRender& order, std::stop_token stop) {
  const RenderOptions& options = order.options;
  std::string result = order.input, sequence = order.sequence, temporary;
  const absl::Cleanup remove_temporary = [&] {
    std::error_code error;
    if (!temporary.empty()) fs::remove_all(temporary, error);
  };
  if (IsRecording(order.input)) {
    sequence = order.input;
    ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> recording, SequenceFolder::Open(sequence));
    RETURN_IF_ERROR(FilesToWrite(order, recording->sequence()).status());
    result = temporary = absl::StrCat(fs::path(order.out).lexically_normal().string(), ".", getpid(), ".depth");
    RETURN_IF_ERROR(UpsampleForRender(*recording, order, temporary, stop));
  }
  ASSIGN_OR_RETURN(const FinishedClip clip, OpenFinishedClip(result, sequence));
  ASSIGN_OR_RETURN(const auto renderer,
                   ClipRenderer::Create(options, {clip.recording.get(), result, clip.constants}, "options"));
  ClipRendered rendered{.frames = clip.frame_count()};
  ASSIGN_OR_RETURN(rendered.files, FilesToWrite(order, clip.input));
  std::optional<PictureVideos> videos;
  std::optional<PictureFolders> folders;
  if (options.container) {
    ASSIGN_OR_RETURN(videos, PictureVideos::Create(rendered.files, options, clip.input));
  } else {
    ASSIGN_OR_RETURN(RenderPlan plan, PlanRender(options, clip.input, "options"));
    // One stream lies in OUT itself, those of two eyes in OUT/left and OUT/right.
    plan.streams = plan.streams.size() == 1 ? std::vector<std::string>{"."} : std::vector<std::string>{"left", "right"};
    ASSIGN_OR_RETURN(folders, PictureFolders::Create(order.out, options, plan));
  }
  ClipPlan progress_plan;
  progress_plan.intervals = {{.index = 0, .frame_count = rendered.frames}};
  const std::unique_ptr<RunObserver> observer = order.observe(progress_plan);
  observer->OnStage(0, std::holds_alternative<DepthOfFieldRender>(options.product) ? "depth of field" : "stereo");
  // Videos take their frames one after the other.
  WriteQueue queue(videos ? 1 : order.upsample.threads, [&](int frame) { observer->OnFrame(0, frame); });
  const auto sink = [&](int frame, std::vector<Image<Rgb8>> pictures) {
    return queue.Add(frame, [&, frame, pictures = std::move(pictures)] {
      return videos ? videos->Write(frame, pictures) : folders->Write(clip.input.color[frame].Stem(), pictures);
    });
  };
  ASSIGN_OR_RETURN(const RenderPart part,
                   renderer->Run(0, rendered.frames, nullptr, order.upsample.threads, std::move(stop), sink));
  RETURN_IF_ERROR(queue.Finish());
  if (videos) {
    RETURN_IF_ERROR(videos->Finish());
    rendered.video_fps = videos->clock().rate.PerSecond();
    rendered.rate_changes = !(videos->clock().tick_rate == videos->clock().rate);
    rendered.encoder = videos->encoder();
  }
  rendered.seconds = part.seconds;
  rendered.report = renderer->Report({part}).dump(1);
  return rendered;
}

}  // namespace depthtween
