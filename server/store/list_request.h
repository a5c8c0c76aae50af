// What a list request asks for: the small languages inside its strings.
//
// Errors are InvalidArgument (BAD_FIELD) that name the field of the request.
#ifndef DEPTHTWEEN_SERVER_STORE_LIST_REQUEST_H_
#define DEPTHTWEEN_SERVER_STORE_LIST_REQUEST_H_

#include <string_view>

#include "core/base/status.h"
#include "server/store/store.h"

namespace depthtween::server {

// Conditions "field = value" joined by AND; a value may stand in double quotes.
absl::StatusOr<SequenceFilter> ParseSequenceFilter(std::string_view filter);
absl::StatusOr<JobFilter> ParseJobFilter(std::string_view filter);
// 0 means 50; more than `max_size` means `max_size`.
absl::StatusOr<PageRequest> ParsePage(int page_size, std::string_view page_token, int max_size);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_LIST_REQUEST_H_
