#include "server/http/api.h"

#include "absl/strings/str_cat.h"
#include "depthtween/v1/admin.pb.h"
#include "depthtween/v1/job.pb.h"
#include "depthtween/v1/output.pb.h"
#include "depthtween/v1/sequence.pb.h"
#include "google/api/annotations.pb.h"

namespace depthtween::server {
namespace {

void AddBinding(const google::protobuf::MethodDescriptor& method, const google::api::HttpRule& rule,
                std::vector<ApiMethod>& methods) {
  ApiMethod binding{.descriptor = &method,
                    .rpc = absl::StrCat("/", method.service()->full_name(), "/", method.name()),
                    .body = rule.body()};
  switch (rule.pattern_case()) {
    case google::api::HttpRule::kGet:
      binding.http_method = "GET";
      binding.path = rule.get();
      break;
    case google::api::HttpRule::kPut:
      binding.http_method = "PUT";
      binding.path = rule.put();
      break;
    case google::api::HttpRule::kPost:
      binding.http_method = "POST";
      binding.path = rule.post();
      break;
    case google::api::HttpRule::kDelete:
      binding.http_method = "DELETE";
      binding.path = rule.delete_();
      break;
    case google::api::HttpRule::kPatch:
      binding.http_method = "PATCH";
      binding.path = rule.patch();
      break;
    case google::api::HttpRule::kCustom:
    case google::api::HttpRule::PATTERN_NOT_SET:
      return;
  }
  methods.push_back(std::move(binding));
  for (const google::api::HttpRule& further : rule.additional_bindings()) AddBinding(method, further, methods);
}

}  // namespace

std::vector<const google::protobuf::FileDescriptor*> ApiFiles() {
  // By a message of each, so that the linker keeps what registers the file.
  return {v1::CreateSequenceRequest::descriptor()->file(), v1::CreateJobRequest::descriptor()->file(),
          v1::ListOutputsRequest::descriptor()->file(), v1::GetServerInfoRequest::descriptor()->file()};
}

std::vector<ApiMethod> ApiMethods(const std::vector<const google::protobuf::FileDescriptor*>& files) {
  std::vector<ApiMethod> methods;
  for (const auto* file : files) {
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        const auto* method = file->service(s)->method(m);
        if (method->options().HasExtension(google::api::http)) {
          AddBinding(*method, method->options().GetExtension(google::api::http), methods);
        }
      }
    }
  }
  return methods;
}

}  // namespace depthtween::server
