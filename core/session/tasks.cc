#include "core/session/tasks.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/api/make_upsampler.h"
#include "core/io/file.h"
#include "core/io/unzip.h"
#include "core/sequence/camera_json.h"
#include "core/sequence/part_reports.h"
#include "core/session/scene_flow_files.h"
#include "core/session/self_check.h"
#include "core/session/task_input.h"

namespace depthtween {
namespace {

using nlohmann::json;

json FramesToJson(const std::vector<FrameRef>& frames) {
  json list = json::array();
  for (const FrameRef& frame : frames) list.push_back({{"time_ns", frame.time_ns}, {"path", frame.path}});
  return list;
}

// Sends what happens down the pipe, and leaves each interval's report beside its frames.
class TaskObserver : public RunObserver {
 public:
  explicit TaskObserver(const Task& task) : task_(task) {}

  void OnStage(int interval, std::string_view stage) override {
    task_.progress({{"stage", stage}, {"interval", interval}});
  }
  void OnItem() override { task_.alive(); }
  void OnFrame(int interval, int frame) override { task_.progress({{"frame", frame}, {"interval", interval}}); }
  absl::Status OnIntervalDone(const IntervalReport& report) override {
    RETURN_IF_ERROR(
        WriteFileDurably(JoinPath(task_.arguments.out, IntervalReportName(report.index)), Dump(ToJson(report))));
    task_.progress({{"interval_done", report.index}, {"seconds", report.seconds}, {"frames", report.summary.frames}});
    return absl::OkStatus();
  }

 private:
  const Task& task_;
};

// Intervals of a scene flow: pairs of frames.
absl::Status PairsTask(const Task& task, const TaskInput& input) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(input.recording->sequence(), input.scene_flow->every));
  RETURN_IF_ERROR(CheckIntervals(pairs.size(), arguments.first, arguments.count));
  RETURN_IF_ERROR(MakeSceneFlowFolders(arguments.out, input.scene_flow->formats));
  for (int i = arguments.first; i < arguments.first + arguments.count; ++i) {
    task.progress({{"stage", "scene flow"}, {"interval", i}});
    ASSIGN_OR_RETURN(const ComputedPair computed,
                     ComputePair(*input.recording, pairs[i], *input.scene_flow, task.stop, arguments.out, task.alive));
    RETURN_IF_ERROR(WriteFileDurably(JoinPath(arguments.out, IntervalReportName(i)), Dump(ToJson(computed.summary))));
    task.progress({{"interval_done", i}, {"seconds", computed.summary.seconds}, {"frames", 1}});
  }
  return absl::OkStatus();
}

absl::Status AssemblePairs(const Task& task, const TaskInput& input) {
  const std::string& out = task.arguments.out;
  ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(input.recording->sequence(), input.scene_flow->every));
  std::vector<PairSummary> summaries;
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    ASSIGN_OR_RETURN(const std::string text, ReadFile(JoinPath(out, IntervalReportName(i))));
    ASSIGN_OR_RETURN(summaries.emplace_back(), ParsePairSummary(text));
    task.alive();
  }
  std::vector<PicturedPair> pictured;
  for (const int i : PairsToPicture(static_cast<int>(pairs.size()))) {
    ASSIGN_OR_RETURN(pictured.emplace_back(), ReadPicture(*input.recording, pairs[i], out));
    task.alive();
  }
  return FinishSceneFlow(*input.scene_flow, out, summaries, pictured).status();
}

json ViolationsToJson(const std::vector<FileViolation>& violations) {
  json result = json::array();
  for (const FileViolation& violation : violations) {
    result.push_back({{"file", violation.file},
                      {"code", absl::StatusCodeToString(violation.status.code())},
                      {"message", std::string(violation.status.message())}});
  }
  return result;
}

}  // namespace

absl::StatusOr<json> UnpackTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const UnzipSummary summary,
                   Unzip(JoinPath(arguments.sequence, arguments.archive), arguments.out,
                         {.max_files = arguments.max_files, .max_bytes = arguments.max_bytes}, task.stop,
                         [&](int /*done*/, int /*of*/) { task.alive(); }));
  return json{{"ok", summary.ok()},
              {"violations", ViolationsToJson(summary.violations)},
              {"files", summary.files},
              {"bytes", summary.bytes}};
}

