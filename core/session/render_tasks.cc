#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/io/file.h"
#include "core/sequence/part_reports.h"
#include "core/session/task_input.h"
#include "core/session/tasks.h"
#include "core/session/write_queue.h"

namespace depthtween {
namespace {

using nlohmann::json;

// Of a result that may still grow: what an interval has left is there when its report is, so a file of it that is
// missing then is lost.
absl::Status WasMade(const std::string& result, const Sequence& sequence, const ClipPlan& clip, int frame,
                     bool motion) {
  const auto interval = std::find_if(clip.intervals.begin(), clip.intervals.end(), [&](const Interval& i) {
    return frame >= i.first_frame && frame < i.first_frame + i.frame_count;
  });
  if (interval == clip.intervals.end()) return absl::OkStatus();
  const absl::StatusOr<std::string> text = ReadFile(JoinPath(result, IntervalReportName(interval->index)));
  if (!text.ok()) return absl::OkStatus();
  const auto is_there = [&](const std::string& name) { return FileExists(JoinPath(result, name)); };
  if (!motion)
    return is_there(ResultDepthName(sequence.color[frame].Stem())) ? absl::OkStatus() : LostError("depth", frame);
  ASSIGN_OR_RETURN(const IntervalReport report, ParseIntervalReport(*text));
  int left = 0;
  for (int i = interval->first_frame; i < interval->first_frame + interval->frame_count; ++i) {
    left += is_there(ResultMotionName(sequence.color[i].Stem())) ? 1 : 0;
  }
  return left >= report.motion_frames ? absl::OkStatus() : LostError("motion", frame);
}

// Borrows its arguments.
RenderInput GrowingResult(const ClipSource& source, const std::string& result, const ClipPlan& clip, const Task& task) {
  return {&source, result, clip.constants,
          [&](int frame, bool motion) { return WasMade(result, source.sequence(), clip, frame, motion); },
          [&] { task.alive(); }};
}

absl::Status RenderOneFrame(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan clip, ReadClipPlan(arguments, input));
  ASSIGN_OR_RETURN(const RenderOptions options, ParseRender(input.render, "render"));
  const ClipSource source(*input.recording, clip.alignment, input.options.key_every);
  ASSIGN_OR_RETURN(const auto renderer,
                   ClipRenderer::Create(options, GrowingResult(source, arguments.result, clip, task), "render"));
  std::vector<Image<Rgb8>> rendered;
  const auto sink = [&](int, std::vector<Image<Rgb8>> pictures) {
    rendered = std::move(pictures);
    return absl::OkStatus();
  };
  RETURN_IF_ERROR(renderer->Run(arguments.frame, 1, nullptr, input.options.threads, task.stop, sink).status());
  if (rendered.size() != 1)
    return FieldError("render.stereo.format", "= separate, which makes two pictures: ask for one that is one");
  ASSIGN_OR_RETURN(const std::string bytes, EncodePicture(rendered[0], options.frame_format));
  return WriteFile(arguments.out, bytes);
}

}  // namespace

absl::Status RenderTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan clip, ReadClipPlan(arguments, input));
  const auto options = std::find_if(input.renders.begin(), input.renders.end(),
                                    [&](const RenderOptions& render) { return render.name == arguments.render; });
  if (options == input.renders.end())
    return absl::InvalidArgumentError(absl::StrCat("--render ", arguments.render, ": the options have no such render"));
  const std::string path = RenderPath(static_cast<size_t>(options - input.renders.begin()));
  RETURN_IF_ERROR(CheckIntervals(clip.intervals.size(), arguments.first, arguments.count));
  const ClipSource source(*input.recording, clip.alignment, input.options.key_every);
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(*options, sequence, path));
  ASSIGN_OR_RETURN(const auto renderer,
                   ClipRenderer::Create(*options, GrowingResult(source, arguments.result, clip, task), path));
  ASSIGN_OR_RETURN(const PictureFolders folders, PictureFolders::Create(arguments.out, *options, plan));
  // Where the pieces beside this one left the focus, if they are there.
  const auto read_part = [&](int interval) -> std::optional<RenderPart> {
    const absl::StatusOr<std::string> text =
        ReadFile(JoinPath(arguments.result, RenderReportName(options->name, interval)));
    if (!text.ok()) return std::nullopt;
    const absl::StatusOr<RenderPart> part = ParseRenderPart(*text);
    return part.ok() ? std::optional(*part) : std::nullopt;
  };
  std::optional<RenderPart> before = read_part(arguments.first - 1);
  for (int i = arguments.first; i < arguments.first + arguments.count; ++i) {
    const Interval& interval = clip.intervals[i];
    task.progress({{"stage", "render " + options->name}, {"interval", i}});
    if (!before) before = read_part(i + 1);
    WriteQueue queue(input.options.threads, [&](int frame) { task.progress({{"frame", frame}, {"interval", i}}); });
    const auto sink = [&](int frame, std::vector<Image<Rgb8>> pictures) {
      return queue.Add(frame, [&folders, stem = sequence.color[frame].Stem(), pictures = std::move(pictures)] {
        return folders.Write(stem, pictures);
      });
    };
    ASSIGN_OR_RETURN(RenderPart part,
                     renderer->Run(interval.first_frame, interval.frame_count, before ? &*before : nullptr,
                                   input.options.threads, task.stop, sink));
    RETURN_IF_ERROR(queue.Finish());
    RETURN_IF_ERROR(WriteFileDurably(JoinPath(arguments.out, RenderReportName(options->name, i)), Dump(ToJson(part))));
    task.progress({{"interval_done", i}, {"seconds", part.seconds}, {"frames", part.frames}});
    before = std::move(part);
  }
  return absl::OkStatus();
}

absl::Status RenderFrameTask(const Task& task) {
  const absl::Status status = RenderOneFrame(task);
  if (!absl::IsNotFound(status)) return status;
  // The frame itself is there, or nobody would have asked; its focus may be taken from another.
  return absl::FailedPreconditionError(
      "a frame that the focus is taken from, or followed through, is not finished yet");
}

absl::StatusOr<json> AssembleRenders(const Task& task, const TaskInput& input, const ClipPlan& clip) {
  const std::string& dir = task.arguments.out;
  const ClipSource source(*input.recording, clip.alignment, input.options.key_every);
  json reports = json::array();
  for (size_t i = 0; i < input.renders.size(); ++i) {
    const RenderOptions& options = input.renders[i];
    ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, source.sequence(), RenderPath(i)));
    std::vector<RenderPart> parts;
    for (const Interval& interval : clip.intervals) {
      ASSIGN_OR_RETURN(const std::string text, ReadFile(JoinPath(dir, RenderReportName(options.name, interval.index))));
      ASSIGN_OR_RETURN(parts.emplace_back(), ParseRenderPart(text));
      task.alive();
    }
    task.progress({{"stage", "assemble " + options.name}, {"interval", 0}});
    RETURN_IF_ERROR(AssembleVideos(dir, options, plan, source.sequence(), task.stop, [&](int) { task.alive(); }));
    ASSIGN_OR_RETURN(const auto renderer, ClipRenderer::Create(options, {&source, dir, clip.constants}, RenderPath(i)));
    json report = renderer->Report(parts);
    double seconds = 0;
    for (const RenderPart& part : parts) seconds += part.seconds;
    report.update({{"name", options.name}, {"seconds", seconds}, {"videos", plan.videos}});
    reports.push_back(std::move(report));
  }
  return reports;
}

}  // namespace depthtween
