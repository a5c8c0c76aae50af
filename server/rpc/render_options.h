// v1.RenderOptions <-> the JSON that depthtween-core reads.
//
// Both sides use the same names, so the mapping is one rule for all fields, by reflection: a field keeps its name, an
// enum value loses the prefix of its type ("METHOD_LAYERS" is "layers"), and what is unset is left out. What the values
// mean, and which are allowed, only depthtween-core knows.
#ifndef DEPTHTWEEN_SERVER_RPC_RENDER_OPTIONS_H_
#define DEPTHTWEEN_SERVER_RPC_RENDER_OPTIONS_H_

#include <string>
#include <string_view>

#include "core/base/status.h"
#include "depthtween/v1/render.pb.h"

namespace depthtween::server {

inline constexpr int kMaxRenders = 16;

// `field` is where the request has the message. InvalidArgument (BAD_FIELD) for numbers that are not finite, enum
// values that this server does not know, and more than 1000 elements in a list.
absl::StatusOr<std::string> RenderToJson(std::string_view field, const v1::RenderOptions& options);
// The inverse, for JSON that RenderToJson wrote; fields it does not know are left out.
v1::RenderOptions RenderFromJson(const std::string& json);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_RENDER_OPTIONS_H_
