// What the commands share that upload a recording and create a job for it.
#ifndef DEPTHTWEEN_CLIENT_CLI_SUBMISSION_H_
#define DEPTHTWEEN_CLIENT_CLI_SUBMISSION_H_

#include <CLI/CLI.hpp>
#include <string>

#include "absl/time/time.h"

#include "client/cli/common.h"
#include "depthtween/v1/job.pb.h"

namespace depthtween::cli {

struct SubmissionOptions {
  CommonOptions common;
  std::string sequence;
  std::string output;  // empty: nothing is fetched
  bool force = false;
  bool wait = false;
  int threads = 0;
  int priority = 0;
  absl::Duration queue_limit, run_limit;  // zero: those of the server
  bool pin = false;
  std::string webhook;  // empty: nobody is told
};

// Adds them to a subcommand. `options` must outlive the parsing.
void AddSubmissionOptions(CLI::App& command, SubmissionOptions& options);

// Uploads what the server lacks, creates the job of `order`, which has neither name nor sequence, and, if asked to,
// waits for it and fetches its result. Reports an `order` that is an error before doing anything. Prints the outcome
// and returns the exit code.
int RunSubmission(const SubmissionOptions& options, absl::StatusOr<v1::Job> order);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_SUBMISSION_H_