absl::StatusOr<json> ValidateTask(const Task& task) {
  const CheckOptions options{.threads = task.arguments.threads,
                             .max_pixels = task.arguments.max_pixels,
                             .stop = task.stop,
                             .on_progress = [&](int checked, int of) {
                               task.progress({{"checked", checked}, {"of", of}});
                             }};
  ASSIGN_OR_RETURN(const SequenceCheck check, CheckSequenceFolder(task.arguments.sequence, options));
  const Sequence& sequence = check.sequence;
  return json{{"ok", check.ok()},
              {"violations", ViolationsToJson(check.violations)},
              {"warnings", check.warnings},
              {"camera", CameraToJson(sequence.camera, sequence.depth_scale)},
              {"color", FramesToJson(sequence.color)},
              {"depth", FramesToJson(sequence.depth)},
              {"median_depth_m", check.median_depth_m}};
}

absl::Status PrepareTask(const Task& task) {
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(task.arguments));
  if (input.scene_flow) {
    const Sequence& sequence = input.recording->sequence();
    ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(sequence, input.scene_flow->every));
    return WriteFileDurably(task.arguments.constants, Dump(PairsToJson(pairs, sequence)));
  }
  ASSIGN_OR_RETURN(const ClipPlan plan,
                   PrepareClip(*input.recording, input.options, task.stop, [&](int done, int total) {
                     task.progress({{"stage", absl::StrFormat("clock, look %d of %d", done, total)}});
                   }));
  // A render that does not fit this clip is better refused now than after its depth has been computed.
  for (size_t i = 0; i < input.renders.size(); ++i)
    RETURN_IF_ERROR(CheckRender(input.renders[i], input.recording->sequence(), plan.constants, RenderPath(i)));
  return WriteFileDurably(task.arguments.constants, Dump(ToJson(plan, input.recording->sequence())));
}

absl::Status SelfCheckTask(const Task& task) {
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(task.arguments));
  ASSIGN_OR_RETURN(const SelfCheck check,
                   CheckSelf(
                       *input.recording, input.options, task.stop,
                       [&](int done, int total) {
                         task.progress({{"stage", absl::StrFormat("self-check, map %d of %d", done + 1, total)}});
                       },
                       task.alive));
  return WriteFileDurably(task.arguments.out, Dump(ToJson(check)));
}

absl::Status IntervalsTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(arguments));
  if (input.scene_flow) return PairsTask(task, input);
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(input.options));
  const ClipSource source(*input.recording, plan.alignment, input.options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer,
                   ResultWriter::Create(arguments.out, source.sequence(), input.options.NeedsMotion()));
  TaskObserver observer(task);
  return RunIntervals(*upsampler, source, plan, arguments.first, arguments.count, input.options, task.stop, writer,
                      observer)
      .status();
}

absl::Status PlanTask(const Task& task) {
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(task.arguments));
  if (input.scene_flow) RETURN_IF_ERROR(PlanPairs(input.recording->sequence(), input.scene_flow->every).status());
  json plans = json::array();
  for (size_t i = 0; i < input.renders.size(); ++i) {
    ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(input.renders[i], input.recording->sequence(), RenderPath(i)));
    plans.push_back(ToJson(input.renders[i], plan));
  }
  return WriteFile(task.arguments.out, Dump({{"renders", std::move(plans)}}));
}

absl::Status AssembleTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const TaskInput input, OpenInput(arguments));
  if (input.scene_flow) return AssemblePairs(task, input);
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  std::vector<IntervalReport> reports;
  for (const Interval& interval : plan.intervals) {
    const std::string path = JoinPath(arguments.out, IntervalReportName(interval.index));
    if (!FileExists(path)) continue;  // AssembleResult names what is missing
    ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
    ASSIGN_OR_RETURN(reports.emplace_back(), ParseIntervalReport(text));
    task.alive();
  }
  json self_check;
  if (!arguments.self_check.empty()) {
    ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.self_check));
    self_check = json::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false);
    if (!self_check.is_object())
      return absl::DataLossError(absl::StrCat(arguments.self_check, " is not what the task self-check wrote"));
  }
  ASSIGN_OR_RETURN(json renders, AssembleRenders(task, input, plan));
  const ClipSource source(*input.recording, plan.alignment, input.options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(arguments.out, source.sequence()));
  // The path of the recording on the server is private, and of no use to those who fetch the result.
  return AssembleResult(input.options, /*sequence_dir=*/"", source.sequence(), plan, reports, std::move(renders),
                        std::move(self_check), writer,
                        {.stop = task.stop, .on_scene_flow = [&](int done, int total) {
                           task.progress({{"stage", absl::StrFormat("scene flow, frame %d of %d", done, total)}});
                         }});
}

}  // namespace depthtween
