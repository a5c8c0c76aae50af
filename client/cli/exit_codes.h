// What the program's exit codes mean. Scripts rely on them: a number never changes its meaning.
#ifndef DEPTHTWEEN_CLIENT_CLI_EXIT_CODES_H_
#define DEPTHTWEEN_CLIENT_CLI_EXIT_CODES_H_

namespace depthtween::cli {

inline constexpr int kExitOk = 0;
inline constexpr int kExitFailed = 1;         // the command could not do its work; stderr says why
inline constexpr int kExitUsage = 2;          // the command line is wrong; nothing was done
inline constexpr int kExitUnreachable = 3;    // no server answers within --patience
inline constexpr int kExitInputRejected = 4;  // the recording is not valid; stderr names the files
inline constexpr int kExitJobFailed = 5;
inline constexpr int kExitJobCancelled = 6;
inline constexpr int kExitNotFinished = 7;  // the job has not ended; what is ready was fetched

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_EXIT_CODES_H_
