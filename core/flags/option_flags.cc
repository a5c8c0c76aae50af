#include "core/flags/option_flags.h"

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace depthtween {
namespace {

using nlohmann::json;

std::string ValueText(const json& value) {
  if (value.is_array()) return absl::StrJoin(value.get<std::vector<std::string>>(), ",");
  if (value.is_number_float()) return absl::StrFormat("%g", value.get<double>());
  return value.is_string() ? value.get<std::string>() : value.dump();
}

// A flag with a value of type T.
template <typename T>
CLI::Option* AddValueFlag(CLI::App& command, const OptionSpec& spec, json& document) {
  CLI::Option* const flag = command.add_option_function<T>(
      spec.Flag(),
      [spec, &document](const T& value) {
        const absl::Status checked = CheckOption(spec, value, spec.Flag());
        if (!checked.ok()) throw CLI::ValidationError(std::string(checked.message()));
        document[spec.name] = value;
      },
      spec.help);
  flag->type_name(spec.placeholder);
  if (const std::string text = ValueText(spec.default_value); !spec.default_value.is_null() && !text.empty())
    flag->default_str(text);
  return flag;
}

CLI::Option* AddFlag(CLI::App& command, const OptionSpec& spec, json& document) {
  switch (spec.type) {
    case OptionType::kFlag:
      return command.add_flag_callback(
          spec.Flag(), [name = spec.name, &document] { document[name] = true; }, spec.help);
    case OptionType::kInteger:
      return AddValueFlag<int64_t>(command, spec, document);
    case OptionType::kNumber:
      return AddValueFlag<double>(command, spec, document);
    case OptionType::kWord:
    case OptionType::kText:
      return AddValueFlag<std::string>(command, spec, document);
    case OptionType::kWords:
      return AddValueFlag<std::vector<std::string>>(command, spec, document)->delimiter(',');
  }
  return nullptr;
}

}  // namespace

std::vector<CLI::Option*> AddOptionFlags(CLI::App& command, const std::vector<OptionSpec>& specs, json& document,
                                         const std::vector<std::string>& only) {
  std::vector<CLI::Option*> flags;
  for (const OptionSpec& spec : specs) {
    if (!only.empty() && std::find(only.begin(), only.end(), spec.name) == only.end()) continue;
    flags.push_back(AddFlag(command, spec, document));
    if (!spec.group.empty()) flags.back()->group(spec.group);
  }
  return flags;
}

std::string PresetHelp() {
  return "Presets, from the fastest on:\n"
         "  fast      motion at half resolution and fewer proposals: a first look; edges of moving things suffer\n"
         "  balanced  the default\n"
         "  best      searches longer where frames are hard to match: takes longer, gains 0 to 2 % at edges\n"
         "  reference as best, but the depth maps' surfaces move by the paper's joint optimisation: to compare with;\n"
         "            takes several times as long as best and gains little\n";
}

std::string FlagsOf(const std::vector<OptionSpec>& specs, const json& document) {
  std::vector<std::string> flags;
  for (const OptionSpec& spec : specs) {
    const auto value = document.find(spec.name);
    if (value == document.end() || *value == spec.default_value) continue;
    const bool text = spec.type == OptionType::kText;  // may begin with "-"
    flags.push_back(spec.type == OptionType::kFlag ? spec.Flag()
                                                   : absl::StrCat(spec.Flag(), text ? "=" : " ", ValueText(*value)));
  }
  return absl::StrJoin(flags, " ");
}

}  // namespace depthtween
