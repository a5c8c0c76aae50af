#include <filesystem>
#include <iostream>
#include <limits>
#include <memory>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"
#include "client/cli/lost_files.h"
#include "client/cli/order.h"
#include "client/cli/progress_line.h"
#include "client/cli/render_places.h"
#include "client/lib/fetch.h"
#include "client/lib/files.h"
#include "client/lib/jobs.h"

namespace depthtween::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kFooter[] =
    "A new job on the server renders the depth of JOB, which must be finished, without computing it again. The same\n"
    "command finds that job again. With --frame the server renders one picture at once; JOB may still be running.\n"
    "The preset and the stages left out are those of JOB. For another preset, submit again with --preset.\n"
    "OUT is a video (.mp4: H.264, .mkv: FFV1, lossless) or a folder for images; with --frame an image (.png, .jpg).\n"
    "Stereo videos get the name ending that players recognise, such as _LRF_Full_SBS.\n"
    "\n"
    "Example:  depthtween render jobs/ID --dof --fstop 1.4 --focus-track 0,320,240 -o blurred.mp4\n"
    "Example:  depthtween render jobs/ID --dof --focus-depth 2 --frame 17 -o try.jpg\n";

struct RenderCommand {
  CommonOptions common;
  RenderFlags flags;
  std::string job, output;
  int frame = -1;
  bool force = false;
};

// "mp4" or "mkv" of a video, else nothing.
std::string ContainerOf(const std::string& output) {
  if (absl::EndsWithIgnoreCase(output, ".mp4")) return "mp4";
  return absl::EndsWithIgnoreCase(output, ".mkv") ? "mkv" : "";
}

bool IsVideo(const std::string& output) { return !ContainerOf(output).empty(); }

absl::Status CheckFree(const std::string& path, bool force) {
  std::error_code error;
  if (force || !fs::exists(path, error) || (fs::is_directory(path, error) && fs::is_empty(path, error))) {
    return absl::OkStatus();
  }
  return absl::AlreadyExistsError(absl::StrCat(path, " exists: name another, or use --force to replace it"));
}

absl::Status RenderOneFrame(client::Connection& connection, const RenderCommand& command, const std::string& job,
                            const v1::RenderOptions& render) {
  v1::RenderFrameRequest request;
  request.set_job(job);
  request.set_frame(command.frame);
  *request.mutable_render() = render;
  const bool jpeg =
      absl::EndsWithIgnoreCase(command.output, ".jpg") || absl::EndsWithIgnoreCase(command.output, ".jpeg");
  if (!jpeg && !absl::EndsWithIgnoreCase(command.output, ".png")) {
    return absl::InvalidArgumentError(absl::StrCat("-o ", command.output, ": must end in .png or .jpg with --frame"));
  }
  request.set_encoding(jpeg ? v1::ENCODING_JPEG : v1::ENCODING_PNG);
  RETURN_IF_ERROR(CheckFree(command.output, command.force));
  ASSIGN_OR_RETURN(const client::Frame frame, client::RenderFrame(connection, request));
  return client::WriteFile(command.output, frame.bytes);
}

// Fetches the pictures or videos of a rendering job, except what the server has `lost`. Returns the files written.
absl::StatusOr<std::vector<std::string>> FetchRender(client::Connection& connection, const RenderCommand& command,
                                                     const v1::Job& job, std::vector<client::LostOutput>& lost) {
  if (job.renders_size() != 1) return absl::DataLossError(absl::StrCat(job.name(), " came back without its render"));
  ASSIGN_OR_RETURN(const v1::ListOutputsResponse outputs, client::ListOutputs(connection, job.name()));
  const std::string& name = job.renders(0).name();
  const std::string prefix = absl::StrCat(job.name(), "/outputs/", name);
  std::vector<std::string> written;
  for (const v1::Output& output : outputs.outputs()) {
    if (!absl::StartsWith(output.name(), prefix)) continue;
    if (IsVideo(command.output)) {
      if (output.kind() != v1::Output::KIND_FILE) continue;
      ASSIGN_OR_RETURN(written.emplace_back(), VideoPlace(command.output, name, output));
      RETURN_IF_ERROR(CheckFree(written.back(), command.force));
      RETURN_IF_ERROR(client::FetchFile(connection, output.name(), written.back()).status());
      continue;
    }
    if (output.kind() != v1::Output::KIND_FRAMES) continue;
    ASSIGN_OR_RETURN(const std::string folder, PictureFolder(command.output, name, output));
    RETURN_IF_ERROR(CheckFree(folder, command.force));
    RETURN_IF_ERROR(client::MakeFolder(folder));
    written.push_back(folder);
    ProgressLine line("fetch");
    v1::StreamFramesRequest request;
    request.set_name(output.name());
    client::LostOutput missing = {.output = output.name(), .place = folder};
    const auto keep = [&](const client::Frame& frame) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string file, client::FrameFileName(frame.header));
      line.Show(static_cast<double>(frame.index + 1) / std::max(1, output.frame_count()),
                absl::StrCat(frame.index + 1, " of ", output.frame_count(), " images"));
      return client::WriteFile(absl::StrCat(folder, "/", file), frame.bytes);
    };
    const auto leave_out = [&](int frame) {
      missing.frames.push_back(frame);
      return absl::OkStatus();
    };
    RETURN_IF_ERROR(client::StreamFrames(connection, request, keep, leave_out));
    if (!missing.frames.empty()) lost.push_back(std::move(missing));
  }
  return written;
}

