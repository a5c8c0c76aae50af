// Messages <-> values: resource names, records, and the small languages inside strings.
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
#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "depthtween/v1/sequence.pb.h"
#include "depthtween/v1/types.pb.h"
#include "google/protobuf/timestamp.pb.h"
#include "server/jobs/job_manager.h"
#include "server/store/records.h"
#include "server/store/store.h"

namespace depthtween::server {

// ---- names ----
// `field` is where the request has the name. Ids are as long as the store likes, but only letters, digits, "-" and "_".

std::string SequenceName(std::string_view id);
std::string UploadName(std::string_view sequence_id, std::string_view upload_id);
std::string JobName(std::string_view id);
std::string OutputName(std::string_view job_id, std::string_view output_id);

absl::StatusOr<std::string> ParseSequenceName(std::string_view field, std::string_view name);
absl::StatusOr<std::string> ParseJobName(std::string_view field, std::string_view name);
struct UploadIds {
  std::string sequence_id, upload_id;
};
absl::StatusOr<UploadIds> ParseUploadName(std::string_view field, std::string_view name);
struct OutputIds {
  std::string job_id, output_id;
};
absl::StatusOr<OutputIds> ParseOutputName(std::string_view field, std::string_view name);
// NotFound if the job has no such output; says which it has.
absl::StatusOr<OutputSpec> FindOutput(const JobRecord& job, std::string_view output_id);

// ---- lists ----

// Conditions "field = value" joined by AND; a value may stand in double quotes.
absl::StatusOr<SequenceFilter> ParseSequenceFilter(std::string_view filter);
absl::StatusOr<JobFilter> ParseJobFilter(std::string_view filter);
// 0 means 50; more than `max_size` means `max_size`.
absl::StatusOr<PageRequest> ParsePage(int page_size, std::string_view page_token, int max_size);

inline constexpr size_t kMaxPageBytes = 3 << 20;  // clients take 4 MiB by default
// Fills `response` by `fill`, which adds the items of a page and its next_page_token; with fewer items than asked for,
// as every list may give, when they would be more than a client takes. One item goes whatever its size.
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
// What CreateJob is asked for.
absl::StatusOr<NewJob> Decode(const v1::Job& job);

google::protobuf::Timestamp Encode(absl::Time time);
v1::Camera Encode(const Camera& camera);
v1::Sequence Encode(const SequenceRecord& record, const ValidationProgress& progress);
v1::Upload Encode(const UploadRecord& record);
v1::Progress Encode(const Progress& progress);
v1::Job Encode(const JobView& job);
v1::JobEvent Encode(const JobEvent& event);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_ENCODE_H_
