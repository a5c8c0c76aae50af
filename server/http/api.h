// The methods of depthtween.v1 as HTTP knows them, from the google.api.http annotations in the descriptors.
#ifndef DEPTHTWEEN_SERVER_HTTP_API_H_
#define DEPTHTWEEN_SERVER_HTTP_API_H_

#include <google/protobuf/descriptor.h>

#include <string>
#include <vector>

namespace depthtween::server {

struct ApiMethod {
  const google::protobuf::MethodDescriptor* descriptor = nullptr;
  std::string rpc;          // "/depthtween.v1.JobService/GetJob"
  std::string http_method;  // "GET"
  std::string path;         // the template, "/v1/{name=jobs/*}"
  std::string body;         // "" none, "*" the whole request, else the field that it becomes
};

// The files that declare services of ours. A file that is not named here is not served over HTTP.
std::vector<const google::protobuf::FileDescriptor*> ApiFiles();

// Every binding of every method of these files, in their order. Methods without an annotation have none.
std::vector<ApiMethod> ApiMethods(const std::vector<const google::protobuf::FileDescriptor*>& files);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_API_H_
