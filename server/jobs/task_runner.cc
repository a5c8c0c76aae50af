#include "server/jobs/task_runner.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "core/sequence/part_reports.h"
#include "nlohmann/json.hpp"
#include "server/jobs/child_process.h"
#include "server/jobs/unpacking.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/store/records_json.h"

namespace depthtween::server {
namespace {

constexpr int64_t kMaxAnswerBytes = 256 << 20;  // a validation of 200,000 frames prints about 30 MB
constexpr size_t kMaxViolations = 1000;         // what fits into one message, with room

// Whether the same work may end better when it is tried again: after a crash, or when the machine was at fault; not
// when the input is, or when a limit was hit that will be hit again.
bool WorthRetrying(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kUnknown:
    case absl::StatusCode::kInternal:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kCancelled:
    case absl::StatusCode::kDeadlineExceeded:
      return true;
    default:
      return false;
  }
}

// What a task leaves beside the frames of an interval, for `assemble`.
std::string PartReport(const Task& task, const JobRecord& job, int interval) {
  return "/" + (task.kind == TaskKind::kRender ? RenderReportName(job.renders[task.render].name, interval)
                                               : IntervalReportName(interval));
}

constexpr char kMotionFolder[] = "/motion/";
constexpr char kOutName[] = "out";  // of the result folder in the job's
constexpr char kConstantsName[] = "constants.json";

bool NeedsMotion(const JobRecord& job) {
  return job.facts.keep_motion || std::any_of(job.renders.begin(), job.renders.end(),
                                              [](const RenderRecord& render) { return render.uses_motion; });
}

// One that takes depth over keeps what the other kept, for pictures that are asked for later.
bool KeepsMotion(const JobRecord& job) { return NeedsMotion(job) || !job.depth_from.empty(); }

// What went wrong with a child that did not end well, in its own words if it had any. `stage` is what it said last of
// its work; empty if it has said nothing.
absl::Status ChildError(const Task& task, const ChildOutcome& outcome, const JobManagerOptions& limits,
                        const std::optional<absl::Status>& said, const std::string& stage) {
  const std::string what = absl::StrCat("task ", std::string(ToString(task.kind)));
  const std::string at = stage.empty() ? "" : absl::StrCat("; it was at: ", stage);
  if (outcome.stalled) {
    return absl::DeadlineExceededError(
        absl::StrFormat("%s: no progress for %d s, which is the limit, so it was ended%s", what,
                        static_cast<int64_t>(std::ceil(absl::ToDoubleSeconds(limits.task_stall))), at));
  }
  if (said) return WithContext(*said, what);
  if (outcome.signal == SIGXCPU) {
    return absl::ResourceExhaustedError(absl::StrFormat("%s: it has used the %d s of processor time that a task may%s",
                                                        what, limits.task_cpu_seconds, at));
  }
  const absl::string_view output = absl::StripAsciiWhitespace(outcome.error_output);
  return absl::InternalError(absl::StrCat(
      what, ": ", outcome.Describe(), outcome.signal == SIGKILL ? "; the system does this when memory runs out" : "",
      output.empty() ? "" : absl::StrCat("; its last output: ", output), at));
}

// Removes what a child that was killed left half-written in a result: core renames such files when they are whole.
void RemoveUnfinished(const std::string& out) {
  namespace fs = std::filesystem;
  std::error_code error, ignored;
  for (fs::recursive_directory_iterator entry(out, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() == ".tmp") fs::remove(entry->path(), ignored);
  }
}

void LimitViolations(ValidationResult& result) {
  if (result.violations.size() <= kMaxViolations) return;
  result.warnings.push_back(absl::StrFormat("%d further files have violations that are not listed",
                                            result.violations.size() - kMaxViolations));
  result.violations.resize(kMaxViolations);
}

}  // namespace

std::string TaskRunner::ConstantsFile(const std::string& job_id) const {
  return absl::StrCat(directory_.JobFolder(job_id), "/", kConstantsName);
}

