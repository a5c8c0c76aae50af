// `depthtween-core task`: the steps of an upsampling as processes of their own. A server runs them as children, so that
// a crash in a decoder on a hostile file, a memory limit or a cancelled job ends the child alone.
#include <sys/prctl.h>
#include <nlohmann/json.hpp>

#include <csignal>
#include <exception>
#include <filesystem>
#include <iostream>
#include <memory>
#include <new>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/io/file.h"
#include "core/sandbox/sandbox.h"
#include "core/session/tasks.h"
#include "core/tools/commands.h"
#include "core/tools/freed_memory.h"
#include "core/tools/progress_pipe.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

absl::Status Print(const absl::StatusOr<nlohmann::json>& answer) {
  RETURN_IF_ERROR(answer.status());
  std::cout << Dump(*answer) << std::flush;
  return std::cout ? absl::OkStatus() : absl::InternalError("cannot write the answer to stdout");
}

absl::Status PrintValidation(const Task& task) { return Print(ValidateTask(task)); }
absl::Status PrintUnpacking(const Task& task) { return Print(UnpackTask(task)); }

// What a task writes: its answer, as a file, or frames and reports in a folder.
enum class Writes { kNothing, kConstants, kFile, kFolder };

absl::Status ShutIn(const TaskArguments& arguments, Writes writes) {
  SandboxPaths paths{.read = {arguments.sequence, arguments.options}};
  for (const std::string& path : {arguments.result, arguments.self_check}) {
    if (!path.empty()) paths.read.push_back(path);
  }
  const auto folder_of = [](const std::string& file) {
    const std::string folder = std::filesystem::path(file).parent_path();
    return folder.empty() ? std::string(".") : folder;
  };
  if (writes == Writes::kConstants) {
    paths.write.push_back(folder_of(arguments.constants));
  } else if (!arguments.constants.empty()) {
    paths.read.push_back(arguments.constants);
  }
  if (writes == Writes::kFile) paths.write.push_back(folder_of(arguments.out));
  if (writes == Writes::kFolder) {
    RETURN_IF_ERROR(MakeFolder(arguments.out));
    paths.write.push_back(arguments.out);
  }
  return WithContext(EnterSandbox(paths), "shutting the task in");
}

