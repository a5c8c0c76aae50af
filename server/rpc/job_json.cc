#include "server/rpc/job_json.h"

#include <google/protobuf/util/json_util.h>

#include "absl/strings/str_cat.h"
#include "server/rpc/encode.h"

namespace depthtween::server {

absl::StatusOr<std::string> JobJson(const JobView& job) {
  v1::Job message = Encode(job);
  message.clear_webhook();
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = true;
  std::string json;
  const auto printed = google::protobuf::util::MessageToJsonString(message, &json, options);
  if (printed.ok()) return json;
  return absl::InternalError(
      absl::StrCat("a job does not fit JSON: ", std::string(printed.message().data(), printed.message().size())));
}

}  // namespace depthtween::server
