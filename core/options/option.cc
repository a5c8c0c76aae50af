#include "core/options/option.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "core/options/field_error.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr size_t kShownBytes = 200;

// For messages: bytes that are not UTF-8 are replaced, long values cut.
std::string Shown(const json& value) {
  std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  if (text.size() > kShownBytes) text.replace(kShownBytes, text.npos, "...");
  return text;
}

bool Knows(const OptionSpec& spec, const json& word) {
  return std::any_of(spec.words.begin(), spec.words.end(), [&](const std::string& known) { return word == known; });
}

std::string Range(const OptionSpec& spec) {
  if (spec.type == OptionType::kInteger && spec.max >= std::numeric_limits<int>::max())
    return absl::StrFormat("at least %.0f", spec.min);
  return absl::StrFormat("%g to %g", spec.min, spec.max);
}

}  // namespace

std::string OptionSpec::Flag() const { return flag.empty() ? "--" + absl::StrReplaceAll(name, {{"_", "-"}}) : flag; }

absl::Status CheckOption(const OptionSpec& spec, const json& value, const std::string& path) {
  const auto wrong = [&](const std::string& rule) {
    return FieldError(path, absl::StrCat("= ", Shown(value), ", must be ", rule));
  };
  switch (spec.type) {
    case OptionType::kFlag:
      return value.is_boolean() ? absl::OkStatus() : wrong("true or false");
    case OptionType::kInteger:
    case OptionType::kNumber: {
      const bool whole = spec.type == OptionType::kInteger;
      if (whole ? !value.is_number_integer() : !value.is_number()) return wrong(whole ? "a whole number" : "a number");
      const double number = value.get<double>();
      return number >= spec.min && number <= spec.max ? absl::OkStatus() : wrong(Range(spec));
    }
    case OptionType::kWord:
      return Knows(spec, value) ? absl::OkStatus() : wrong("one of: " + absl::StrJoin(spec.words, ", "));
    case OptionType::kWords:
      if (!value.is_array()) return wrong("a list of strings");
      for (const json& word : value)
        if (!Knows(spec, word))
          return FieldError(path,
                            absl::StrCat("has ", Shown(word), ", must be some of: ", absl::StrJoin(spec.words, ", ")));
      return absl::OkStatus();
    case OptionType::kText: {
      if (!value.is_string()) return wrong("a string");
      const absl::Status checked = spec.check(value.get_ref<const std::string&>());
      return checked.ok() ? absl::OkStatus() : FieldError(path, std::string(checked.message()));
    }
  }
  return absl::OkStatus();
}

namespace {

// Each word once, so that no list is longer than that of its words.
json Distinct(const json& words) {
  json distinct = json::array();
  for (const json& word : words)
    if (std::find(distinct.begin(), distinct.end(), word) == distinct.end()) distinct.push_back(word);
  return distinct;
}

}  // namespace

absl::StatusOr<json> FillDocument(const std::vector<OptionSpec>& specs, const json& document, const std::string& path) {
  if (!document.is_object()) return FieldError(path, "must be a JSON object");
  json filled = json::object();
  for (const OptionSpec& spec : specs) {
    const auto found = document.find(spec.name);
    if (found != document.end()) RETURN_IF_ERROR(CheckOption(spec, *found, absl::StrCat(path, ".", spec.name)));
    filled[spec.name] = found == document.end() ? spec.default_value : *found;
    if (spec.type == OptionType::kWords) filled[spec.name] = Distinct(filled[spec.name]);
  }
  for (const auto& [field, unused] : document.items()) {
    if (filled.contains(field)) continue;
    std::vector<std::string> known;
    known.reserve(specs.size());
    for (const OptionSpec& spec : specs) known.push_back(spec.name);
    return FieldError(absl::StrCat(path, ".", field),
                      absl::StrCat("is not known: the options are ", absl::StrJoin(known, ", ")));
  }
  return filled;
}

}  // namespace depthtween