// Runs a task as a child should: it shuts itself in, dies with its parent, stops when told or when nobody reads its
// progress, and reports failure where its parent looks.
int RunTask(const TaskArguments& arguments, int progress_fd, Writes writes, absl::Status (*run)(const Task&)) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::signal(SIGPIPE, SIG_IGN);
  const absl::Status shut_in = ShutIn(arguments, writes);  // before there is a second thread
  StopOnSignals signals;
  ProgressPipe progress(progress_fd, [&] { signals.RequestStop(); });
  absl::Status status;
  try {
    status = shut_in.ok() ? run({.arguments = arguments,
                                 .stop = signals.token(),
                                 .progress =
                                     [&](const nlohmann::json& line) {
                                       progress.Send(line);
                                       if (line.contains("interval_done")) ReturnFreedMemory();
                                     },
                                 .alive = [&] { progress.SendAlive(); }})
                          : shut_in;
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
  auto progress_fd = std::make_shared<int>(-1);
  CLI::App* const command = app.add_subcommand("task", "One step of an upsampling, as a server runs it");
  command->footer(
      "`upsample` does prepare, intervals and assemble in one process, and gives the same bits.\n"
      "\n"
      "Example:  depthtween-core task validate --sequence recording\n");
  command->require_subcommand(1);

  const auto add = [&](const char* name, const char* what, Writes writes, absl::Status (*run)(const Task&)) {
    CLI::App* const step = command->add_subcommand(name, what);
    step->add_option("--sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("DIR");
    step->add_option("--progress-fd", *progress_fd, "Open file descriptor for progress, JSON lines")
        ->check(CLI::NonNegativeNumber)
        ->type_name("FD");
    step->callback([=] { *exit_code = RunTask(*arguments, *progress_fd, writes, run); });
    return step;
  };
  const auto add_options = [&](CLI::App* step) {
    step->add_option("--options", arguments->options,
                     "JSON file: {\"upsample\": {...}, \"renders\": [...]}, or {\"scene_flow\": {...}}")
        ->required()
        ->type_name("FILE");
    step->add_flag("--keep-motion", arguments->keep_motion, "Keep the motion between frames too, for renders");
    AddThreads(*step, arguments->threads);
  };
  const auto add_constants = [&](CLI::App* step, const char* what) {
    step->add_option("--constants", arguments->constants, what)->required()->type_name("FILE");
  };
  const auto add_out = [&](CLI::App* step) {
    step->add_option("--out", arguments->out, "Result folder")->required()->type_name("DIR");
  };

  CLI::App* const validate = add("validate", "Decode every frame and print what is wrong, as JSON (exit code 0)",
                                 Writes::kNothing, PrintValidation);
  AddThreads(*validate, arguments->threads);
  validate->add_option("--max-pixels", arguments->max_pixels, "Most pixels of all frames together (default: no limit)")
      ->check(CLI::PositiveNumber)
      ->type_name("N");

  CLI::App* const unpack = add("unpack",
                               "Unpack a recording that came as a zip archive, and print what is wrong with it, "
                               "as JSON (exit code 0)",
                               Writes::kFolder, PrintUnpacking);
  unpack->add_option("--archive", arguments->archive, "Its name in the sequence folder")->required()->type_name("NAME");
  unpack->add_option("--out", arguments->out, "Folder to write to")->required()->type_name("DIR");
  unpack->add_option("--max-files", arguments->max_files, "Most files (default: no limit)")
      ->check(CLI::PositiveNumber)
      ->type_name("N");
  unpack->add_option("--max-bytes", arguments->max_bytes, "Most bytes of all files together (default: no limit)")
      ->check(CLI::NonNegativeNumber)
      ->type_name("N");

  CLI::App* const prepare = add("prepare", "Decide what is decided once per clip", Writes::kConstants, PrepareTask);
  add_options(prepare);
  add_constants(prepare, "File to write: constants, intervals, frames");

  CLI::App* const self_check = add("self-check", "Measure on held-out depth frames how good the upsampling will be",
                                   Writes::kFile, SelfCheckTask);
  add_options(self_check);
  self_check->add_option("--out", arguments->out, "JSON file to write")->required()->type_name("FILE");

  CLI::App* const intervals = add("intervals", "Compute some intervals", Writes::kFolder, IntervalsTask);
  add_options(intervals);
  add_constants(intervals, "File that prepare wrote");
  intervals->add_option("--first", arguments->first, "First interval")->required()->type_name("I");
  intervals->add_option("--count", arguments->count, "How many intervals")->required()->type_name("N");
  add_out(intervals);

  CLI::App* const plan = add("plan", "Check an order against the recording, and say what its renders need and leave",
                             Writes::kFile, PlanTask);
  add_options(plan);
  plan->add_option("--out", arguments->out, "JSON file to write")->required()->type_name("FILE");

  const auto add_result = [&](CLI::App* step) {
    step->add_option("--result", arguments->result, "Result folder with finished frames")->required()->type_name("DIR");
  };
  CLI::App* const render = add("render", "Render some intervals", Writes::kFolder, RenderTask);
  add_options(render);
  add_constants(render, "File that prepare wrote");
  add_result(render);
  render->add_option("--render", arguments->render, "Name of the render")->required()->type_name("NAME");
  render->add_option("--first", arguments->first, "First interval")->required()->type_name("I");
  render->add_option("--count", arguments->count, "How many intervals")->required()->type_name("N");
  add_out(render);

  CLI::App* const render_frame =
      add("render-frame", "Render one frame, by `render` of the options", Writes::kFile, RenderFrameTask);
  add_options(render_frame);
  add_constants(render_frame, "File that prepare wrote");
  add_result(render_frame);
  render_frame->add_option("--frame", arguments->frame, "Which")->required()->type_name("N");
  render_frame->add_option("--out", arguments->out, "Picture to write")->required()->type_name("FILE");

  CLI::App* const assemble =
      add("assemble", "End a result whose intervals are all there", Writes::kFolder, AssembleTask);
  add_options(assemble);
  add_constants(assemble, "File that prepare wrote");
  add_out(assemble);
  assemble->add_option("--self-check", arguments->self_check, "File that self-check wrote, for the report")
      ->type_name("FILE");
}

}  // namespace depthtween::tools
