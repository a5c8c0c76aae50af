// `depthtween-core task`: the steps of an upsampling as processes of their own. A server runs them as children, so that
// a crash in a decoder on a hostile file, a memory limit or a cancelled job ends the child alone.
#include <sys/prctl.h>

#include <algorithm>
#include <csignal>
#include <exception>
#include <functional>
#include <iostream>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "core/sequence/camera_json.h"
#include "core/sequence/part_reports.h"
#include "core/session/render_run.h"
#include "core/session/scene_flow_files.h"
#include "core/session/scene_flow_run.h"
#include "core/session/self_check.h"
#include "core/session/upsample_run.h"
#include "core/session/write_queue.h"
#include "core/tools/commands.h"
#include "core/tools/progress_pipe.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;

struct TaskArguments {
  std::string sequence, options, constants, out, result, render, self_check;
  int first = 0, count = 0, frame = 0, threads = 1, progress_fd = -1;
  bool keep_motion = false;
};

struct Task {
  const TaskArguments& arguments;
  std::stop_token stop;
  ProgressPipe& progress;
};

std::string Dump(const json& value) { return value.dump(2, ' ', false, json::error_handler_t::replace) + "\n"; }

std::string RenderPath(size_t index) { return absl::StrCat("renders[", index, "]"); }

// What every task but `validate` begins with.
struct Input {
  UpsampleOptions options;
  std::vector<RenderOptions> renders;
  json render;                               // of render-frame
  std::optional<SceneFlowOrder> scene_flow;  // in place of an upsampling
  std::unique_ptr<SequenceFolder> recording;
};

absl::StatusOr<Input> OpenInput(const TaskArguments& arguments) {
  Input input;
  ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.options));
  const json order = json::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (!order.is_object())
    return absl::InvalidArgumentError(absl::StrCat(arguments.options, " must hold a JSON object"));
  for (const auto& [field, value] : order.items()) {
    if (field == "upsample") {
      ASSIGN_OR_RETURN(input.options, ParseUpsampleOptions(value));
    } else if (field == "scene_flow") {
      ASSIGN_OR_RETURN(input.scene_flow, ParseSceneFlowOrder(value, "scene_flow_options"));
    } else if (field == "renders") {
      ASSIGN_OR_RETURN(input.renders, ParseRenders(value));
    } else if (field == "render") {
      input.render = value;
    } else {
      return FieldError(field, "is not known: an order has upsample, scene_flow, renders or render");
    }
  }
  input.options.threads = arguments.threads;
  input.options.keep_motion = arguments.keep_motion;
  if (input.scene_flow) input.scene_flow->threads = arguments.threads;
  ASSIGN_OR_RETURN(input.recording, SequenceFolder::Open(arguments.sequence));
  return input;
}

absl::StatusOr<ClipPlan> ReadClipPlan(const TaskArguments& arguments, const Input& input) {
  ASSIGN_OR_RETURN(const std::string constants, ReadFile(arguments.constants));
  return ParseClipPlan(constants, input.recording->sequence(), input.options);
}

json FramesToJson(const std::vector<FrameRef>& frames) {
  json list = json::array();
  for (const FrameRef& frame : frames) list.push_back({{"time_ns", frame.time_ns}, {"path", frame.path}});
  return list;
}

absl::Status ValidateTask(const Task& task) {
  const CheckOptions options{
      .threads = task.arguments.threads, .stop = task.stop, .on_progress = [&](int checked, int of) {
        task.progress.Send({{"checked", checked}, {"of", of}});
      }};
  ASSIGN_OR_RETURN(const SequenceCheck check, CheckSequenceFolder(task.arguments.sequence, options));
  json violations = json::array();
  for (const FileViolation& violation : check.violations)
    violations.push_back({{"file", violation.file},
                          {"code", absl::StatusCodeToString(violation.status.code())},
                          {"message", std::string(violation.status.message())}});
  const Sequence& sequence = check.sequence;
  std::cout << Dump({{"ok", check.ok()},
                     {"violations", violations},
                     {"warnings", check.warnings},
                     {"camera", CameraToJson(sequence.camera, sequence.depth_scale)},
                     {"color", FramesToJson(sequence.color)},
                     {"depth", FramesToJson(sequence.depth)},
                     {"median_depth_m", check.median_depth_m}})
            << std::flush;
  return std::cout ? absl::OkStatus() : absl::InternalError("cannot write the answer to stdout");
}

