// The subcommands of depthtween-core: one file <name>_command.cc and one function here for each.
//
// A function adds its subcommand to `app`. When the command line names it, the command runs while `app` parses and
// stores its exit code; `exit_code` must outlive the parsing.
#ifndef DEPTHTWEEN_CORE_TOOLS_COMMANDS_H_
#define DEPTHTWEEN_CORE_TOOLS_COMMANDS_H_

#include <CLI/CLI.hpp>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/options/upsample_options.h"

namespace depthtween::tools {

inline constexpr int kExitOk = 0;
inline constexpr int kExitFailed = 1;  // the command could not do its work; stderr says why
inline constexpr int kExitUsage = 2;   // the command line is wrong; nothing was done

// Prints a failure to stderr, for a person to read. Returns the exit code that `status` means.
int ReportStatus(const absl::Status& status);

// The flag --threads.
void AddThreads(CLI::App& command, int& threads, const char* help = "Threads to use; the result does not depend on it");

// CheckSelf if `options.self_check`, for a person at a terminal: counts maps on stderr and prints the table to stdout.
// Returns what AssembleResult takes: null if nobody asked.
absl::StatusOr<nlohmann::json> CheckSelfAloud(const SequenceFolder& recording, const UpsampleOptions& options,
                                              std::stop_token stop);

void AddSynthCommand(CLI::App& app, int* exit_code);
void AddUpsampleCommand(CLI::App& app, int* exit_code);
void AddSceneFlowCommand(CLI::App& app, int* exit_code);
void AddEvaluateCommand(CLI::App& app, int* exit_code);
void AddPreviewCommand(CLI::App& app, int* exit_code);
void AddRenderCommand(CLI::App& app, int* exit_code);
void AddSyncCommand(CLI::App& app, int* exit_code);
void AddTaskCommand(CLI::App& app, int* exit_code);
// `run` is what main() does with a command line.
void AddTaskHostCommand(CLI::App& app, int (*run)(int argc, const char* const* argv));

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_COMMANDS_H_
