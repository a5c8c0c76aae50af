#include "server/jobs/input_check.h"

#include <algorithm>
#include <optional>

#include "absl/strings/str_cat.h"
#include "core/sequence/part_reports.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr char kConstantsPath[] = "constants.json";

// What depth a frame has, and its motion.
void AddFrame(const std::string& stem, std::vector<std::string>& paths) {
  for (const char* output : {"depth", "uncertainty", "provenance"}) {
    paths.push_back(absl::StrCat("out/", output, "/", stem, ".png"));
  }
  paths.push_back(absl::StrCat("out/motion/", stem, ".npz"));
}

}  // namespace

absl::Status InputCheck::One(const std::string& resource, const FileChecksum& file, const std::stop_token& stop) {
  const std::string path = absl::StrCat(resource, "/", file.path);
  const absl::Status checked = CheckFile(absl::StrCat(directory_.path(), "/", path), file,
                                         [&stop](int64_t /*bytes*/) { return !stop.stop_requested(); });
  if (!absl::IsDataLoss(checked)) return absl::IsNotFound(checked) ? absl::OkStatus() : checked;
  damage_.Report(path, std::string(checked.message()));
  return FileDamaged(resource, path);
}

absl::Status InputCheck::Sequence(const std::string& id, const std::stop_token& stop) {
  ASSIGN_OR_RETURN(const std::vector<FileChecksum> files, store_.SequenceFiles(id));
  for (const FileChecksum& file : files) RETURN_IF_ERROR(One("sequences/" + id, file, stop));
  return absl::OkStatus();
}

absl::Status InputCheck::JobFiles(const std::string& id, const std::vector<std::string>& paths,
                                  const std::stop_token& stop) {
  for (const std::string& path : paths) {
    ASSIGN_OR_RETURN(const std::optional<FileChecksum> file, store_.JobFile(id, path));
    if (file) RETURN_IF_ERROR(One("jobs/" + id, *file, stop));
  }
  return absl::OkStatus();
}

absl::Status InputCheck::OfTask(const Task& task, const JobRecord& job, const std::stop_token& stop) {
  if (task.kind == TaskKind::kValidate) return Sequence(task.sequence_id, stop);
  // The self-check comes before the plan, if there is one.
  if (task.kind == TaskKind::kSelfCheck) return Sequence(task.sequence_id, stop);
  if (task.kind == TaskKind::kPrepare) {
    return job.self_check ? absl::OkStatus() : Sequence(task.sequence_id, stop);
  }
  std::vector<std::string> paths = {kConstantsPath};
  int first_frame = 0, last_frame = -1;
  if (task.kind == TaskKind::kRender) {
    const RenderRecord& render = job.renders[static_cast<size_t>(task.render)];
    ASSIGN_OR_RETURN(const std::vector<PlannedInterval> intervals,
                     store_.JobIntervals(job.id, task.first_interval, task.interval_count));
    if (!intervals.empty()) {
      first_frame = std::max(0, intervals.front().first_frame - render.reach_frames);
      last_frame = intervals.back().first_frame + intervals.back().frame_count - 1 + render.reach_frames;
    }
  }
  if (task.kind == TaskKind::kAssemble) {
    if (!job.facts.outputs.empty() && job.kind == JobKind::kUpsample) last_frame = job.frames_total - 1;
    for (int i = 0; i < job.intervals_total; ++i) paths.push_back("out/" + IntervalReportName(i));
  }
  if (last_frame >= first_frame) {
    ASSIGN_OR_RETURN(const std::vector<FrameRecord> frames,
                     store_.JobFrames(Tenant::Everyone(), job.id, first_frame, last_frame - first_frame + 1));
    for (const FrameRecord& frame : frames) AddFrame(frame.stem, paths);
  }
  return JobFiles(job.id, paths, stop);
}

absl::Status InputCheck::OfFrame(const JobRecord& job, const FrameRecord& frame) {
  std::vector<std::string> paths = {kConstantsPath};
  AddFrame(frame.stem, paths);
  return JobFiles(job.id, paths, std::stop_token());
}

}  // namespace depthtween::server
