// Who calls, and what they may do.
#ifndef DEPTHTWEEN_SERVER_ACCESS_CALLER_H_
#define DEPTHTWEEN_SERVER_ACCESS_CALLER_H_

#include <set>
#include <string>
#include <string_view>

#include "core/base/status.h"
#include "server/store/tenant.h"

namespace depthtween::server {

// What a token allows, and what a method asks for. None includes another: a token lists all that it allows.
enum class Scope {
  kRead,   // see what the tenant has
  kWrite,  // make, change and delete what the tenant has
  kAdmin,  // look into and steer the server itself
};
std::string_view ToString(Scope scope);  // "read", "write", "admin"
// "read,write" -> the scopes. InvalidArgument names the word that is none.
absl::StatusOr<std::set<Scope>> ParseScopes(std::string_view list);
std::string JoinScopes(const std::set<Scope>& scopes);

struct Caller {
  Tenant tenant;
  std::string token_id;  // empty where the server has no tokens, and for signed links
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_CALLER_H_
