// The program depthtween-core: the library's work on local files, one subcommand each (see commands.h).
#ifndef DEPTHTWEEN_CORE_TOOLS_TOOLS_H_
#define DEPTHTWEEN_CORE_TOOLS_TOOLS_H_

#include <CLI/CLI.hpp>
#include <functional>

namespace depthtween::tools {

// Parses the command line, runs the command it names, and returns the exit code (commands.h). Messages go to stderr.
int Main(int argc, const char* const* argv);

// The same for another program of ours: `add` adds its flags and what it does. Sets the process up as ours are: refuses
// a processor that is too old, and settles threads of OpenCV and the heap.
int RunProgram(int argc, const char* const* argv, const char* name, const char* description,
               const std::function<void(CLI::App& app, int* exit_code)>& add);

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_TOOLS_H_
