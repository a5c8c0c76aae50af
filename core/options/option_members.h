// Ties the options of a list to the members of a plain struct: the struct is what code reads, the list what documents,
// flags and help are made from.
#ifndef DEPTHTWEEN_CORE_OPTIONS_OPTION_MEMBERS_H_
#define DEPTHTWEEN_CORE_OPTIONS_OPTION_MEMBERS_H_

#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/options/option.h"

namespace depthtween {

template <typename Options>
class OptionMembers {
 public:
  // The option that `Member` holds. Type and default come from the member.
  template <auto Member>
  OptionMembers& Add(OptionSpec spec) {
    using Value = std::decay_t<decltype(std::declval<Options>().*Member)>;
    if constexpr (std::is_same_v<Value, bool>) spec.type = OptionType::kFlag;
    if constexpr (std::is_same_v<Value, int>) spec.type = OptionType::kInteger;
    if constexpr (std::is_same_v<Value, double>) spec.type = OptionType::kNumber;
    if constexpr (std::is_same_v<Value, std::string>)
      spec.type = spec.words.empty() ? OptionType::kText : OptionType::kWord;
    if constexpr (std::is_same_v<Value, std::vector<std::string>>) spec.type = OptionType::kWords;
    spec.default_value = Options().*Member;
    specs_.push_back(std::move(spec));
    accesses_.push_back({[](const nlohmann::json& value, Options& options) { options.*Member = value.get<Value>(); },
                         [](const Options& options) -> nlohmann::json { return options.*Member; }});
    return *this;
  }

  const std::vector<OptionSpec>& specs() const { return specs_; }

  nlohmann::json ToJson(const Options& options) const {
    nlohmann::json document = nlohmann::json::object();
    for (size_t i = 0; i < specs_.size(); ++i) document[specs_[i].name] = accesses_[i].get(options);
    return document;
  }
  // `filled` must have passed FillDocument.
  Options FromFilled(const nlohmann::json& filled) const {
    Options options;
    for (size_t i = 0; i < specs_.size(); ++i) accesses_[i].set(filled.at(specs_[i].name), options);
    return options;
  }

 private:
  struct Access {
    void (*set)(const nlohmann::json& value, Options& options);
    nlohmann::json (*get)(const Options& options);
  };
  std::vector<OptionSpec> specs_;
  std::vector<Access> accesses_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_OPTION_MEMBERS_H_
