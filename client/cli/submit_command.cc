#include <chrono>
#include <iostream>
#include <map>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "client/cli/clock_flag.h"
#include "client/cli/commands.h"
#include "client/cli/common.h"
#include "client/cli/exit_codes.h"
#include "client/cli/job_progress.h"
#include "client/cli/progress_line.h"
#include "client/cli/render_flags.h"
#include "client/lib/fetch.h"
#include "client/lib/jobs.h"
#include "client/lib/local_sequence.h"
#include "client/lib/upload.h"

namespace depthtween::cli {
namespace {

using Method = v1::UpsampleOptions::Method;

// As `depthtween-core upsample` names them.
const std::map<std::string, Method> kMethods = {
    {"ours", v1::UpsampleOptions::METHOD_OURS},          {"hold", v1::UpsampleOptions::METHOD_HOLD},
    {"nearest", v1::UpsampleOptions::METHOD_NEAREST},    {"linear", v1::UpsampleOptions::METHOD_LINEAR},
    {"dolson", v1::UpsampleOptions::METHOD_DOLSON},      {"dolson-mode", v1::UpsampleOptions::METHOD_DOLSON_MODE},
    {"flow-warp", v1::UpsampleOptions::METHOD_FLOW_WARP}};
const std::map<std::string, v1::UpsampleOptions::Preset> kPresets = {{"fast", v1::UpsampleOptions::PRESET_FAST},
                                                                     {"balanced", v1::UpsampleOptions::PRESET_BALANCED},
                                                                     {"best", v1::UpsampleOptions::PRESET_BEST}};

constexpr int kMaxThreads = 1024;  // that a server takes: UpsampleOptions.threads

struct SubmitOptions {
  CommonOptions common;
  std::string sequence;
  std::string output;
  bool force = false;
  bool wait = false;
  std::string method = "ours";
  int key_every = 1;
  int threads = 0;
  std::string preset = "balanced";
  std::vector<std::string> without;
  bool self_check = false;
  bool causal = false;
  bool scene_flow = false;
  std::string clock = "stamps";
  RenderFlags renders;
  v1::RenderOptions::Container container = v1::RenderOptions::CONTAINER_UNSPECIFIED;
};

double Share(int64_t done, int64_t total) {
  return total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 1.0;
}

absl::Status HashWithProgress(client::LocalSequence& sequence) {
  ProgressLine line("read");
  const std::string total = FormatBytes(sequence.size_bytes);
  return client::HashFiles(sequence, [&](int64_t bytes_done) {
    line.Show(Share(bytes_done, sequence.size_bytes), absl::StrCat(FormatBytes(bytes_done), " of ", total));
  });
}

absl::StatusOr<v1::Sequence> UploadWithProgress(client::Connection& connection, const client::LocalSequence& sequence,
                                                client::UploadProgress& progress) {
  ProgressLine line("upload");
  const auto start = std::chrono::steady_clock::now();
  return client::UploadSequence(connection, sequence, [&](const client::UploadProgress& now) {
    progress = now;
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    const int64_t sent = now.bytes_done - now.bytes_found;
    std::string facts = absl::StrCat(FormatBytes(now.bytes_done), " of ", FormatBytes(now.bytes_total));
    if (now.bytes_found > 0) absl::StrAppend(&facts, ", ", FormatBytes(now.bytes_found), " were there");
    // A rate over less than this is noise.
    if (sent > 0 && seconds > 0.5) {
      absl::StrAppend(&facts, ", ", FormatBytes(static_cast<int64_t>(static_cast<double>(sent) / seconds)), "/s");
    }
    line.Show(Share(now.bytes_done, now.bytes_total), facts);
  });
}

absl::StatusOr<v1::Sequence> ValidateWithProgress(client::Connection& connection, const std::string& name) {
  ProgressLine line("check");
  return client::AwaitValidation(connection, name, [&](const v1::Sequence& sequence) {
    if (sequence.frames_to_check() == 0) return;
    line.Show(Share(sequence.checked_frames(), sequence.frames_to_check()),
              absl::StrCat(sequence.checked_frames(), " of ", sequence.frames_to_check(), " frames"));
  });
}

// Prints what the server found. Returns the exit code of a recording that is not READY.
int ReportRejected(const v1::Sequence& sequence) {
  for (const v1::FileViolation& violation : sequence.violations()) {
    std::cerr << "depthtween: " << violation.file() << ": " << violation.status().message() << "\n";
  }
  if (sequence.violations_size() > 0) {
    std::cerr << "depthtween: the server rejects this recording; mend the files above and submit it again" << std::endl;
    return kExitInputRejected;
  }
  std::cerr << "depthtween: the server could not check this recording: " << sequence.error().message()
            << ". When that is mended, 'depthtween delete " << sequence.name() << "' and submit it again" << std::endl;
  return kExitFailed;
}

// A failure before the server had the whole recording. One that speaks of the files is a rejection.
int ReportInput(const absl::Status& status) {
  const int code = Report(status);
  const bool rejected = absl::IsInvalidArgument(status) || absl::IsNotFound(status) || absl::IsDataLoss(status);
  return rejected ? kExitInputRejected : code;
}

// What a submit has to tell: filled as it gets on, printed once, whatever came of it.
struct SubmitResult {
  std::optional<v1::Sequence> sequence;
  client::UploadProgress upload;
  std::optional<v1::Job> job;
  std::optional<client::FetchSummary> fetch;
};

void PrintResult(const SubmitOptions& options, const SubmitResult& result, int exit_code) {
  if (!options.common.json) {
    if (result.job.has_value()) std::cout << result.job->name() << std::endl;
    return;
  }
  nlohmann::json json = {{"exitCode", exit_code}};
  if (result.sequence.has_value()) {
    json["sequence"] = ToJson(*result.sequence);
    json["upload"] = {{"totalBytes", result.upload.bytes_total}, {"foundBytes", result.upload.bytes_found}};
  }
  if (result.job.has_value()) json["job"] = ToJson(*result.job);
  if (result.fetch.has_value()) {
    json["output"] = {{"directory", options.output}, {"complete", result.fetch->complete}};
  }
  PrintJson(json);
}

int Submit(const SubmitOptions& options, SubmitResult& result) {
  const auto renders = RendersOf(options.renders, options.container);
  if (!renders.ok()) return Report(renders.status());
  absl::StatusOr<client::LocalSequence> local = client::FindSequence(options.sequence);
  if (!local.ok()) return ReportInput(local.status());
  if (!options.output.empty()) {
    if (const absl::Status usable = client::CheckFolder(options.output, options.force); !usable.ok()) {
      return Report(usable);
    }
  }
  const auto connection = Connect(options.common);
  if (!connection.ok()) return Report(connection.status());
  if (const absl::Status hashed = HashWithProgress(*local); !hashed.ok()) return ReportInput(hashed);

  absl::StatusOr<v1::Sequence> sequence = UploadWithProgress(**connection, *local, result.upload);
  if (!sequence.ok()) return ReportInput(sequence.status());
  sequence = ValidateWithProgress(**connection, sequence->name());
  if (!sequence.ok()) return Report(sequence.status());
  result.sequence = *sequence;
  if (sequence->state() != v1::Sequence::STATE_READY) return ReportRejected(*sequence);
  for (const std::string& warning : sequence->warnings()) std::cerr << "depthtween: warning: " << warning << std::endl;

  v1::Job order;
  order.set_display_name(local->display_name);
  order.set_sequence(sequence->name());
  order.mutable_options()->set_method(kMethods.at(options.method));
  order.mutable_options()->set_key_every(options.key_every);
  order.mutable_options()->set_threads(options.threads);
  order.mutable_options()->set_preset(kPresets.at(options.preset));
  order.mutable_options()->mutable_without()->Assign(options.without.begin(), options.without.end());
  order.mutable_options()->set_self_check(options.self_check);
  order.mutable_options()->set_causal(options.causal);
  order.mutable_options()->set_scene_flow(options.scene_flow);
  order.mutable_options()->set_clock(options.clock);
  for (const v1::RenderOptions& render : *renders) *order.add_renders() = render;
  absl::StatusOr<v1::Job> job = client::SubmitJob(**connection, order);
  if (!job.ok()) return Report(job.status());
  result.job = *job;
  if (!options.wait && options.output.empty()) return kExitOk;

  job = WatchWithProgressLine(**connection, job->name());
  if (!job.ok()) return Report(job.status());
  result.job = *job;
  if (const int outcome = ReportOutcome(*job); outcome != kExitOk || options.output.empty()) return outcome;

  const auto fetched = FetchWithProgressLine(**connection, job->name(), options.output, {.replace = options.force});
  if (!fetched.ok()) return Report(fetched.status());
  result.fetch = *fetched;
  return kExitOk;
}

}  // namespace

void AddSubmitCommand(CLI::App& app, int* exit_code) {
  const auto options = std::make_shared<SubmitOptions>();
  CLI::App* command = app.add_subcommand(
      "submit", "Upload a recording and queue a job on it. The same command again goes on where it stopped");
  command->add_option("sequence", options->sequence, "Sequence folder: rgb.txt, depth.txt, camera.json and frames")
      ->required()
      ->type_name("SEQ");
  command->add_option("-o,--out", options->output, "Fetch the result into this folder; implies --wait")
      ->type_name("OUT");
  command->add_flag("--force", options->force, "Replace an earlier result in OUT");
  command->add_flag("--wait", options->wait, "Return when the job has ended, with its outcome as exit code");
  std::vector<std::string> methods;
  for (const auto& [name, method] : kMethods) methods.push_back(name);
  command->add_option("--method", options->method, "How: ours, hold, nearest, linear, dolson, dolson-mode, flow-warp")
      ->type_name("NAME")
      ->check(CLI::IsMember(methods))
      ->capture_default_str();
  command->add_option("--key-every", options->key_every, "Use only every N-th depth frame, for leave-out experiments")
      ->type_name("N")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  command->add_option("--threads", options->threads, "Threads of each worker; 0: the server decides. Same result")
      ->type_name("N")
      ->check(CLI::Range(0, kMaxThreads))
      ->capture_default_str();
  std::vector<std::string> presets;
  for (const auto& [name, preset] : kPresets) presets.push_back(name);
  command->add_option("--preset", options->preset, "What accuracy may cost, for method ours: fast, balanced, best")
      ->type_name("NAME")
      ->check(CLI::IsMember(presets))
      ->capture_default_str();
  command
      ->add_option("--without", options->without,
                   "Leave stages of method ours out, to learn what each is worth: settle, draw, propagation, median, "
                   "witnesses, silhouettes; names with commas between them")
      ->delimiter(',')
      ->type_name("NAMES");
  command->add_flag(
      "--causal", options->causal,
      "Take each frame from what had been seen by then alone, for low latency: the last depth frames, and "
      "the colour frames up to it");
  command
      ->add_option("--clock", options->clock,
                   "How depth frames come onto the colour camera's clock: stamps (they are right), index (pair by "
                   "number), estimate (from the images), or OFFSET_MS[,DRIFT_PPM] that the depth clock is ahead and "
                   "gains, such as 4,300 (negative: --clock=-4)")
      ->type_name("CLOCK")
      ->check(ClockProblem)
      ->capture_default_str();
  command->add_flag(
      "--scene-flow", options->scene_flow,
      "Also the 3-D motion of every frame to the next, metres: sceneflow/*.npz, but for frames before the "
      "first and after the last depth frame");
  command->add_flag("--self-check", options->self_check,
                    "First hold out every second depth frame and report how far ours, flow-warp, linear and hold are "
                    "from it on this recording; costs at most what 24 intervals cost");
  AddRenderFlags(*command, options->renders);
  command
      ->add_option_function<std::string>(
          "--video",
          [options](const std::string& name) {
            options->container = name == "mp4" ? v1::RenderOptions::CONTAINER_MP4 : v1::RenderOptions::CONTAINER_MKV;
          },
          "Put the pictures of --dof and --stereo together in the end: mp4 (H.264) or mkv (FFV1, lossless)")
      ->type_name("NAME")
      ->check(CLI::IsMember({"mp4", "mkv"}));
  command->footer(
      "With --dof or --stereo the job renders every frame too, as soon as the frames around it are finished; OUT gets\n"
      "their images in dof/ and stereo/.\n"
      "\n"
      "Example:  depthtween submit recording --dof --fstop 1.4 --focus-depth 2.5 --stereo --video mp4 -o result\n");
  AddCommonOptions(*command, options->common);
  command->callback([options, exit_code] {
    SubmitResult result;
    *exit_code = Submit(*options, result);
    PrintResult(*options, result, *exit_code);
  });
}

}  // namespace depthtween::cli