absl::StatusOr<std::vector<FileChecksum>> TaskRunner::MoveInterval(const Task& task, const JobRecord& job,
                                                                   const PlannedInterval& interval) {
  ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames,
                   store_.JobFrames(Tenant::Everyone(), task.job_id, interval.first_frame, interval.frame_count));
  const std::string from = directory_.TaskFolder(task.number);
  const std::string to = directory_.OutFolder(task.job_id);
  const bool rendered = task.kind == TaskKind::kRender;
  std::vector<FileChecksum> files;
  const auto move = [&](const std::string& name) -> absl::Status {
    ASSIGN_OR_RETURN(FileChecksum checksum, ChecksumOf(from + name, kOutName + name));
    RETURN_IF_ERROR(MoveFile(from + name, to + name));
    files.push_back(std::move(checksum));
    return absl::OkStatus();
  };
  // Motion goes before depth, so that a frame with depth is complete. Not every frame has motion.
  if (!rendered && KeepsMotion(job)) {
    for (const FrameRecord& frame : frames) {
      const std::string name = kMotionFolder + frame.stem + ".npz";
      if (absl::Status moved = move(name); !moved.ok() && !absl::IsNotFound(moved)) return moved;
    }
    RETURN_IF_ERROR(SyncFolder(to + kMotionFolder));
  }
  for (const OutputSpec& output : OutputsOf(job)) {
    if (!output.frames || output.assembled || output.render != (rendered ? task.render : -1)) continue;
    const std::string folder = "/" + output.file_name + "/";
    for (const FrameRecord& frame : frames) {
      RETURN_IF_ERROR(move(absl::StrCat(folder, frame.stem, ".", output.extension)));
    }
    RETURN_IF_ERROR(SyncFolder(to + folder));
  }
  RETURN_IF_ERROR(move(PartReport(task, job, interval.index)));
  RETURN_IF_ERROR(SyncFolder(to));
  return files;
}

