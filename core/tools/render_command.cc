#include <unistd.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <iostream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "core/api/make_upsampler.h"
#include "core/base/parallel.h"
#include "core/flags/option_flags.h"
#include "core/flags/render_flags.h"
#include "core/io/file.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"
#include "core/session/finished_clip.h"
#include "core/session/render_run.h"
#include "core/session/upsample_run.h"
#include "core/session/write_queue.h"
#include "core/tools/commands.h"
#include "core/tools/progress_bar.h"
#include "core/tools/self_check_aloud.h"
#include "core/tools/signals.h"

namespace depthtween::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr char kFooter[] =
    "SEQ is a recording, which is upsampled first, or a folder that `upsample --keep-motion` wrote.\n"
    "OUT decides what is written: .mp4 (H.264, plays everywhere), .mkv (FFV1, loses nothing), or else a folder of\n"
    "images named as the colour frames. Videos of two eyes get the ending that players know them by, such as\n"
    "_LRF_Full_SBS.\n"
    "\n"
    "The lens is a virtual one in front of the colour camera. Its aperture is focal length / f-stop wide, and that\n"
    "alone is what it decides: the field of view stays the colour camera's. Without --focal-mm it is the focal length\n"
    "that has that field of view on the sensor named by --sensor. A smaller f-stop, a longer focal length, a larger\n"
    "sensor or a nearer focus give more blur.\n"
    "\n"
    "Example:  depthtween-core render recording --dof --fstop 1.4 --focus-depth 2.5 -o blurred.mp4\n"
    "Example:  depthtween-core render result --dof --focus-track 0,320,240 -o followed.mp4\n"
    "Example:  depthtween-core render result --dof --focus-keys 0:1.2,60:4 -o rack.mkv\n"
    "Example:  depthtween-core render result --stereo --format full-sbs -o pair.mp4\n"
    "Example:  depthtween-core render result --stereo --format anaglyph-dubois -o glasses\n";

struct RenderArguments {
  std::string input, out, sequence;
  RenderFlags flags;
  int threads = AvailableThreads();
  json upsample = json::object();  // of a recording
  std::vector<CLI::Option*> upsample_flags;
  bool force = false;
};

// "mp4" or "mkv" of a video, or nothing of a folder.
std::string ContainerOf(const std::string& out) {
  if (absl::EndsWithIgnoreCase(out, ".mp4")) return "mp4";
  return absl::EndsWithIgnoreCase(out, ".mkv") ? "mkv" : "";
}

// A result made for one render, gone with it.
class TemporaryResult {
 public:
  TemporaryResult() = default;
  TemporaryResult(const TemporaryResult&) = delete;
  TemporaryResult& operator=(const TemporaryResult&) = delete;
  ~TemporaryResult() {
    std::error_code error;
    if (!dir_.empty()) fs::remove_all(dir_, error);
  }

  // Upsamples the recording into a folder beside `out`.
  absl::Status Make(const std::string& recording, const std::string& out, UpsampleOptions options,
                    const std::stop_token& stop) {
    dir_ = absl::StrCat(fs::path(out).lexically_normal().string(), ".", getpid(), ".depth");
    options.keep_motion = true;
    ASSIGN_OR_RETURN(const std::unique_ptr<Upsampler> upsampler, MakeUpsampler(options));
    ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> source, SequenceFolder::Open(recording));
    ASSIGN_OR_RETURN(const ResultWriter writer, ResultWriter::Create(dir_, source->sequence(), true));
    ASSIGN_OR_RETURN(const ClipPlan plan, PrepareClip(*source, options, stop));
    ASSIGN_OR_RETURN(json self_check, CheckSelfAloud(*source, options, stop));
    ProgressBar progress(plan);
    ASSIGN_OR_RETURN(const std::vector<IntervalReport> reports,
                     RunIntervals(*upsampler, *source, plan, 0, static_cast<int>(plan.intervals.size()), options, stop,
                                  writer, progress));
    return AssembleResult(options, recording, source->sequence(), plan, reports, json::array(), std::move(self_check),
                          writer);
  }
  const std::string& dir() const { return dir_; }

 private:
  std::string dir_;
};

// "out" of "out.mp4", and of "out_LRF_Full_SBS.mp4" where that ending comes anyway.
std::string VideoStem(const RenderOptions& options, const std::string& out, size_t stream) {
  const std::string ending = VideoFileName(options, "", stream, *options.container);
  if (absl::EndsWith(out, ending)) return out.substr(0, out.size() - ending.size());
  return out.substr(0, out.size() - std::string(".mp4").size());
}

// What will be there in the end: the videos, or the folder.
std::vector<std::string> FilesOf(const RenderArguments& arguments, const RenderOptions& options,
                                 const RenderPlan& plan) {
  if (!options.container) return {arguments.out};
  std::vector<std::string> files;
  for (size_t i = 0; i < plan.streams.size(); ++i)
    files.push_back(VideoFileName(options, VideoStem(options, arguments.out, i), i, *options.container));
  return files;
}

absl::Status CheckOutput(const std::vector<std::string>& files, bool force) {
  for (const std::string& file : files) {
    std::error_code error;
    const bool folder = fs::is_directory(file, error);
    if (!force && fs::exists(file, error) && !(folder && fs::is_empty(file, error)))
      return absl::AlreadyExistsError(
          absl::StrCat(file, " is there already: name another, or use --force to replace it"));
  }
  return absl::OkStatus();
}

