// Command-line flags made from a list of options. Both programs use them, so that they take the same words.
#ifndef DEPTHTWEEN_CORE_FLAGS_OPTION_FLAGS_H_
#define DEPTHTWEEN_CORE_FLAGS_OPTION_FLAGS_H_

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/options/option.h"

namespace depthtween {

// Adds a flag for each option, or for those in `only` if that names any. What the command line gives is checked as
// CheckOption does (a wrong value is a usage error) and set in `document`, which must outlive the parsing. Returns the
// flags.
std::vector<CLI::Option*> AddOptionFlags(CLI::App& command, const std::vector<OptionSpec>& specs,
                                         nlohmann::json& document, const std::vector<std::string>& only = {});

// What each preset trades, for the footer of a command with --preset.
std::string PresetHelp();

// The flags that say what differs from the defaults in `document`: "--preset fast --causal". Empty if nothing does.
std::string FlagsOf(const std::vector<OptionSpec>& specs, const nlohmann::json& document);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLAGS_OPTION_FLAGS_H_
