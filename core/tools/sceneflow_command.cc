// depthtween-core sceneflow: metric 3-D motion of every pixel, from a recording with depth for every colour frame.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/base/parallel.h"
#include "core/io/file.h"
#include "core/io/png.h"
#include "core/io/sequence_folder.h"
#include "core/sceneflow/scene_flow.h"
#include "core/sequence/clock.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/scene_flow_files.h"
#include "core/tools/scene_flow_picture.h"
#include "core/tools/signals.h"
#include "core/tools/upsample_run.h"

namespace depthtween::tools {
namespace {

namespace fs = std::filesystem;

constexpr int kPicturedPairs = 3;
constexpr size_t kNamedFrames = 10;

struct SceneFlowArguments {
  std::string sequence, out;
  SceneFlowOptions options;
  std::vector<std::string> formats = {"npz"};
  double baseline_m = kDefaultBaselineM;
  int every = 1;
  bool json = false, force = false;
};

// The depth frame of each colour frame: the nearest in time, at most half a colour frame away.
absl::StatusOr<std::vector<int>> DepthOfColor(const Sequence& sequence) {
  const int64_t tolerance_ns = std::max<int64_t>(MedianPeriodNs(sequence.color) / 2, 1);
  std::vector<int> depth_of;
  std::vector<std::string> without;
  for (const FrameRef& color : sequence.color) {
    const auto nearest =
        std::min_element(sequence.depth.begin(), sequence.depth.end(), [&](const FrameRef& a, const FrameRef& b) {
          return std::llabs(a.time_ns - color.time_ns) < std::llabs(b.time_ns - color.time_ns);
        });
    depth_of.push_back(static_cast<int>(nearest - sequence.depth.begin()));
    if (std::llabs(nearest->time_ns - color.time_ns) > tolerance_ns) without.push_back(color.path);
  }
  if (without.empty()) return depth_of;
  const size_t lacking = without.size();
  without.resize(std::min(lacking, kNamedFrames));
  return absl::FailedPreconditionError(absl::StrFormat(
      "colour and depth are not at the same rate: %d of %d colour frames have no depth within half a frame (%.1f ms): "
      "%s%s. Upsample the recording instead, which gives scene flow too: depthtween-core "
      "upsample SEQ -o OUT --scene-flow",
      lacking, sequence.color.size(), 1e-6 * static_cast<double>(tolerance_ns), absl::StrJoin(without, ", "),
      lacking > kNamedFrames ? ", ..." : ""));
}

absl::Status ClearOutput(const SceneFlowArguments& arguments) {
  std::error_code error;
  const fs::path out = arguments.out;
  if (!fs::exists(out, error) || (fs::is_directory(out, error) && fs::is_empty(out, error))) return absl::OkStatus();
  if (!fs::is_directory(out, error)) return absl::InvalidArgumentError(absl::StrCat(arguments.out, " is not a folder"));
  if (FileExists(JoinPath(arguments.out, "rgb.txt")))
    return absl::InvalidArgumentError(absl::StrCat(
        arguments.out, " holds a recording (rgb.txt), which a result must not be mixed with: name another folder"));
  if (!arguments.force)
    return absl::AlreadyExistsError(absl::StrCat(
        arguments.out, " is not empty: name another folder, or use --force to replace an earlier result in it"));
  for (const char* part : {"report.json", "preview.png", "sceneflow", "flow", "depth_change", "kitti"}) {
    fs::remove_all(out / part, error);
    if (error) return ErrnoStatus(error.value(), "removing " + (out / part).string());
  }
  return absl::OkStatus();
}

// What is said of one pair of frames.
struct PairSummary {
  std::string from, to;
  double seconds = 0.0, median_m = 0.0, hidden_share = 0.0, answered_share = 0.0;
};

PairSummary Summarise(const SceneFlow& flow) {
  std::vector<float> lengths;
  int64_t hidden = 0;
  for (size_t i = 0; i < flow.confidence.pixel_count(); ++i) {
    if (!(flow.confidence.data()[i] > 0.0F)) continue;
    const Float3 m = flow.motion_m.data()[i];
    lengths.push_back(std::sqrt(m.x * m.x + m.y * m.y + m.z * m.z));
    hidden += flow.hidden.data()[i] != 0 ? 1 : 0;
  }
  PairSummary summary;
  if (lengths.empty()) return summary;
  const auto middle = lengths.begin() + static_cast<ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  summary.median_m = *middle;
  summary.hidden_share = static_cast<double>(hidden) / static_cast<double>(lengths.size());
  summary.answered_share = static_cast<double>(lengths.size()) / static_cast<double>(flow.confidence.pixel_count());
  return summary;
}

nlohmann::json ToJson(const SceneFlowArguments& arguments, const std::vector<PairSummary>& pairs) {
  nlohmann::json out = {{"method", arguments.options.method},
                        {"formats", arguments.formats},
                        {"kitti_baseline_m", arguments.baseline_m},
                        {"out", arguments.out},
                        {"pairs", nlohmann::json::array()}};
  for (const PairSummary& pair : pairs)
    out["pairs"].push_back({{"from", pair.from},
                            {"to", pair.to},
                            {"seconds", pair.seconds},
                            {"median_motion_m", pair.median_m},
                            {"hidden_share", pair.hidden_share},
                            {"answered_share", pair.answered_share}});
  return out;
}

// A column for the picture: colour, flow, depth change.
struct Pictured {
  Image<Rgb8> color;
  SceneFlow flow;
  Image<uint8_t> valid;
  MotionField View() const { return {flow.flow_px, flow.motion_m, valid}; }
};

// One scale for all columns.
Image<Rgb8> DrawPicture(const std::vector<Pictured>& columns) {
  MotionRange range;
  for (const Pictured& column : columns) {
    const MotionRange own = RangeOf(column.View());
    range = {std::max(range.full_px, own.full_px), std::max(range.full_m, own.full_m)};
  }
  std::vector<std::vector<Image<Rgb8>>> rows(3);
  for (const Pictured& column : columns) {
    rows[0].push_back(column.color.Clone());
    rows[1].push_back(ColorizeFlow(column.View(), range.full_px));
    rows[2].push_back(ColorizeDepthChange(column.View(), range.full_m));
  }
  return Tile(rows);
}

absl::Status RunSceneFlow(const SceneFlowArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(arguments.sequence));
  const Sequence& sequence = folder->sequence();
  ASSIGN_OR_RETURN(const std::vector<int> depth_of, DepthOfColor(sequence));
  std::vector<std::pair<int, int>> steps;
  for (int first = 0; first + arguments.every < static_cast<int>(sequence.color.size()); first += arguments.every)
    steps.emplace_back(first, first + arguments.every);
  if (steps.empty())
    return absl::FailedPreconditionError(
        absl::StrFormat("%s has %d colour frames, so nothing moves from one to the %d. after it", arguments.sequence,
                        sequence.color.size(), arguments.every));
  RETURN_IF_ERROR(ClearOutput(arguments));
  RETURN_IF_ERROR(MakeSceneFlowFolders(arguments.out, arguments.formats));
  SceneFlowOptions options = arguments.options;
  options.stop = signals.token();
  const int count = static_cast<int>(steps.size());
  std::vector<PairSummary> summaries;
  std::vector<Pictured> pictured;
  {
    CountLine counter("computed", "pairs of frames");
    for (int i = 0; i < count; ++i) {
      counter.Show(i, count);
      const auto [first, second] = steps[i];
      ASSIGN_OR_RETURN(Image<Rgb8> from, folder->Color(first));
      ASSIGN_OR_RETURN(const Image<Rgb8> to, folder->Color(second));
      ASSIGN_OR_RETURN(const Image<float> from_m, folder->Depth(depth_of[first]));
      ASSIGN_OR_RETURN(const Image<float> to_m, folder->Depth(depth_of[second]));
      const auto start = std::chrono::steady_clock::now();
      absl::StatusOr<SceneFlow> flow = EstimateSceneFlow(sequence.camera, {from, from_m}, {to, to_m}, options);
      if (!flow.ok())
        return WithContext(flow.status(),
                           absl::StrCat(sequence.color[first].path, " to ", sequence.color[second].path));
      PairSummary& summary = summaries.emplace_back(Summarise(*flow));
      summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      summary.from = sequence.color[first].path;
      summary.to = sequence.color[second].path;
      RETURN_IF_ERROR(WriteSceneFlow(arguments.out, sequence.color[first].Stem(), arguments.formats, sequence.camera,
                                     arguments.baseline_m, *flow));
      if (i * kPicturedPairs / count == static_cast<int>(pictured.size())) {
        Pictured column{std::move(from), *std::move(flow), {}};
        column.valid = Image<uint8_t>(column.color.width(), column.color.height());
        for (size_t p = 0; p < column.valid.pixel_count(); ++p)
          column.valid.data()[p] = column.flow.confidence.data()[p] > 0.0F ? 1 : 0;
        pictured.push_back(std::move(column));
      }
    }
  }
  const std::string picture = JoinPath(arguments.out, "preview.png");
  RETURN_IF_ERROR(WritePngRgb8(picture, DrawPicture(pictured)));
  const nlohmann::json report = ToJson(arguments, summaries);
  RETURN_IF_ERROR(WriteFile(JoinPath(arguments.out, "report.json"), report.dump(1) + "\n"));
  if (arguments.json) {
    std::cout << report.dump(2) << std::endl;
    return absl::OkStatus();
  }
  double seconds = 0.0;
  for (const PairSummary& summary : summaries) seconds += summary.seconds;
  std::cout << absl::StrFormat("%d pairs of frames in %.1f s (%.2f s each): %s, picture: %s\n", count, seconds,
                               seconds / count, arguments.out, picture);
  return absl::OkStatus();
}

}  // namespace

void AddSceneFlowCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<SceneFlowArguments>();
  arguments->options.threads = AvailableThreads();
  CLI::App* const command =
      app.add_subcommand("sceneflow", "Compute the 3-D motion of every pixel, from depth for every colour frame");
  command->footer(
      "From each colour frame to the next, with depth at the same rate. OUT gets report.json, preview.png (colour, "
      "motion\n"
      "across the picture by hue, motion in depth: red comes nearer) and, by format:\n"
      "  npz    sceneflow/STEM.npz: flow (u, v: pixels), motion (x right, y down, z forward: metres, in the camera's\n"
      "         frame), depth (metres), confidence (0 = no answer), hidden (in the next frame)\n"
      "  flo    flow/STEM.flo (Middlebury: pixels) and depth_change/STEM.pfm (metres, positive = away)\n"
      "  kitti  kitti/flow/STEM.png (16 bits: u = (R - 32768) / 64 pixels, v likewise, B = valid), kitti/disp_0 and\n"
      "         disp_1/STEM.png (16 bits: 256 times the disparity in pixels, fx * baseline / z, of the pixel now and "
      "of its\n"
      "         point in the next frame; 0 = unknown)\n"
      "\n"
      "pd-flow, sr-flow and layered-flow re-implement the ideas of Jaimez et al. 2015, Quiroga et al. 2014 and Sun et "
      "al.\n"
      "2015, for comparison; they are not their authors' code.\n"
      "\n"
      "Example:  depthtween-core sceneflow recording -o motion\n"
      "Example:  depthtween-core sceneflow recording -o motion --format flo,kitti --json\n");
  command->add_option("sequence", arguments->sequence, "Sequence folder to read")->required()->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Folder to write the result to")->required()->type_name("OUT");
  command->add_option("--method", arguments->options.method, "How: " + absl::StrJoin(SceneFlowMethods(), ", "))
      ->capture_default_str()
      ->check(CLI::IsMember(SceneFlowMethods()))
      ->type_name("NAME");
  command
      ->add_option("--format", arguments->formats,
                   "With commas between them: " + absl::StrJoin(SceneFlowFormats(), ", "))
      ->delimiter(',')
      ->capture_default_str()
      ->check(CLI::IsMember(SceneFlowFormats()))
      ->type_name("NAMES");
  command->add_option("--every", arguments->every, "From every N-th colour frame to the N-th after it")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000))
      ->type_name("N");
  command->add_option("--baseline", arguments->baseline_m, "Of the disparities of format kitti, metres")
      ->capture_default_str()
      ->check(CLI::Range(1e-4, 100.0))
      ->type_name("M");
  command->add_option("--threads", arguments->options.threads, "Threads to use; the result does not depend on it")
      ->capture_default_str()
      ->check(CLI::Range(1, kMaxThreads))
      ->type_name("N");
  command->add_flag("--json", arguments->json, "Print the report instead of a sentence");
  command->add_flag("--force", arguments->force, "Replace an earlier result in OUT");
  command->callback([=] { *exit_code = ReportStatus(RunSceneFlow(*arguments)); });
}

}  // namespace depthtween::tools
