// The flags that say how to upsample, for every command that does.
#ifndef DEPTHTWEEN_CORE_TOOLS_UPSAMPLE_FLAGS_H_
#define DEPTHTWEEN_CORE_TOOLS_UPSAMPLE_FLAGS_H_

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "core/session/upsample_run.h"

namespace depthtween::tools {

// Adds --preset, --without, --literal, --causal and --self-check in a group of their own. They write into `options`,
// which must outlive the parsing. Returns what was added, for commands that do not always upsample.
std::vector<CLI::Option*> AddQualityFlags(CLI::App& command, UpsampleOptions& options);

// What each preset trades, for a footer.
std::string PresetHelp();

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_UPSAMPLE_FLAGS_H_
