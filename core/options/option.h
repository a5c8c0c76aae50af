// What an option is: the one place from which JSON documents, command-line flags and help are derived.
//
// A list of options is a vector of OptionSpec. A document is a JSON object with a field for each option that differs
// from its default. Flags are made from the same list by core/flags.
#ifndef DEPTHTWEEN_CORE_OPTIONS_OPTION_H_
#define DEPTHTWEEN_CORE_OPTIONS_OPTION_H_

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

// The JSON type is boolean, whole number, number, string, list of strings, string.
enum class OptionType { kFlag, kInteger, kNumber, kWord, kWords, kText };

struct OptionSpec {
  // Of the field in documents and messages, snake_case. The flag is "--" and the name, with "-" for "_".
  std::string name;
  std::string help;         // one sentence without full stop
  std::string placeholder;  // of the value in help, such as "N"
  std::string group;        // heading in help; empty for the general one
  std::string flag;         // of the command line, where it differs from the name: "--format"

  // Rules. `words` of kWord and kWords; `min` and `max` of kInteger and kNumber; `check` of kText.
  std::vector<std::string> words;
  double min = 0, max = 0;
  absl::Status (*check)(std::string_view text) = nullptr;

  // Set by the list that holds it, from the member of the struct.
  OptionType type = OptionType::kFlag;
  nlohmann::json default_value;

  std::string Flag() const;
};

// Checks `value` against type and rules. InvalidArgument about `path`, which FieldOf gives.
absl::Status CheckOption(const OptionSpec& spec, const nlohmann::json& value, const std::string& path);

// `document` with a field for every option. `path` names the document in messages, such as "job.options".
// InvalidArgument about the field that is wrong or that no option has.
absl::StatusOr<nlohmann::json> FillDocument(const std::vector<OptionSpec>& specs, const nlohmann::json& document,
                                            const std::string& path);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_OPTION_H_
