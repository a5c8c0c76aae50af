// Messages <-> values.
//
// Decoding errors are InvalidArgument (BAD_FIELD) that name the field of the request.
#ifndef DEPTHTWEEN_SERVER_RPC_ENCODE_H_
#define DEPTHTWEEN_SERVER_RPC_ENCODE_H_

#include <cstddef>
#include <functional>
#include <string>
#include <string_view>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "depthtween/v1/admin.pb.h"
#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "depthtween/v1/sequence.pb.h"
#include "depthtween/v1/types.pb.h"
#include "google/protobuf/timestamp.pb.h"
#include "server/jobs/job_manager.h"
#include "server/store/list_request.h"
#include "server/store/records.h"
#include "server/store/resource_names.h"
#include "server/store/store.h"

namespace depthtween::server {

// NotFound if the job has no such output; says which it has.
absl::StatusOr<OutputSpec> FindOutput(const JobRecord& job, std::string_view output_id);

// ---- lists ----

inline constexpr size_t kMaxPageBytes = 3 << 20;  // clients take 4 MiB by default
// Fills `response` by `fill`, which adds the items of a page and its next_page_token. Asks for fewer items when the
// page would be more than a client takes, at least for one, whatever its size.
template <typename Response>
absl::Status FillPage(PageRequest page, Response* response,
                      const std::function<absl::Status(const PageRequest& page)>& fill) {
  for (;; page.size /= 2) {
    RETURN_IF_ERROR(fill(page));
    if (page.size == 1 || response->ByteSizeLong() <= kMaxPageBytes) return absl::OkStatus();
    response->Clear();
  }
}

// ---- values ----

// `options`, at `field` of the request, as the JSON document that depthtween-core reads. InvalidArgument (BAD_FIELD) if
// it is too large to keep.
absl::StatusOr<std::string> OptionsDocument(const std::string& field, const google::protobuf::Message& options);
// The job that CreateJob asks for.
absl::StatusOr<NewJob> Decode(const v1::Job& job);

google::protobuf::Timestamp Encode(absl::Time time);
v1::Camera Encode(const Camera& camera);
v1::Sequence Encode(const SequenceRecord& record, const ValidationProgress& progress);
v1::Upload Encode(const UploadRecord& record);
v1::Progress Encode(const Progress& progress);
// With kBasic, without what a list of that detail does not know.
v1::Job Encode(const JobView& job, JobDetail detail = JobDetail::kFull);
v1::Limits Encode(const Limits& limits, double max_calls_per_second);
v1::JobEvent Encode(const JobEvent& event);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_ENCODE_H_
