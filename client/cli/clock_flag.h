// --clock, checked before anything is uploaded. The server knows the rest: whether it goes with the recording.
#ifndef DEPTHTWEEN_CLIENT_CLI_CLOCK_FLAG_H_
#define DEPTHTWEEN_CLIENT_CLI_CLOCK_FLAG_H_

#include <string>

namespace depthtween::cli {

// What is wrong with `text` as UpsampleOptions.clock (job.proto), or nothing: as CLI11 wants its checks.
std::string ClockProblem(const std::string& text);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_CLOCK_FLAG_H_
