#include "client/cli/program.h"

#include <CLI/CLI.hpp>
#include <exception>
#include <iostream>

#include "client/cli/commands.h"
#include "client/cli/exit_codes.h"

namespace depthtween::cli {
namespace {

constexpr char kDescription[] =
    "Gives depth video the frame rate of colour video, on a Depthtween server.\n"
    "\n"
    "  depthtween submit SEQUENCE --wait -o OUT     upload a recording, upsample it, fetch the result\n"
    "\n"
    "If a command is interrupted, run it again: it resumes.\n";

constexpr char kExitCodeHelp[] =
    "\nExit codes: 0 done; 1 failed; 2 wrong usage; 3 server unreachable; 4 recording rejected; 5 job failed;\n"
    "            6 job cancelled; 7 job not finished, what is ready was fetched.\n"
    "Environment: DEPTHTWEEN_SERVER is the default of --server; DEPTHTWEEN_TLS_CA, _TLS_CERT, _TLS_KEY and "
    "_TOKEN_FILE\n"
    "            those of --tls-ca, --tls-cert, --tls-key and --token-file.\n"
    "Named servers: ~/.config/depthtween/servers.json, or the file that DEPTHTWEEN_CONFIG names:\n"
    "            {\"servers\": {\"studio\": {\"address\": \"depth.example.org:443\", \"tls\": true,\n"
    "                                     \"token_file\": \"studio.token\"}}}\n"
    "            Then 'depthtween list --server studio' is enough.\n";

}  // namespace

int Main(int argc, const char* const* argv) {
  int exit_code = kExitOk;
  CLI::App app(kDescription, "depthtween");
  app.footer(kExitCodeHelp);
  app.set_version_flag("--version", "depthtween " DEPTHTWEEN_VERSION);
  app.require_subcommand(1);
  app.get_formatter()->column_width(34);
  AddSubmitCommand(app, &exit_code);
  AddSceneFlowCommand(app, &exit_code);
  AddWatchCommand(app, &exit_code);
  AddFetchCommand(app, &exit_code);
  AddRenderCommand(app, &exit_code);
  AddListCommand(app, &exit_code);
  AddStatusCommand(app, &exit_code);
  AddCancelCommand(app, &exit_code);
  AddDeleteCommand(app, &exit_code);
  AddPinCommands(app, &exit_code);
  AddAdminCommand(app, &exit_code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;  // --help and --version end parsing too
  } catch (const std::exception& error) {
    std::cerr << "depthtween: unexpected failure, please report it: " << error.what() << std::endl;
    return kExitFailed;
  }
  return exit_code;
}

}  // namespace depthtween::cli
