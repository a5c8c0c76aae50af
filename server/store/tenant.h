// Whose sequences and jobs a call may see and change.
#ifndef DEPTHTWEEN_SERVER_STORE_TENANT_H_
#define DEPTHTWEEN_SERVER_STORE_TENANT_H_

#include <string>
#include <string_view>
#include <utility>

#include "core/base/status.h"

namespace depthtween::server {

// Of a server without tokens, and of what was stored before it had them.
inline constexpr char kDefaultTenant[] = "default";

// A value that every method of the store takes which a client's call can reach. What belongs to another tenant is
// NotFound, as if there were none: a client cannot tell the two apart.
class Tenant {
 public:
  explicit Tenant(std::string name) : name_(std::move(name)) {}
  // The server itself, whose work is everybody's. Never of a client's call. Owns nothing: it cannot create.
  static const Tenant& Everyone() {
    static const Tenant everyone{std::string()};
    return everyone;
  }

  // Empty for Everyone().
  const std::string& name() const { return name_; }

 private:
  std::string name_;
};

// OK for 1 to 63 lower-case letters, digits and "-", the first one a letter or digit; else InvalidArgument with the
// rule.
absl::Status CheckTenantName(std::string_view name);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_TENANT_H_
