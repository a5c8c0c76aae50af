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

struct MethodRule {
  Scope scope = Scope::kAdmin;
  bool link = false;
};
using MethodRules = std::map<std::string, MethodRule, std::less<>>;

MethodRules ReadRules() {
  MethodRules rules;
  for (const google::protobuf::FileDescriptor* file :
       {v1::Sequence::descriptor()->file(), v1::Job::descriptor()->file(), v1::Output::descriptor()->file(),
        v1::ServerInfo::descriptor()->file()}) {
    for (int i = 0; i < file->service_count(); ++i) {
      for (int k = 0; k < file->service(i)->method_count(); ++k) {
        const google::protobuf::MethodDescriptor& method = *file->service(i)->method(k);
        const absl::StatusOr<std::set<Scope>> named = ParseScopes(method.options().GetExtension(v1::scope));
        rules[method.name()] = {.scope = named.ok() && named->size() == 1 ? *named->begin() : Scope::kAdmin,
                                .link = method.options().GetExtension(v1::signed_link)};
      }
    }
  }
  return rules;
}

MethodRule RuleOf(std::string_view method) {
  static const MethodRules rules = ReadRules();
  const auto found = rules.find(method);
  return found == rules.end() ? MethodRule{} : found->second;
}

}  // namespace

std::optional<Scope> ScopeOfMethod(std::string_view method) {
  if (method.substr(0, 7) == "Health.") return std::nullopt;
  return RuleOf(method).scope;
}

bool LinkOpensMethod(std::string_view method) { return RuleOf(method).link; }

}  // namespace depthtween::server
