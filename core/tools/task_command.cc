// `depthtween-core task`: the steps of an upsampling as processes of their own. A server runs them as children, so that
// a crash in a decoder on a hostile file, a memory limit or a cancelled job ends the child alone.
#include <sys/prctl.h>

#include <csignal>
#include <exception>
#include <functional>
#include <iostream>
#include <memory>
#include <new>
#include <string>

#include "absl/strings/str_format.h"
#include "core/io/camera_json.h"
#include "core/io/file.h"
#include "core/io/sequence_folder.h"
#include "core/tools/commands.h"
#include "core/tools/progress_pipe.h"
#include "core/tools/signals.h"
#include "core/tools/upsample_run.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;

struct TaskArguments {
  std::string sequence, options, constants, out;
  int first = 0, count = 0, threads = 1, progress_fd = -1;
};

struct Task {
  const TaskArguments& arguments;
  std::stop_token stop;
  ProgressPipe& progress;
};

std::string Dump(const json& value) { return value.dump(2, ' ', false, json::error_handler_t::replace) + "\n"; }

std::string IntervalReportPath(const std::string& dir, int interval) {
  return JoinPath(dir, absl::StrFormat("interval_%06d.json", interval));
}

// What every task but `validate` begins with.
struct Input {
  UpsampleOptions options;
  std::unique_ptr<SequenceFolder> folder;
  std::unique_ptr<EveryNthDepth> source;
};

absl::StatusOr<Input> OpenInput(const TaskArguments& arguments) {
  Input input;
  ASSIGN_OR_RETURN(const std::string options, ReadFile(arguments.options));
  ASSIGN_OR_RETURN(input.options, ParseUpsampleOptions(options));
  ASSIGN_OR_RETURN(input.folder, SequenceFolder::Open(arguments.sequence));
  input.source = std::make_unique<EveryNthDepth>(*input.folder, input.options.key_every);
  return input;
}

absl::StatusOr<ClipPlan> ReadClipPlan(const TaskArguments& arguments, const Input& input) {
  ASSIGN_OR_RETURN(const std::string constants, ReadFile(arguments.constants));
  return ParseClipPlan(constants, input.source->sequence());
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
                     {"width", sequence.camera.width},
                     {"height", sequence.camera.height},
                     {"depth_scale", sequence.depth_scale},
                     {"camera", CameraToJson(sequence.camera, sequence.depth_scale)},
                     {"color", FramesToJson(sequence.color)},
                     {"depth", FramesToJson(sequence.depth)},
                     {"median_depth_m", check.median_depth_m}})
            << std::flush;
  return std::cout ? absl::OkStatus() : absl::InternalError("cannot write the answer to stdout");
}

absl::Status PrepareTask(const Task& task) {
  ASSIGN_OR_RETURN(const Input input, OpenInput(task.arguments));
  ASSIGN_OR_RETURN(const ClipPlan plan, PrepareClip(*input.source));
  return WriteFileDurably(task.arguments.constants, Dump(ToJson(plan, input.source->sequence())));
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
    RETURN_IF_ERROR(WriteFileDurably(IntervalReportPath(task_.arguments.out, report.index), Dump(ToJson(report))));
    task_.progress.Send(
        {{"interval_done", report.index}, {"seconds", report.seconds}, {"frames", report.summary.frames}});
    return absl::OkStatus();
  }

 private:
  const Task& task_;
};

absl::Status IntervalsTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(input.options));
  ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(arguments.out, input.source->sequence()));
  TaskObserver observer(task);
  return RunIntervals(*upsampler, *input.source, plan, arguments.first, arguments.count, input.options.threads,
                      task.stop, writer, observer)
      .status();
}

absl::Status AssembleTask(const Task& task) {
  const TaskArguments& arguments = task.arguments;
  ASSIGN_OR_RETURN(const Input input, OpenInput(arguments));
  ASSIGN_OR_RETURN(const ClipPlan plan, ReadClipPlan(arguments, input));
  std::vector<IntervalReport> reports;
  for (const Interval& interval : plan.intervals) {
    const std::string path = IntervalReportPath(arguments.out, interval.index);
    if (!FileExists(path)) continue;  // AssembleResult names what is missing
    ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
    ASSIGN_OR_RETURN(reports.emplace_back(), ParseIntervalReport(text));
  }
  ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(arguments.out, input.source->sequence()));
  return AssembleResult(input.options, arguments.sequence, input.source->sequence(), plan, reports, writer);
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
  const auto add_options = [&](CLI::App* step) {
    step->add_option("--options", arguments->options, "JSON file: method, key_every, threads")
        ->required()
        ->type_name("FILE");
  };
  const auto add_constants = [&](CLI::App* step, const char* what) {
    step->add_option("--constants", arguments->constants, what)->required()->type_name("FILE");
  };
  const auto add_out = [&](CLI::App* step) {
    step->add_option("--out", arguments->out, "Result folder")->required()->type_name("DIR");
  };

  CLI::App* const validate =
      add("validate", "Decode every frame and print what is wrong, as JSON (exit code 0)", ValidateTask);
  validate->add_option("--threads", arguments->threads, "Threads to use")
      ->capture_default_str()
      ->check(CLI::Range(1, kMaxThreads))
      ->type_name("N");

  CLI::App* const prepare = add("prepare", "Decide what is decided once per clip", PrepareTask);
  add_options(prepare);
  add_constants(prepare, "File to write: constants, intervals, frames");

  CLI::App* const intervals = add("intervals", "Compute some intervals", IntervalsTask);
  add_options(intervals);
  add_constants(intervals, "File that prepare wrote");
  intervals->add_option("--first", arguments->first, "First interval")->required()->type_name("I");
  intervals->add_option("--count", arguments->count, "How many intervals")->required()->type_name("N");
  add_out(intervals);

  CLI::App* const assemble = add("assemble", "End a result whose intervals are all there", AssembleTask);
  add_options(assemble);
  add_constants(assemble, "File that prepare wrote");
  add_out(assemble);
}

}  // namespace depthtween::tools
