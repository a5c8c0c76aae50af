// The part of the OpenAPI description that no descriptor holds: the routes of files (file_route.h).
#ifndef DEPTHTWEEN_SERVER_HTTP_OPENAPI_FILES_H_
#define DEPTHTWEEN_SERVER_HTTP_OPENAPI_FILES_H_

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace depthtween::server {

// What opens an operation: a token with all of these scopes, or where that is so a signed link.
nlohmann::ordered_json SecurityOf(const std::vector<std::string>& scopes, bool signed_link = false);

// {"paths": ..., "components": {"parameters": ..., "headers": ..., "responses": ...}}. References lead into it, and to
// the schemas and security schemes of the rest.
nlohmann::ordered_json FileRoutesOfOpenApi();

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_OPENAPI_FILES_H_
