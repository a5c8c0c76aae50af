// A job as JSON, as the HTTP listener renders it.
#ifndef DEPTHTWEEN_SERVER_RPC_JOB_JSON_H_
#define DEPTHTWEEN_SERVER_RPC_JOB_JSON_H_

#include <string>

#include "core/base/status.h"
#include "server/jobs/job_manager.h"

namespace depthtween::server {

// For whoever is told of its end: without its webhook. Internal: a text that JSON cannot hold.
absl::StatusOr<std::string> JobJson(const JobView& job);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_JOB_JSON_H_
