// Builds jobs from the command line.
#ifndef DEPTHTWEEN_CLIENT_CLI_ORDER_H_
#define DEPTHTWEEN_CLIENT_CLI_ORDER_H_

#include <nlohmann/json_fwd.hpp>

#include "client/lib/status.h"
#include "core/flags/render_flags.h"
#include "core/options/job_options.h"
#include "depthtween/v1/job.pb.h"

namespace depthtween::cli {

// A job of `kind` with the options of `document`, checked here so that a mistake is reported before anything is
// uploaded. InvalidArgument names the option, its value and the rule.
absl::StatusOr<v1::Job> OrderOf(JobKind kind, const nlohmann::json& document);

// The renders that the flags ask for, as RendersOf (core/flags/render_flags.h) has them.
absl::StatusOr<std::vector<v1::RenderOptions>> RenderMessagesOf(const RenderFlags& flags, const std::string& container);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_ORDER_H_