absl::Status Render(const RenderArguments& arguments) {
  StopOnSignals signals;
  ASSIGN_OR_RETURN(const std::vector<json> renders, RendersOf(arguments.flags, ContainerOf(arguments.out)));
  if (renders.size() != 1) return absl::InvalidArgumentError("say what to render: one of --dof and --stereo");
  ASSIGN_OR_RETURN(const RenderOptions options, ParseRender(renders[0], "options"));
  ASSIGN_OR_RETURN(UpsampleOptions upsample, ParseUpsampleOptions(arguments.upsample));
  upsample.threads = arguments.threads;

  // Everything that can be wrong is found before anything is computed.
  TemporaryResult temporary;
  std::string result = arguments.input, sequence = arguments.sequence;
  if (FileExists(JoinPath(arguments.input, "rgb.txt")) && !FileExists(JoinPath(arguments.input, "report.json"))) {
    sequence = arguments.input;
    ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(sequence));
    ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, folder->sequence(), "options"));
    RETURN_IF_ERROR(CheckOutput(FilesOf(arguments, options, plan), arguments.force));
    RETURN_IF_ERROR(temporary.Make(sequence, arguments.out, upsample, signals.token()));
    result = temporary.dir();
  } else {
    for (const CLI::Option* flag : arguments.upsample_flags)
      if (flag->count() > 0)
        return absl::InvalidArgumentError(
            absl::StrCat(flag->get_name(), " is about upsampling, and ", arguments.input, " is upsampled already"));
  }
  ASSIGN_OR_RETURN(const FinishedClip clip, OpenFinishedClip(result, sequence));
  ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, clip.input, "options"));
  ASSIGN_OR_RETURN(const auto renderer,
                   Renderer::Create(options, {clip.recording.get(), result, clip.constants}, "options"));

  const int frame_count = clip.frame_count();
  const std::vector<std::string> files = FilesOf(arguments, options, plan);
  RETURN_IF_ERROR(CheckOutput(files, arguments.force));
  std::optional<PictureVideos> videos;
  std::optional<PictureFolders> folders;
  if (options.container) {
    ASSIGN_OR_RETURN(videos, PictureVideos::Create(files, options, clip.input));
  } else {
    // One stream lies in OUT itself, those of two eyes in OUT/left and OUT/right.
    RenderPlan local = plan;
    local.streams =
        plan.streams.size() == 1 ? std::vector<std::string>{"."} : std::vector<std::string>{"left", "right"};
    ASSIGN_OR_RETURN(folders, PictureFolders::Create(arguments.out, options, local));
  }

  RenderPart part;
  {
    ClipPlan progress_plan;
    progress_plan.intervals = {{.index = 0, .frame_count = frame_count}};
    ProgressBar progress(progress_plan);
    progress.OnStage(0, arguments.flags.dof ? "depth of field" : "stereo");
    // Videos take their frames one after the other.
    WriteQueue queue(videos ? 1 : arguments.threads, [&](int frame) { progress.OnFrame(0, frame); });
    const auto sink = [&](int frame, std::vector<Image<Rgb8>> pictures) {
      return queue.Add(frame, [&, frame, pictures = std::move(pictures)] {
        return videos ? videos->Write(frame, pictures) : folders->Write(clip.input.color[frame].Stem(), pictures);
      });
    };
    ASSIGN_OR_RETURN(part, renderer->Run(0, frame_count, nullptr, arguments.threads, signals.token(), sink));
    RETURN_IF_ERROR(queue.Finish());
  }
  if (videos) RETURN_IF_ERROR(videos->Finish());

  std::cout << absl::StrFormat("%d frames in %.1f s (%.1f frames per second)", frame_count, part.seconds,
                               frame_count / part.seconds);
  if (videos)
    std::cout << absl::StrFormat(", shown at %.6g per second, %s", videos->clock().rate.PerSecond(), videos->encoder());
  for (const std::string& file : files) std::cout << "\n" << file;
  std::cout << "\n" << renderer->Report({part}).dump(1) << std::endl;
  return absl::OkStatus();
}

}  // namespace

void AddRenderCommand(CLI::App& app, int* exit_code) {
  auto arguments = std::make_shared<RenderArguments>();
  CLI::App* const command = app.add_subcommand("render", "Make pictures of depth: depth of field, or a second eye");
  command->footer(kFooter + ("\n" + PresetHelp()));
  command->add_option("input", arguments->input, "Recording, or folder that upsample wrote")
      ->required()
      ->type_name("SEQ");
  command->add_option("-o,--out", arguments->out, "Video (.mp4, .mkv) or folder to write")
      ->required()
      ->type_name("OUT");
  command
      ->add_option("--sequence", arguments->sequence,
                   "The recording, if it is no longer where upsample read it, or if a server did")
      ->type_name("SEQ");
  command->add_option("--threads", arguments->threads, "Threads to use; the result does not depend on it")
      ->capture_default_str()
      ->check(CLI::Range(1, kMaxThreads))
      ->type_name("N");
  command->add_flag("--force", arguments->force, "Replace what is at OUT");
  AddRenderFlags(*command, arguments->flags);
  arguments->upsample_flags = AddOptionFlags(*command, UpsampleOptionSpecs(), arguments->upsample,
                                             {"preset", "causal", "self_check", "clock", "without", "literal"});
  command->callback([=] { *exit_code = ReportStatus(Render(*arguments)); });
}

}  // namespace depthtween::tools
