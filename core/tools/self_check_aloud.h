// A self-check for a person at a terminal.
#ifndef DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_ALOUD_H_
#define DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_ALOUD_H_

#include <nlohmann/json_fwd.hpp>
#include <stop_token>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/session/upsample_run.h"

namespace depthtween::tools {

// CheckSelf if `options.self_check`, for a person at a terminal: counts maps on stderr and prints the table to stdout.
// Returns what AssembleResult takes: null if nobody asked.
absl::StatusOr<nlohmann::json> CheckSelfAloud(const SequenceFolder& recording, const UpsampleOptions& options,
                                              std::stop_token stop);

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_SELF_CHECK_ALOUD_H_