absl::Status PrepareTask(const Task& task) {
  ASSIGN_OR_RETURN(const Input input, OpenInput(task.arguments));
  if (input.scene_flow) {
    const Sequence& sequence = input.recording->sequence();
    ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(sequence, input.scene_flow->every));
    return WriteFileDurably(task.arguments.constants, Dump(PairsToJson(pairs, sequence)));
  }
  ASSIGN_OR_RETURN(const ClipPlan plan,
                   PrepareClip(*input.recording, input.options, task.stop, [&](int done, int total) {
                     task.progress.Send({{"stage", absl::StrFormat("clock, look %d of %d", done, total)}});
                   }));
  // A render that does not fit this clip is better refused now than after its depth has been computed.
  for (size_t i = 0; i < input.renders.size(); ++i)
    RETURN_IF_ERROR(CheckRender(input.renders[i], input.recording->sequence(), plan.constants, RenderPath(i)));
  return WriteFileDurably(task.arguments.constants, Dump(ToJson(plan, input.recording->sequence())));
}

absl::Status SelfCheckTask(const Task& task) {
  ASSIGN_OR_RETURN(const Input input, OpenInput(task.arguments));
  ASSIGN_OR_RETURN(const SelfCheck check,
                   CheckSelf(*input.recording, input.options, task.stop, [&](int done, int total) {
                     task.progress.Send({{"stage", absl::StrFormat("self-check, map %d of %d", done + 1, total)}});
                   }));
  return WriteFileDurably(task.arguments.out, Dump(ToJson(check)));
}

// Sends what happens down the pipe, and leaves each interval's report beside its frames.
class TaskObserver : public RunObserver {
 public:
  explicit TaskObserver(const Task& task) : task_(task) {}

  void OnStage(int interval, std::string_view stage) override {
    task_.progress.Send({{"stage", stage}, {"interval", interval}});
  }
  void OnFrame(int interval, int frame) override { task_.progress.Send({{"frame", frame}, {"interval", interval}}); }
  absl::Status OnIntervalDone(const IntervalReport& report) override {
    RETURN_IF_ERROR(
        WriteFileDurably(JoinPath(task_.arguments.out, IntervalReportName(report.index)), Dump(ToJson(report))));
    task_.progress.Send(
        {{"interval_done", report.index}, {"seconds", report.seconds}, {"frames", report.summary.frames}});
    return absl::OkStatus();
  }

 private:
  const Task& task_;
};

// Intervals of a scene flow: pairs of frames.
absl::Status PairsTask(const Task& task, const Input& input) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(input.recording->sequence(), input.scene_flow->every));
  const int pair_count = static_cast<int>(pairs.size());
  if (arguments.first < 0 || arguments.count < 1 || arguments.first > pair_count - arguments.count)
    return absl::InvalidArgumentError(
        absl::StrFormat("%d intervals from interval %d on are not there: this clip has intervals 0 to %d",
                        arguments.count, arguments.first, pair_count - 1));
  RETURN_IF_ERROR(MakeSceneFlowFolders(arguments.out, input.scene_flow->formats));
  for (int i = arguments.first; i < arguments.first + arguments.count; ++i) {
    task.progress.Send({{"stage", "scene flow"}, {"interval", i}});
    ASSIGN_OR_RETURN(const ComputedPair computed,
                     ComputePair(*input.recording, pairs[i], *input.scene_flow, task.stop, arguments.out));
    RETURN_IF_ERROR(WriteFileDurably(JoinPath(arguments.out, IntervalReportName(i)), Dump(ToJson(computed.summary))));
    task.progress.Send({{"interval_done", i}, {"seconds", computed.summary.seconds}, {"frames", 1}});
  }
  return absl::OkStatus();
}

