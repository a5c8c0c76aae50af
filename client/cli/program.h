// The program depthtween: sends recordings to a server, follows its jobs and fetches the results.
#ifndef DEPTHTWEEN_CLIENT_CLI_PROGRAM_H_
#define DEPTHTWEEN_CLIENT_CLI_PROGRAM_H_

namespace depthtween::cli {

// Returns the exit code (exit_codes.h).
int Main(int argc, const char* const* argv);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_PROGRAM_H_
