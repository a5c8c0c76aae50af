// Any bytes as a document of options: an error, or a canonical document that is its own canonical form and that tells
// what the job involves.
#include "core/options/job_options.h"

#include <cstdlib>

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  for (const JobKind kind : {JobKind::kUpsample, JobKind::kSceneFlow}) {
    const auto canonical = CanonicalJobOptions(kind, {reinterpret_cast<const char*>(data), size}, "options");
    if (!canonical.ok()) continue;
    const auto again = CanonicalJobOptions(kind, *canonical, "options");
    if (!again.ok() || *again != *canonical || !FactsOfJob(kind, *canonical).ok()) std::abort();
  }
  return 0;
}
