#include "server/rpc/method_rules.h"

#include <google/protobuf/descriptor.h>

#include <map>
#include <string>

#include "depthtween/v1/access.pb.h"
#include "depthtween/v1/admin.pb.h"
#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "depthtween/v1/sequence.pb.h"

namespace depthtween::server {
namespace {

using Scopes = std::map<std::string, Scope, std::less<>>;

Scopes ReadScopes() {
  Scopes scopes;
  for (const google::protobuf::FileDescriptor* file :
       {v1::Sequence::descriptor()->file(), v1::Job::descriptor()->file(), v1::Output::descriptor()->file(),
        v1::ServerInfo::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int k = 0; k < file->service(i)->method_count(); ++k) {
        const google::protobuf::MethodDescriptor& method = *file->service(i)->method(k);
        const absl::StatusOr<std::set<Scope>> named = ParseScopes(method.options().GetExtension(v1::scope));
        scopes[method.name()] = named.ok() && named->size() == 1 ? *named->begin() : Scope::kAdmin;
      }
    }
  }
  return scopes;
}

}  // namespace

std::optional<Scope> ScopeOfMethod(std::string_view method) {
  static const Scopes scopes = ReadScopes();
  if (method.substr(0, 7) == "Health.") return std::nullopt;
  const auto found = scopes.find(method);
  return found == scopes.end() ? Scope::kAdmin : found->second;
}

}  // namespace depthtween::server
