// How the server talks to `depthtween-core task`: command lines out, JSON in. Nothing a child says is trusted.
#ifndef DEPTHTWEEN_SERVER_JOBS_TASK_PROTOCOL_H_
#define DEPTHTWEEN_SERVER_JOBS_TASK_PROTOCOL_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/store/records.h"

namespace depthtween::server {

// Where a task finds and leaves its files. All are paths; unused ones stay empty.
struct TaskPaths {
  std::string program;
  std::string sequence;   // folder
  std::string options;    // file
  std::string constants;  // file: written by prepare, read by the others
  std::string out;        // folder; of self-check: file
  std::string result;     // folder with finished frames, to render from
  // File that self-check wrote, for the report of assemble; empty if there was none.
  std::string self_check;
  int threads = 1;
  int64_t max_pixels = 0;    // of validate: of all frames of the sequence together; 0: no limit
  bool keep_motion = false;  // between frames, for renders
};
// `render` names the render of a render task.
std::vector<std::string> TaskCommand(const Task& task, const TaskPaths& paths, std::string_view render = {});

// The content of the options file: a job's canonical options, and its renders.
std::string OrderJson(JobKind kind, const std::string& options, const std::vector<RenderRecord>& renders = {});
// The same for `render-frame`, with the options of its one render.
std::string FrameRenderJson(const std::string& options, const std::string& render, bool jpeg);

// One line of progress. At most one of the members is set; none if the line says nothing known.
struct ProgressLine {
  struct IntervalDone {
    int interval = 0;
    double seconds = 0.0;
  };
  struct Checked {
    int checked = 0;
    int of = 0;
  };
  std::optional<std::string> stage;
  std::optional<IntervalDone> interval_done;
  std::optional<Checked> checked;
  std::optional<absl::Status> error;  // never OK; BAD_FIELD if it names a field
  // With `error`: the file that the child needs and that is gone.
  struct Lost {
    std::string what;  // "depth", "motion" or "color"
    int frame = 0;
  };
  std::optional<Lost> lost;
};
ProgressLine ParseProgressLine(std::string_view line);

// The error FILE_LOST, for clients.
absl::Status LostStatus(const ProgressLine::Lost& lost, std::string_view job_id, std::string_view sequence_id);

// How many frames of an interval have motion, from the report that `intervals` left beside them. Internal if it is
// malformed.
absl::StatusOr<int> ParseMotionFrames(std::string_view json);

// `depthtween-core task unpack`: an archive in the folder `sequence`, to the folder `out`.
std::vector<std::string> UnpackCommand(const TaskPaths& paths, std::string_view archive, int max_files,
                                       int64_t max_bytes);
// What `unpack` printed: what is wrong with the archive; nothing if it is unpacked. Internal if it is malformed.
absl::StatusOr<std::vector<FileViolation>> ParseUnpacking(std::string_view json);

// What `validate` printed. Internal if it is malformed.
absl::StatusOr<ValidationResult> ParseValidation(std::string_view json);
// What `prepare` wrote. Internal if it is malformed: intervals and frames must be numbered from 0, every frame in
// exactly one interval, stems plain file names and different.
absl::StatusOr<JobPlan> ParsePlan(std::string_view json);
// What `self-check` wrote. Internal if it is malformed: few methods and frames, shares between 0 and 1.
absl::StatusOr<SelfCheck> ReadSelfCheck(std::string_view json);
// What `plan` answered about renders with these options. Internal if it is malformed: as many plans, names and outputs
// plain and different.
absl::StatusOr<std::vector<RenderRecord>> ParseRenderPlans(std::string_view json, std::vector<RenderRecord> renders);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_TASK_PROTOCOL_H_
