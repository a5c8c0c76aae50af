// The options of a job, for a server that stores and hands them on without knowing any of them: documents in, documents
// out, and the few facts that scheduling and listing outputs need.
#ifndef DEPTHTWEEN_CORE_OPTIONS_JOB_OPTIONS_H_
#define DEPTHTWEEN_CORE_OPTIONS_JOB_OPTIONS_H_

#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

// A job upsamples a recording, or computes the scene flow of the recording as it is.
enum class JobKind { kUpsample = 1, kSceneFlow = 2 };

// The document in its canonical form: a JSON object with every option of `kind`, fields in alphabetical order. Equal
// texts ask for the same. `path` names the document in messages, such as "job.options". InvalidArgument about the field
// that is wrong, which FieldOf (field_error.h) gives.
absl::StatusOr<std::string> CanonicalJobOptions(JobKind kind, std::string_view document, const std::string& path);

// A file for each frame, <folder>/<stem>.<extension> of the result.
struct FrameFiles {
  std::string id, folder, extension;
};

// What a job involves besides its frames.
struct JobFacts {
  bool self_check = false;          // a task of its own before `prepare`
  bool keep_motion = false;         // motion between frames is stored with them
  std::vector<FrameFiles> outputs;  // beside or instead of depth
};
// `canonical` must come from CanonicalJobOptions; DataLoss otherwise.
absl::StatusOr<JobFacts> FactsOfJob(JobKind kind, std::string_view canonical);

// Whether two canonical documents of upsamplings give the same depth, so that one job can take over the other's.
bool GiveSameDepth(std::string_view canonical, std::string_view other);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_JOB_OPTIONS_H_
