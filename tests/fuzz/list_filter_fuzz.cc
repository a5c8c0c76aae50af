// Any bytes as the filter of a list: an error about a field, or a filter whose sequence has a name that reads back.
#include <cstdlib>

#include "server/store/error_info.h"
#include "server/store/list_request.h"
#include "server/store/resource_names.h"

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto sequences = ParseSequenceFilter(text);
  if (!sequences.ok() && GetErrorInfo(sequences.status())->reason != "BAD_FIELD") std::abort();
  const auto jobs = ParseJobFilter(text);
  if (!jobs.ok() && GetErrorInfo(jobs.status())->reason != "BAD_FIELD") std::abort();
  if (jobs.ok() && jobs->sequence_id) {
    const auto again = ParseSequenceName("name", SequenceName(*jobs->sequence_id));
    if (!again.ok() || *again != *jobs->sequence_id) std::abort();
  }
  return 0;
}