absl::Status AssemblePairs(const Task& task, const Input& input) {
  const std::string& out = task.arguments.out;
  ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(input.recording->sequence(), input.scene_flow->every));
  std::vector<PairSummary> summaries;
  for (int i = 0; i < static_cast<int>(pairs.size()); ++i) {
    ASSIGN_OR_RETURN(const std::string text, ReadFile(JoinPath(out, IntervalReportName(i))));
    ASSIGN_OR_RETURN(summaries.emplace_back(), ParsePairSummary(text));
  }
  std::vector<PicturedPair> pictured;
  for (const int i : PairsToPicture(static_cast<int>(pairs.size()))) {
    ASSIGN_OR_RETURN(pictured.emplace_back(), ReadPicture(*input.recording, pairs[i], out));
  }
  return FinishSceneFlow(*input.scene_flow, out, summaries, pictured).status();
}

absl::Status IntervalsTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  if (input.scene_flow) return PairsTask(task, input);
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(input.options));
  const ClipSource source(*input.recording, plan.clock, input.options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer,
                   ResultWriter::Create(arguments.out, source.sequence(), input.options.NeedsMotion()));
  TaskObserver observer(task);
  return RunIntervals(*upsampler, source, plan, arguments.first, arguments.count, input.options, task.stop, writer,
                      observer)
      .status();
}

// What can be told of an order before it is taken: whether the recording has the pairs of frames that a scene flow
// needs, and what renders need and leave.
absl::Status PlanTask(const Task& task) {
  ASSIGN_OR_RETURN(const Input input, OpenInput(task.arguments));
  if (input.scene_flow) RETURN_IF_ERROR(PlanPairs(input.recording->sequence(), input.scene_flow->every).status());
  json plans = json::array();
  for (size_t i = 0; i < input.renders.size(); ++i) {
    ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(input.renders[i], input.recording->sequence(), RenderPath(i)));
    plans.push_back(ToJson(input.renders[i], plan));
  }
  return WriteFile(task.arguments.out, Dump({{"renders", std::move(plans)}}));
}

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

absl::Status RenderTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan clip, ReadClipPlan(arguments, input));
  const auto options = std::find_if(input.renders.begin(), input.renders.end(),
                                    [&](const RenderOptions& render) { return render.name == arguments.render; });
  if (options == input.renders.end())
    return absl::InvalidArgumentError(absl::StrCat("--render ", arguments.render, ": the options have no such render"));
  const std::string path = RenderPath(static_cast<size_t>(options - input.renders.begin()));
  RETURN_IF_ERROR(CheckIntervals(clip, arguments.first, arguments.count));
  const ClipSource source(*input.recording, clip.clock, input.options.key_every);
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(*options, sequence, path));
  ASSIGN_OR_RETURN(const auto renderer, Renderer::Create(*options,
                                                         {&source, arguments.result, clip.constants,
                                                          [&](int frame, bool motion) {
                                                            return WasMade(arguments.result, sequence, clip, frame,
                                                                           motion);
                                                          }},
                                                         path));
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
    task.progress.Send({{"stage", "render " + options->name}, {"interval", i}});
    if (!before) before = read_part(i + 1);
    WriteQueue queue(input.options.threads, [&](int frame) {
      task.progress.Send({{"frame", frame}, {"interval", i}});
    });
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
    task.progress.Send({{"interval_done", i}, {"seconds", part.seconds}, {"frames", part.frames}});
    before = std::move(part);
  }
  return absl::OkStatus();
}

absl::Status RenderOneFrame(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan clip, ReadClipPlan(arguments, input));
  ASSIGN_OR_RETURN(const RenderOptions options, ParseRender(input.render, "render"));
  const ClipSource source(*input.recording, clip.clock, input.options.key_every);
  ASSIGN_OR_RETURN(const auto renderer, Renderer::Create(options,
                                                         {&source, arguments.result, clip.constants,
                                                          [&](int frame, bool motion) {
                                                            return WasMade(arguments.result, source.sequence(), clip,
                                                                           frame, motion);
                                                          }},
                                                         "render"));
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

absl::Status RenderFrameTask(const Task& task) {
  const absl::Status status = RenderOneFrame(task);
  if (!absl::IsNotFound(status)) return status;
  // The frame itself is there, or nobody would have asked; its focus may be taken from another.
  return absl::FailedPreconditionError(
      "a frame that the focus is taken from, or followed through, is not finished yet");
}

