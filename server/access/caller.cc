#include "server/access/caller.h"

#include <array>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr std::array kScopes = {Scope::kRead, Scope::kWrite, Scope::kAdmin};

}  // namespace

std::string_view ToString(Scope scope) {
  switch (scope) {
    case Scope::kRead:
      return "read";
    case Scope::kWrite:
      return "write";
    case Scope::kAdmin:
      return "admin";
  }
  return "";
}

absl::StatusOr<std::set<Scope>> ParseScopes(std::string_view list) {
  std::set<Scope> scopes;
  for (const absl::string_view part : absl::StrSplit(View(list), ',')) {
    const std::string word(absl::StripAsciiWhitespace(part));
    bool known = false;
    for (const Scope scope : kScopes) {
      if (ToString(scope) != word) continue;
      scopes.insert(scope);
      known = true;
    }
    if (!known) {
      return absl::InvalidArgumentError(
          absl::StrCat("scopes: \"", word, "\" is none; the scopes are read, write, admin, joined by commas"));
    }
  }
  return scopes;
}

std::string JoinScopes(const std::set<Scope>& scopes) {
  std::vector<std::string> words;
  words.reserve(scopes.size());
  for (const Scope scope : scopes) words.emplace_back(ToString(scope));
  return absl::StrJoin(words, ",");
}

}  // namespace depthtween::server
