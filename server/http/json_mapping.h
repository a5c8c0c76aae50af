// Requests of HTTP <-> messages, by the rules of google.api.http and protobuf's JSON.
#ifndef DEPTHTWEEN_SERVER_HTTP_JSON_MAPPING_H_
#define DEPTHTWEEN_SERVER_HTTP_JSON_MAPPING_H_

#include <google/protobuf/message.h>

#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/status.h"
#include "google/rpc/status.pb.h"

namespace depthtween::server {

// Nesting beyond this is refused before anything is built from it.
inline constexpr int kMaxJsonDepth = 100;

struct HttpParts {
  std::string body_field;  // of the annotation: "", "*" or a field's name
  std::string body;        // JSON; empty is as good as {}
  std::map<std::string, std::string> path_values;
  // Names are paths of fields joined by ".", as in the proto or in lower camel case; a repeated field is named again
  // for each value; enums by name or number. "signature" belongs to the guard and is left out.
  std::vector<std::pair<std::string, std::string>> query;
};

// Fills `request`. An error has code INVALID_ARGUMENT and names the field: unknown ones, values that do not fit, a
// field that the body and the path say differently, query parameters where the body is the whole request. OK is code 0.
google::rpc::Status FillRequest(const HttpParts& parts, google::protobuf::Message* request);

// Lower camel case; fields of plain type are always there. Internal: a value that JSON cannot hold.
absl::StatusOr<std::string> PrintJson(const google::protobuf::Message& message);

// How deep brackets are nested outside of strings, at most; reads no further than `limit` + 1. The text need not be
// JSON.
int JsonDepth(std::string_view json, int limit);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_JSON_MAPPING_H_
