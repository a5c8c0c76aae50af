// The program depthtween-core: the library's work on local files, one subcommand each (see commands.h).
#ifndef DEPTHTWEEN_CORE_TOOLS_TOOLS_H_
#define DEPTHTWEEN_CORE_TOOLS_TOOLS_H_

namespace depthtween::tools {

// Parses the command line, runs the command it names, and returns the exit code (commands.h). Messages go to stderr.
int Main(int argc, const char* const* argv);

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_TOOLS_H_
