// depthtween-benchmark: the tables by which the pipeline is judged.
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "core/base/parallel.h"
#include "core/baselines/baselines.h"
#include "core/io/file.h"
#include "core/tools/commands.h"
#include "core/tools/picture_size.h"
#include "core/tools/progress_bar.h"
#include "core/tools/signals.h"
#include "core/tools/tools.h"
#include "core/upsample/pipeline.h"
#include "tests/bench/benchmark.h"

namespace depthtween {
namespace {

using tools::CountLine;
using tools::kExitUsage;
using tools::ParsePictureSize;
using tools::ReportStatus;
using tools::StopOnSignals;

constexpr char kAll[] = "all", kNone[] = "none", kQuick[] = "quick";

struct BenchmarkArguments {
  BenchmarkOptions options;
  std::string out, size = "512x424";
  std::vector<std::string> baselines = {kQuick};
};

// The same command for whoever reads the report, without what does not change it.
std::string CommandLine(const BenchmarkArguments& arguments) {
  const BenchmarkOptions& options = arguments.options;
  const auto list = [](const std::vector<std::string>& names) {
    return names.empty() ? std::string(kNone) : absl::StrJoin(names, ",");
  };
  std::string line = "depthtween-benchmark";
  for (const std::string& sequence : options.sequences) absl::StrAppend(&line, " ", sequence);
  absl::StrAppend(&line, " -o ", arguments.out, " --tables ", list(options.tables), " --scenes ", list(options.scenes),
                  " --baselines ", list(options.baselines), " --preset ", options.preset, " --frames ", options.frames,
                  " --size ", arguments.size);
  return line;
}

absl::StatusOr<BenchmarkOptions> ReadOptions(const BenchmarkArguments& arguments) {
  BenchmarkOptions options = arguments.options;
  RETURN_IF_ERROR(ParsePictureSize(arguments.size, options.width, options.height));
  const auto is = [](const std::vector<std::string>& names, const char* word) {
    return names.size() == 1 && names[0] == word;
  };
  if (is(options.scenes, kNone)) options.scenes.clear();
  if (is(options.scenes, kAll)) options.scenes = BenchmarkScenes();
  if (is(options.tables, kAll)) options.tables = BenchmarkTables();
  options.baselines = is(arguments.baselines, kAll)     ? BaselineNames()
                      : is(arguments.baselines, kQuick) ? QuickBaselineNames()
                      : is(arguments.baselines, kNone)  ? std::vector<std::string>()
                                                        : arguments.baselines;
  RETURN_IF_ERROR(options.Validate());
  if (options.scenes.empty() && options.sequences.empty())
    return absl::InvalidArgumentError(
        "there is nothing to run on: name a sequence folder, or do not say --scenes none");
  return options;
}

absl::Status RunTables(const BenchmarkArguments& arguments, BenchmarkOptions options) {
  StopOnSignals signals;
  RETURN_IF_ERROR(MakeFolder(arguments.out));  // before hours of work, not after
  options.stop = signals.token();
  std::unique_ptr<CountLine> line;
  std::string shown;
  options.on_progress = [&](const std::string& what, int done, int total) {
    if (what != shown) {
      line.reset();  // clears what it showed
      const size_t colon = what.rfind(": ");
      line = std::make_unique<CountLine>(what.substr(0, colon), what.substr(colon + 2));
      shown = what;
    }
    line->Show(done, total);
  };
  BenchmarkArguments said = arguments;
  said.options = options;
  const std::string command = CommandLine(said);
  const auto result = RunBenchmark(options, [&](const Benchmark& so_far) {
    line.reset();
    shown.clear();
    std::cerr << "done: " << (so_far.clips.empty() ? "time" : so_far.clips.back().name) << std::endl;
    return WriteBenchmarkReport(so_far, command, arguments.out);
  });
  line.reset();
  if (absl::IsCancelled(result.status()))
    return absl::CancelledError(absl::StrCat("stopped; what was measured until then is in ", arguments.out));
  RETURN_IF_ERROR(result.status());
  std::cout << JoinPath(arguments.out, "report.md") << std::endl;
  return absl::OkStatus();
}

void AddBenchmark(CLI::App& command, int* exit_code) {
  auto arguments = std::make_shared<BenchmarkArguments>();
  BenchmarkOptions& options = arguments->options;
  options.threads = AvailableThreads();
  command.footer(
      "REPORT gets report.md, report.json and plots (SVG); they are renewed whenever a clip is done.\n"
      "\n"
      "Tables:\n"
      "  depth       ours beside the baselines, by region, with its predicted uncertainty\n"
      "  ablation    each part of the pipeline switched off, and all at once that look for better motion than the "
      "flow's\n"
      "  parameters  error over the range of each number of the pipeline\n"
      "  ratio       1 to 4 times as many colour frames per depth frame, by dropping depth frames\n"
      "  sceneflow   3-D motion between two RGB-D frames, ours beside re-implemented ideas of published methods; "
      "takes\n"
      "              folders with gt/sceneflow_key, or gt/depth and gt/flow, or without truth (depth transfer)\n"
      "  time        seconds for an interval by preset and stage, beside OpenCV's dense flows\n"
      "\n"
      "Example:  depthtween-benchmark -o report --tables depth --scenes kick\n"
      "Example:  depthtween-benchmark recording:8 -o report --scenes none    (truth: 7 of 8 depth frames)\n");
  command
      .add_option("sequence", options.sequences,
                  "Also these sequence folders. Truth is gt/depth or, without that, the depth maps that are left out: "
                  "FOLDER:N keeps every N-th")
      ->type_name("SEQ[:N]");
  command.add_option("-o,--out", arguments->out, "Folder to write the report to")->required()->type_name("REPORT");
  command
      .add_option("--tables", options.tables,
                  "Which tables, with commas between them: " + absl::StrJoin(BenchmarkTables(), ", ") + "; or all")
      ->delimiter(',')
      ->default_str(kAll)
      ->type_name("NAMES");
  command
      .add_option("--scenes", options.scenes,
                  "Which of the library's scenes: " + absl::StrJoin(BenchmarkScenes(), ", ") + "; all, or none")
      ->delimiter(',')
      ->default_str(kAll)
      ->type_name("NAMES");
  command
      .add_option("--baselines", arguments->baselines,
                  "Of the table depth: " + absl::StrJoin(BaselineNames(), ", ") +
                      "; quick ones, all (dolson and dolson-mode take seconds a frame, tracking an interval), or none "
                      "(then sceneflow too "
                      "has ours alone)")
      ->delimiter(',')
      ->default_str(kQuick)
      ->type_name("NAMES");
  command.add_option("--preset", options.preset, "Of ours; the table time takes all")
      ->check(CLI::IsMember(PresetNames()))
      ->capture_default_str()
      ->type_name(absl::StrJoin(PresetNames(), "|"));
  command.add_option("--frames", options.frames, "Colour frames of a scene; the table ratio takes 3 times as many")
      ->capture_default_str()
      ->type_name("N");
  command.add_option("--size", arguments->size, "Width and height of scenes in pixels")
      ->capture_default_str()
      ->type_name("WxH");
  command.add_option("--rounds", options.rounds, "Rounds of the table time, which shows medians")
      ->capture_default_str()
      ->type_name("N");
  command.add_option("--threads", options.threads, "Threads; errors do not depend on it")
      ->capture_default_str()
      ->type_name("N");
  command.callback([=] {
    const absl::StatusOr<BenchmarkOptions> read = ReadOptions(*arguments);
    if (!read.ok()) {
      ReportStatus(read.status());
      *exit_code = kExitUsage;
      return;
    }
    *exit_code = ReportStatus(RunTables(*arguments, *read));
  });
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  return depthtween::tools::RunProgram(argc, argv, "depthtween-benchmark",
                                       "Judges the method by tables and plots, on rendered scenes and recordings",
                                       [](CLI::App& app, int* exit_code) { depthtween::AddBenchmark(app, exit_code); });
}
