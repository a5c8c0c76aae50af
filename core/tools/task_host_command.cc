// `depthtween-core task-host`: forks tasks for a server (core/launch/launch.h). No command for people, so --help is
// silent about it.
#include "core/launch/launch.h"
#include "core/tools/commands.h"

namespace depthtween::tools {

void AddTaskHostCommand(CLI::App& app, int (*run)(int argc, const char* const* argv)) {
  CLI::App* const command =
      app.add_subcommand(kHostCommand, "Fork tasks for a server, which holds the other end of fd 3");
  command->group("");
  command->callback([run] { HostTasks(kProgressFd, run); });
}

}  // namespace depthtween::tools
