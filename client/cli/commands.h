// The subcommands of depthtween: one file <name>_command.cc and one function here for each.
//
// A function adds its subcommand to `app`. When the command line names it, the command runs while `app` parses and
// stores its exit code (exit_codes.h); `exit_code` must outlive the parsing. Results go to stdout, everything else to
// stderr.
#ifndef DEPTHTWEEN_CLIENT_CLI_COMMANDS_H_
#define DEPTHTWEEN_CLIENT_CLI_COMMANDS_H_

#include <CLI/CLI.hpp>

namespace depthtween::cli {

void AddSubmitCommand(CLI::App& app, int* exit_code);
void AddSceneFlowCommand(CLI::App& app, int* exit_code);
void AddWatchCommand(CLI::App& app, int* exit_code);
void AddFetchCommand(CLI::App& app, int* exit_code);
void AddRenderCommand(CLI::App& app, int* exit_code);
void AddListCommand(CLI::App& app, int* exit_code);
void AddStatusCommand(CLI::App& app, int* exit_code);
void AddCancelCommand(CLI::App& app, int* exit_code);
void AddDeleteCommand(CLI::App& app, int* exit_code);
void AddPinCommands(CLI::App& app, int* exit_code);
void AddAdminCommand(CLI::App& app, int* exit_code);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_COMMANDS_H_