int Render(const RenderCommand& command) {
  const absl::StatusOr<std::string> name = JobName(command.job);
  if (!name.ok()) return Report(name.status());
  const auto renders = RenderMessagesOf(command.flags, command.frame >= 0 ? "" : ContainerOf(command.output));
  if (!renders.ok()) return Report(renders.status());
  if (renders->size() != 1) return Report(absl::InvalidArgumentError("say what to render: one of --dof and --stereo"));
  const auto connection = Connect(command.common);
  if (!connection.ok()) return Report(connection.status());
  if (command.frame >= 0) return Report(RenderOneFrame(**connection, command, *name, renders->front()));

  if (const absl::Status free = CheckFree(command.output, command.force); !free.ok()) return Report(free);
  absl::StatusOr<v1::Job> job = client::GetJob(**connection, *name);
  if (!job.ok()) return Report(job.status());
  v1::Job order;
  order.set_display_name(job->display_name());
  order.set_sequence(job->sequence());
  *order.mutable_options() = job->options();
  order.set_threads(job->threads());
  order.mutable_options()->clear_scene_flow();  // pictures do not need it
  *order.add_renders() = renders->front();
  order.set_depth_from(*name);
  job = client::SubmitJob(**connection, order);
  if (!job.ok()) return Report(job.status());
  job = WatchWithProgressLine(**connection, job->name());
  if (!job.ok()) return Report(job.status());
  if (const int outcome = ReportOutcome(*job); outcome != kExitOk) return outcome;
  std::vector<client::LostOutput> lost;
  const absl::StatusOr<std::vector<std::string>> written = FetchRender(**connection, command, *job, lost);
  if (!written.ok()) return Report(written.status());
  if (command.common.json) {
    PrintJson({{"job", ToJson(*job)}, {"files", *written}, {"lost", LostToJson(lost)}});
  } else {
    for (const std::string& file : *written) std::cout << file << std::endl;
  }
  if (lost.empty()) return kExitOk;
  std::cerr << "depthtween: " << DescribeLost(job->name(), lost, command.output) << std::endl;
  return kExitFailed;
}

}  // namespace

void AddRenderCommand(CLI::App& app, int* exit_code) {
  const auto command = std::make_shared<RenderCommand>();
  CLI::App* const subcommand =
      app.add_subcommand("render", "Make pictures of a job's depth: depth of field, or a second eye");
  subcommand->footer(kFooter);
  subcommand->add_option("job", command->job, "jobs/ID, as submit and list print it")->type_name("JOB")->required();
  subcommand->add_option("-o,--out", command->output, "Video, folder or image to write")->required()->type_name("OUT");
  subcommand->add_option("--frame", command->frame, "Render only this frame, now")
      ->check(CLI::Range(0, std::numeric_limits<int>::max()))
      ->type_name("N");
  subcommand->add_flag("--force", command->force, "Replace what is at OUT");
  AddRenderFlags(*subcommand, command->flags);
  AddCommonOptions(*subcommand, command->common);
  subcommand->callback([command, exit_code] { *exit_code = Render(*command); });
}

}  // namespace depthtween::cli