// The videos of all renders, and what the report says of them.
absl::StatusOr<json> AssembleRenders(const Task& task, const Input& input, const ClipPlan& clip) {
  const std::string& dir = task.arguments.out;
  const ClipSource source(*input.recording, clip.clock, input.options.key_every);
  json reports = json::array();
  for (size_t i = 0; i < input.renders.size(); ++i) {
    const RenderOptions& options = input.renders[i];
    ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, source.sequence(), RenderPath(i)));
    std::vector<RenderPart> parts;
    for (const Interval& interval : clip.intervals) {
      ASSIGN_OR_RETURN(const std::string text, ReadFile(JoinPath(dir, RenderReportName(options.name, interval.index))));
      ASSIGN_OR_RETURN(parts.emplace_back(), ParseRenderPart(text));
    }
    task.progress.Send({{"stage", "assemble " + options.name}, {"interval", 0}});
    RETURN_IF_ERROR(AssembleVideos(dir, options, plan, source.sequence(), task.stop));
    ASSIGN_OR_RETURN(const auto renderer, Renderer::Create(options, {&source, dir, clip.constants}, RenderPath(i)));
    json report = renderer->Report(parts);
    double seconds = 0;
    for (const RenderPart& part : parts) seconds += part.seconds;
    report.update({{"name", options.name}, {"seconds", seconds}, {"videos", plan.videos}});
    reports.push_back(std::move(report));
  }
  return reports;
}

absl::Status AssembleTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  if (input.scene_flow) return AssemblePairs(task, input);
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  std::vector<IntervalReport> reports;
  for (const Interval& interval : plan.intervals) {
    const std::string path = JoinPath(arguments.out, IntervalReportName(interval.index));
    if (!FileExists(path)) continue;  // AssembleResult names what is missing
    ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
    ASSIGN_OR_RETURN(reports.emplace_back(), ParseIntervalReport(text));
  }
  json self_check;
  if (!arguments.self_check.empty()) {
    ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.self_check));
    self_check = json::parse(text, /*cb=*/nullptr, /*allow_exceptions=*/false);
    if (!self_check.is_object())
      return absl::DataLossError(absl::StrCat(arguments.self_check, " is not what the task self-check wrote"));
  }
  ASSIGN_OR_RETURN(json renders, AssembleRenders(task, input, plan));
  const ClipSource source(*input.recording, plan.clock, input.options.key_every);
  ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(arguments.out, source.sequence()));
  // Where a server keeps the recording is nobody's business, and of no use to whoever fetches the result.
  return AssembleResult(input.options, /*sequence_dir=*/"", source.sequence(), plan, reports, std::move(renders),
                        std::move(self_check), writer,
                        {.stop = task.stop, .on_scene_flow = [&](int done, int total) {
                           task.progress.Send({{"stage", absl::StrFormat("scene flow, frame %d of %d", done, total)}});
                         }});
}

// Runs a task as a child should: it dies with its parent, stops when told or when nobody reads its progress, and
// reports failure where its parent looks.
int RunTask(const TaskArguments& arguments, const std::function<absl::Status(const Task&)>& run) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::signal(SIGPIPE, SIG_IGN);
  StopOnSignals signals;
  ProgressPipe progress(arguments.progress_fd, [&] { signals.RequestStop(); });
  absl::Status status;
  try {
    status = run({arguments, signals.token(), progress});
  } catch (const std::bad_alloc&) {
    status = absl::ResourceExhaustedError("the task ran out of memory");
  } catch (const std::exception& error) {
    status = absl::InternalError(absl::StrCat("unexpected failure: ", error.what()));
  }
  if (status.ok()) return kExitOk;
  if (!progress.connected()) return ReportStatus(status);
  progress.SendError(status);
  return kExitFailed;
}

}  // namespace

void AddTaskCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<TaskArguments>();
  CLI::App* const command = app.add_subcommand("task", "One step of an upsampling, as a server runs it");
  command->footer(
      "`upsample` does prepare, intervals and assemble in one process, and gives the same bits.\n"
      "\n"
      "Example:  depthtween-core task validate --sequence recording\n");
  command->require_subcommand(1);

  const auto add = [&](const char* name, const char* what, absl::Status (*run)(const Task&)) {
    CLI::App* const step = command->add_subcommand(name, what);
    step->add_option("--sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("DIR");
    step->add_option("--progress-fd", arguments->progress_fd, "Open file descriptor for progress, JSON lines")
        ->check(CLI::NonNegativeNumber)
        ->type_name("FD");
    step->callback([=] { *exit_code = RunTask(*arguments, run); });
    return step;
  };
  const auto add_threads = [&](CLI::App* step) {
    step->add_option("--threads", arguments->threads, "Threads to use; the result does not depend on it")
        ->capture_default_str()
        ->check(CLI::Range(1, kMaxThreads))
        ->type_name("N");
  };
  const auto add_options = [&](CLI::App* step) {
    step->add_option("--options", arguments->options,
                     "JSON file: {\"upsample\": {...}, \"renders\": [...]}, or {\"scene_flow\": {...}}")
        ->required()
        ->type_name("FILE");
    step->add_flag("--keep-motion", arguments->keep_motion, "Keep the motion between frames too, for renders");
    add_threads(step);
  };
  const auto add_constants = [&](CLI::App* step, const char* what) {
    step->add_option("--constants", arguments->constants, what)->required()->type_name("FILE");
  };
  const auto add_out = [&](CLI::App* step) {
    step->add_option("--out", arguments->out, "Result folder")->required()->type_name("DIR");
  };

  CLI::App* const validate =
      add("validate", "Decode every frame and print what is wrong, as JSON (exit code 0)", ValidateTask);
  add_threads(validate);

  CLI::App* const prepare = add("prepare", "Decide what is decided once per clip", PrepareTask);
  add_options(prepare);
  add_constants(prepare, "File to write: constants, intervals, frames");

  CLI::App* const self_check =
      add("self-check", "Measure on held-out depth frames how good the upsampling will be", SelfCheckTask);
  add_options(self_check);
  self_check->add_option("--out", arguments->out, "JSON file to write")->required()->type_name("FILE");

  CLI::App* const intervals = add("intervals", "Compute some intervals", IntervalsTask);
  add_options(intervals);
  add_constants(intervals, "File that prepare wrote");
  intervals->add_option("--first", arguments->first, "First interval")->required()->type_name("I");
  intervals->add_option("--count", arguments->count, "How many intervals")->required()->type_name("N");
  add_out(intervals);

  CLI::App* const plan =
      add("plan", "Check an order against the recording, and say what its renders need and leave", PlanTask);
  add_options(plan);
  plan->add_option("--out", arguments->out, "JSON file to write")->required()->type_name("FILE");

  const auto add_result = [&](CLI::App* step) {
    step->add_option("--result", arguments->result, "Result folder with finished frames")->required()->type_name("DIR");
  };
  CLI::App* const render = add("render", "Render some intervals", RenderTask);
  add_options(render);
  add_constants(render, "File that prepare wrote");
  add_result(render);
  render->add_option("--render", arguments->render, "Name of the render")->required()->type_name("NAME");
  render->add_option("--first", arguments->first, "First interval")->required()->type_name("I");
  render->add_option("--count", arguments->count, "How many intervals")->required()->type_name("N");
  add_out(render);

  CLI::App* const render_frame = add("render-frame", "Render one frame, by `render` of the options", RenderFrameTask);
  add_options(render_frame);
  add_constants(render_frame, "File that prepare wrote");
  add_result(render_frame);
  render_frame->add_option("--frame", arguments->frame, "Which")->required()->type_name("N");
  render_frame->add_option("--out", arguments->out, "Picture to write")->required()->type_name("FILE");

  CLI::App* const assemble = add("assemble", "End a result whose intervals are all there", AssembleTask);
  add_options(assemble);
  add_constants(assemble, "File that prepare wrote");
  add_out(assemble);
  assemble->add_option("--self-check", arguments->self_check, "File that self-check wrote, for the report")
      ->type_name("FILE");
}

}  // namespace depthtween::tools