absl::Status TaskRunner::MakeResultFolders(const JobRecord& job) {
  const std::string out = directory_.OutFolder(job.id);
  for (const OutputSpec& output : OutputsOf(job)) {
    if (!output.frames) continue;
    const std::string folder = out + "/" + output.file_name;
    RETURN_IF_ERROR(MakeFolder(folder));
    RETURN_IF_ERROR(SyncFolder(folder.substr(0, folder.rfind('/'))));  // which may be a folder of several
  }
  if (KeepsMotion(job)) RETURN_IF_ERROR(MakeFolder(out + kMotionFolder));
  for (const std::string& changed : {out, directory_.JobFolder(job.id), directory_.JobsFolder()}) {
    RETURN_IF_ERROR(SyncFolder(changed));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::optional<std::vector<int>>> TaskRunner::FramesAssembled(const JobRecord& job) {
  const std::vector<OutputSpec> outputs = OutputsOf(job);
  const auto output = std::find_if(outputs.begin(), outputs.end(), [](const OutputSpec& o) { return o.assembled; });
  if (output == outputs.end()) return std::nullopt;
  ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames,
                   store_.JobFrames(Tenant::Everyone(), job.id, 0, job.frames_total));
  std::vector<int> found;
  for (const FrameRecord& frame : frames) {
    const std::string file =
        absl::StrCat(directory_.OutFolder(job.id), "/", output->file_name, "/", frame.stem, ".", output->extension);
    if (access(file.c_str(), F_OK) == 0) found.push_back(frame.index);
  }
  return found;
}

absl::StatusOr<std::vector<FileChecksum>> TaskRunner::FilesAssembled(const JobRecord& job,
                                                                     const std::vector<int>& frames) {
  std::vector<FileChecksum> files;
  std::vector<std::string> stems;
  if (!frames.empty()) {
    ASSIGN_OR_RETURN(const std::vector<FrameRecord> all,
                     store_.JobFrames(Tenant::Everyone(), job.id, 0, job.frames_total));
    for (const int frame : frames) stems.push_back(all.at(static_cast<size_t>(frame)).stem);
  }
  const auto add = [&](const std::string& name) -> absl::Status {
    absl::StatusOr<FileChecksum> checksum =
        ChecksumOf(absl::StrCat(directory_.OutFolder(job.id), "/", name), absl::StrCat(kOutName, "/", name));
    // Not every clip has a preview.
    if (absl::IsNotFound(checksum.status())) return absl::OkStatus();
    RETURN_IF_ERROR(checksum.status());
    files.push_back(*std::move(checksum));
    return absl::OkStatus();
  };
  for (const OutputSpec& output : OutputsOf(job)) {
    if (!output.frames) RETURN_IF_ERROR(add(output.file_name));
    if (!output.assembled) continue;
    for (const std::string& stem : stems) {
      RETURN_IF_ERROR(add(absl::StrCat(output.file_name, "/", stem, ".", output.extension)));
    }
  }
  return files;
}

absl::StatusOr<JobPlan> TaskRunner::TakeOverDepth(const JobRecord& job) {
  const std::string from = directory_.OutFolder(job.depth_from), to = directory_.OutFolder(job.id);
  const absl::StatusOr<std::string> constants = ReadWholeFile(ConstantsFile(job.depth_from), kMaxAnswerBytes);
  if (absl::IsNotFound(constants.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat("jobs/", job.depth_from, ", whose depth was to be taken over, has been deleted"));
  }
  RETURN_IF_ERROR(constants.status());
  ASSIGN_OR_RETURN(JobPlan plan, ParsePlan(*constants));
  plan.depth_done = true;
  const std::string other = "jobs/" + job.depth_from;
  // They keep the checksums of the job that made them: what has rotted since must not pass for right.
  std::map<std::string, FileChecksum> known;
  ASSIGN_OR_RETURN(std::vector<FileChecksum> files, store_.JobFiles(job.depth_from));
  for (FileChecksum& file : files) known.emplace(file.path, std::move(file));
  const auto keep = [&](const std::string& path) {
    if (auto found = known.extract(path)) plan.files.push_back(std::move(found.mapped()));
  };
  // Results never change, so a second name for them is as good as a copy. Whether it is there.
  const auto link = [&](const std::string& name) -> absl::StatusOr<bool> {
    const absl::Status linked = LinkFile(from + name, to + name);
    if (!linked.ok() && !absl::IsNotFound(linked)) return linked;
    if (linked.ok()) keep(kOutName + name);
    return linked.ok();
  };
  const bool needs_motion = NeedsMotion(job);
  for (const PlannedInterval& interval : plan.intervals) {
    int motion_frames = 0, without_motion = -1;
    for (int i = interval.first_frame; i < interval.first_frame + interval.frame_count; ++i) {
      const std::string& stem = plan.frames[static_cast<size_t>(i)].stem;
      for (const OutputSpec& output : OutputsOf({})) {
        if (!output.frames) continue;
        ASSIGN_OR_RETURN(const bool there, link(absl::StrCat("/", output.file_name, "/", stem, ".png")));
        if (!there) return FileLost(absl::StrCat(other, "/outputs/", output.id), i);
      }
      ASSIGN_OR_RETURN(const bool moves, link(kMotionFolder + stem + ".npz"));
      moves ? ++motion_frames : without_motion = i;
    }
    const std::string report = PartReport({.kind = TaskKind::kIntervals}, job, interval.index);
    ASSIGN_OR_RETURN(const bool there, link(report));
    if (!there) return FileOfJobLost(other, "report", interval.first_frame);
    // Not every frame has motion; how many do was counted.
    ASSIGN_OR_RETURN(const std::string counted, ReadWholeFile(to + report, kMaxAnswerBytes));
    ASSIGN_OR_RETURN(const int moving, ParseMotionFrames(counted));
    if (needs_motion && motion_frames < moving) {
      return FileOfJobLost(other, "motion", without_motion);
    }
  }
  RETURN_IF_ERROR(LinkFile(ConstantsFile(job.depth_from), ConstantsFile(job.id)));
  keep(kConstantsName);
  for (const OutputSpec& output : OutputsOf({})) {
    if (output.frames) RETURN_IF_ERROR(SyncFolder(to + "/" + output.file_name));
  }
  if (KeepsMotion(job)) RETURN_IF_ERROR(SyncFolder(to + kMotionFolder));
  RETURN_IF_ERROR(SyncFolder(to));
  RETURN_IF_ERROR(SyncFolder(directory_.JobFolder(job.id)));
  return plan;
}

absl::StatusOr<TaskPaths> TaskRunner::WriteOrder(const Task& task, const JobRecord& job) {
  const std::string folder = directory_.TaskFolder(task.number);
  RETURN_IF_ERROR(MakeFolder(folder));
  TaskPaths paths = {.program = options_.core_program,
                     .sequence = directory_.SequenceFolder(task.sequence_id),
                     .options = folder + "/options.json",
                     .constants = ConstantsFile(task.job_id),
                     .max_pixels = options_.max_sequence_pixels};
  if (task.kind == TaskKind::kValidate) return paths;
  // A job that was made when more were allowed gets what is allowed now.
  paths.threads = job.threads > 0 ? std::min(job.threads, options_.max_threads) : options_.default_threads;
  paths.keep_motion = NeedsMotion(job);
  RETURN_IF_ERROR(WriteScratchFile(paths.options, OrderJson(job.kind, job.options, job.renders)));
  switch (task.kind) {
    case TaskKind::kValidate:
      break;
    case TaskKind::kPrepare:
      paths.constants = folder + "/constants.json";
      break;
    case TaskKind::kIntervals:
      paths.out = folder;
      break;
    case TaskKind::kRender:
      paths.out = folder;
      paths.result = directory_.OutFolder(task.job_id);
      break;
    case TaskKind::kSelfCheck:
      paths.out = folder + "/self_check.json";
      break;
    case TaskKind::kAssemble:
      paths.out = directory_.OutFolder(task.job_id);
      RemoveUnfinished(paths.out);
      if (!job.self_check) break;
      paths.self_check = folder + "/self_check.json";
      RETURN_IF_ERROR(WriteScratchFile(paths.self_check, ToJson(*job.self_check).dump()));
      break;
  }
  return paths;
}

absl::Status TaskRunner::TakeAnswer(const Task& task, const JobRecord& job, const TaskPaths& paths,
                                    TaskOutcome& outcome) {
  switch (task.kind) {
    case TaskKind::kValidate: {
      ASSIGN_OR_RETURN(const std::string answer,
                       ReadWholeFile(directory_.TaskFolder(task.number) + "/stdout", kMaxAnswerBytes));
      ASSIGN_OR_RETURN(ValidationResult result, ParseValidation(answer));
      LimitViolations(result);
      for (FileViolation& violation : result.violations) violation.status = directory_.WithoutPath(violation.status);
      outcome.validation = std::move(result);
      break;
    }
    case TaskKind::kSelfCheck: {
      ASSIGN_OR_RETURN(const std::string answer, ReadWholeFile(paths.out, kMaxAnswerBytes));
      ASSIGN_OR_RETURN(outcome.self_check, ReadSelfCheck(answer));
      break;
    }
    case TaskKind::kPrepare: {
      ASSIGN_OR_RETURN(const std::string answer, ReadWholeFile(paths.constants, kMaxAnswerBytes));
      ASSIGN_OR_RETURN(JobPlan plan, ParsePlan(answer));
      BlockChecksums checksums;
      checksums.Update(answer);
      plan.files.push_back(checksums.Finish(kConstantsName));
      // Durable before the plan is recorded.
      RETURN_IF_ERROR(MoveFile(paths.constants, ConstantsFile(task.job_id)));
      RETURN_IF_ERROR(SyncFolder(directory_.JobFolder(task.job_id)));
      outcome.plan = std::move(plan);
      break;
    }
    case TaskKind::kIntervals:
    case TaskKind::kRender:
      break;  // what they made was taken interval by interval
    case TaskKind::kAssemble:
      RETURN_IF_ERROR(SyncFolder(paths.out));
      ASSIGN_OR_RETURN(outcome.assembled, FramesAssembled(job));
      ASSIGN_OR_RETURN(outcome.files, FilesAssembled(job, outcome.assembled.value_or(std::vector<int>())));
      break;
  }
  return absl::OkStatus();
}

absl::Status TaskRunner::UnpackArchive(const Task& task, const std::stop_token& stop, TaskOutcome& outcome) {
  ASSIGN_OR_RETURN(std::optional<SequenceArchive> archive, store_.GetArchive(task.sequence_id));
  if (!archive) return absl::OkStatus();
  const std::string sequence = directory_.SequenceFolder(task.sequence_id);
  RETURN_IF_ERROR(CleanSequence(sequence, *archive));
  if (archive->unpacked) return absl::OkStatus();

  const std::string folder = directory_.TaskFolder(task.number);
  RETURN_IF_ERROR(MakeFolder(folder));
  const TaskPaths paths = {.program = options_.core_program, .sequence = sequence, .out = folder + "/unpacked"};
  // The archive stays until its files are recorded, so both must have room.
  ASSIGN_OR_RETURN(const int64_t free_bytes, directory_.FreeBytes());
  const int64_t room_bytes = std::max<int64_t>(0, free_bytes - options_.min_free_bytes);
  const Limits limits = store_.limits().Get();
  const int64_t max_bytes = std::min(limits.max_sequence_bytes, room_bytes);
  std::optional<absl::Status> said;
  const absl::StatusOr<ChildOutcome> child =
      RunChild({.arguments = UnpackCommand(paths, archive->path, limits.max_files_per_sequence, max_bytes),
                .folder = folder,
                .memory_bytes = options_.child_memory_bytes,
                .file_bytes = options_.child_file_bytes,
                .cpu_seconds = options_.task_cpu_seconds,
                .grace = options_.grace,
                .stall_limit = options_.task_stall},
               stop, [&said](std::string_view text) {
                 const ProgressLine line = ParseProgressLine(text);
                 if (line.error) said = line.error;
                 return true;
               });
  if (!child.ok()) return WithContext(child.status(), "start of depthtween-core");
  outcome.stopped = child->stopped && (!child->stalled || stop.stop_requested());
  if (outcome.stopped) return absl::CancelledError("the task was stopped");
  if (child->stalled || child->exit_code != 0) return ChildError(task, *child, options_, said, "unpacking");
  ASSIGN_OR_RETURN(const std::string answer, ReadWholeFile(folder + "/stdout", kMaxAnswerBytes));
  ASSIGN_OR_RETURN(std::vector<FileViolation> violations, ParseUnpacking(answer));
  if (violations.empty()) {
    absl::StatusOr<UnpackedFiles> unpacked =
        ListUnpacked(paths.out, *archive, limits.max_files_per_sequence, max_bytes, stop);
    outcome.stopped = absl::IsCancelled(unpacked.status());
    RETURN_IF_ERROR(unpacked.status());
    violations = std::move(unpacked->violations);
    if (violations.empty()) {
      if (absl::Status moved = MoveUnpacked(paths.out, sequence); !moved.ok()) {
        CleanSequence(sequence, *archive).IgnoreError();  // the next attempt does it again
        return moved;
      }
      const absl::Status recorded = store_.FinishUnpacking(task.number, *archive, unpacked->files);
      const std::optional<ErrorInfo> info = GetErrorInfo(recorded);
      if (info && info->reason == "LIMIT_EXCEEDED") {
        violations.push_back({.file = archive->path, .status = recorded});
      } else {
        RETURN_IF_ERROR(recorded);
        archive->unpacked = true;
      }
      RETURN_IF_ERROR(CleanSequence(sequence, *archive));
    }
  }
  if (violations.empty()) return absl::OkStatus();
  if (max_bytes == room_bytes && absl::IsResourceExhausted(violations.front().status)) {
    return DiskFull(absl::StrCat(archive->path, " ", violations.front().status.message(),
                                 ", because there is no more room on the server's disk"));
  }
  outcome.validation = ValidationResult{.violations = std::move(violations)};
  LimitViolations(*outcome.validation);
  return absl::OkStatus();
}

absl::Status TaskRunner::Attempt(const Task& task, const JobRecord& job, const std::stop_token& stop,
                                 const TaskEvents& events, TaskOutcome& outcome) {
  if (absl::Status inputs = inputs_.OfTask(task, job, stop); !inputs.ok()) {
    outcome.stopped = absl::IsCancelled(inputs);
    return inputs;
  }
  if (task.kind == TaskKind::kPrepare) {
    RETURN_IF_ERROR(MakeResultFolders(job));
    if (!job.depth_from.empty()) {
      ASSIGN_OR_RETURN(outcome.plan, TakeOverDepth(job));
      return absl::OkStatus();
    }
  }
  if (task.kind == TaskKind::kValidate) {
    RETURN_IF_ERROR(UnpackArchive(task, stop, outcome));
    if (outcome.validation) return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const TaskPaths paths, WriteOrder(task, job));
  std::vector<PlannedInterval> intervals;
  if (task.kind == TaskKind::kIntervals || task.kind == TaskKind::kRender) {
    ASSIGN_OR_RETURN(intervals, store_.JobIntervals(task.job_id, task.first_interval, task.interval_count));
  }

  std::set<int> finished;
  std::optional<absl::Status> said;  // by the child: why it fails
  std::string stage;                 // that it said last
  absl::Status ours;
  const auto finish = [&](const ProgressLine::IntervalDone& done) -> absl::Status {
    const int position = done.interval - task.first_interval;
    if (position < 0 || position >= static_cast<int>(intervals.size())) {
      return absl::InternalError(
          absl::StrFormat("depthtween-core finished interval %d, which it was not given", done.interval));
    }
    const PlannedInterval& interval = intervals[static_cast<size_t>(position)];
    if (!finished.insert(interval.index).second) return absl::OkStatus();
    ASSIGN_OR_RETURN(const std::vector<FileChecksum> files, MoveInterval(task, job, interval));
    return events.on_interval(interval, done.seconds, files);
  };
  const auto on_line = [&](std::string_view text) {
    const ProgressLine line = ParseProgressLine(text);
    if (line.stage) events.on_stage(stage = *line.stage);
    if (line.checked) {
      stage = absl::StrFormat("%d of %d files checked", line.checked->checked, line.checked->of);
      events.on_checked(line.checked->checked, line.checked->of);
    }
    if (line.error) said = line.error;
    if (line.lost) said = LostStatus(*line.lost, task.job_id, task.sequence_id);
    if (line.interval_done && ours.ok()) ours = finish(*line.interval_done);
    return ours.ok();
  };

  const std::string render = task.kind == TaskKind::kRender ? job.renders[task.render].name : std::string();
  const absl::StatusOr<ChildOutcome> child = RunChild({.arguments = TaskCommand(task, paths, render),
                                                       .host = host_,
                                                       .folder = directory_.TaskFolder(task.number),
                                                       .memory_bytes = options_.child_memory_bytes,
                                                       .file_bytes = options_.child_file_bytes,
                                                       .cpu_seconds = options_.task_cpu_seconds,
                                                       .grace = options_.grace,
                                                       .stall_limit = options_.task_stall},
                                                      stop, on_line);
  if (!child.ok()) return WithContext(child.status(), "start of depthtween-core");
  RETURN_IF_ERROR(ours);
  // One that stalled and was cancelled while it was being ended was cancelled.
  outcome.stopped = child->stopped && (!child->stalled || stop.stop_requested());
  if (outcome.stopped) return absl::CancelledError("the task was stopped");
  if (child->stalled || child->exit_code != 0) return ChildError(task, *child, options_, said, stage);
  if (finished.size() != intervals.size()) {
    return absl::InternalError(
        absl::StrFormat("depthtween-core ended well with %d of %d intervals done", finished.size(), intervals.size()));
  }
  return TakeAnswer(task, job, paths, outcome);
}

TaskOutcome TaskRunner::Run(const Task& task, const JobRecord& job, const std::stop_token& stop,
                            const TaskEvents& events) {
  TaskOutcome outcome;
  // An error on our side of the work, such as a full disk, is judged as one of the child's.
  outcome.error = Attempt(task, job, stop, events, outcome);
  if (!outcome.error.ok() && task.kind == TaskKind::kAssemble) RemoveUnfinished(directory_.OutFolder(task.job_id));
  outcome.retry = !outcome.error.ok() && !outcome.stopped && WorthRetrying(outcome.error.code());
  return outcome;
}

}  // namespace depthtween::server
