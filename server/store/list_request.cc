#include "server/store/list_request.h"

#include <algorithm>
#include <initializer_list>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/store/error_info.h"
#include "server/store/resource_names.h"

namespace depthtween::server {
namespace {

constexpr int kDefaultPageSize = 50;

struct Condition {
  std::string field, value;
};

absl::StatusOr<std::vector<Condition>> ParseFilter(std::string_view filter) {
  std::vector<Condition> conditions;
  if (absl::StripAsciiWhitespace(View(filter)).empty()) return conditions;
  for (const absl::string_view part : absl::StrSplit(View(filter), " AND ")) {
    const std::vector<absl::string_view> sides = absl::StrSplit(part, absl::MaxSplits('=', 1));
    if (sides.size() != 2) {
      return InvalidField("filter", absl::StrCat("has \"", absl::CHexEscape(absl::StripAsciiWhitespace(part)),
                                                 "\", must be conditions such as state = READY, joined by AND"));
    }
    absl::string_view value = absl::StripAsciiWhitespace(sides[1]);
    if (value.size() >= 2 && value.front() == '"' && value.back() == '"') value = value.substr(1, value.size() - 2);
    conditions.push_back({std::string(absl::StripAsciiWhitespace(sides[0])), std::string(value)});
  }
  return conditions;
}

absl::Status UnknownFilterField(const Condition& condition, absl::string_view known) {
  return InvalidField("filter",
                      absl::StrCat("asks for \"", absl::CHexEscape(condition.field), "\", must be about ", known));
}

template <typename State>
absl::StatusOr<State> ParseState(const Condition& condition, std::initializer_list<State> states) {
  std::string known;
  for (const State state : states) {
    const std::string_view name = ToString(state);
    if (condition.value == name) return state;
    absl::StrAppend(&known, known.empty() ? "" : ", ", View(name));
  }
  return InvalidField("filter",
                      absl::StrCat("asks for state = ", absl::CHexEscape(condition.value), ", must be one of ", known));
}

}  // namespace

absl::StatusOr<SequenceFilter> ParseSequenceFilter(std::string_view filter) {
  ASSIGN_OR_RETURN(const std::vector<Condition> conditions, ParseFilter(filter));
  SequenceFilter result;
  for (const Condition& condition : conditions) {
    if (condition.field != "state") return UnknownFilterField(condition, "state");
    ASSIGN_OR_RETURN(result.state, ParseState(condition, {SequenceState::kUploading, SequenceState::kValidating,
                                                          SequenceState::kReady, SequenceState::kInvalid}));
  }
  return result;
}

absl::StatusOr<JobFilter> ParseJobFilter(std::string_view filter) {
  ASSIGN_OR_RETURN(const std::vector<Condition> conditions, ParseFilter(filter));
  JobFilter result;
  for (const Condition& condition : conditions) {
    if (condition.field == "state") {
      ASSIGN_OR_RETURN(result.state,
                       ParseState(condition, {JobState::kQueued, JobState::kRunning, JobState::kCancelling,
                                              JobState::kSucceeded, JobState::kFailed, JobState::kCancelled}));
    } else if (condition.field == "sequence") {
      ASSIGN_OR_RETURN(result.sequence_id, ParseSequenceName("filter: sequence", condition.value));
    } else {
      return UnknownFilterField(condition, "state or sequence");
    }
  }
  return result;
}

absl::StatusOr<PageRequest> ParsePage(int page_size, std::string_view page_token, int max_size) {
  if (page_size < 0) return InvalidField("page_size", absl::StrCat("= ", page_size, ", must be >= 0"));
  return PageRequest{.size = page_size == 0 ? kDefaultPageSize : std::min(page_size, max_size),
                     .token = std::string(page_token)};
}

}  // namespace depthtween::server
