// What each method asks of its caller, read from the options of our .proto files (access.proto).
#ifndef DEPTHTWEEN_SERVER_RPC_METHOD_RULES_H_
#define DEPTHTWEEN_SERVER_RPC_METHOD_RULES_H_

#include <optional>
#include <string_view>

#include "server/access/caller.h"

namespace depthtween::server {

// The scope that a method of ours needs, by its name without the service, such as "GetJob". nullopt for methods that
// anybody may call: those of the health service. A method that names no scope needs kAdmin, so that one that was
// forgotten lets nobody in.
std::optional<Scope> ScopeOfMethod(std::string_view method);
// Whether a signed link opens it.
bool LinkOpensMethod(std::string_view method);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_RPC_METHOD_RULES_H_
