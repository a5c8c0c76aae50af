// Routes as they are read from the descriptors, against the annotations in the .proto files.
#include "server/http/api.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "server/http/router.h"

namespace depthtween::server {
namespace {

const ApiMethod* Find(const std::vector<ApiMethod>& methods, const std::string& rpc) {
  const auto found =
      std::find_if(methods.begin(), methods.end(), [&rpc](const ApiMethod& method) { return method.rpc == rpc; });
  return found == methods.end() ? nullptr : &*found;
}

TEST(Api, ReadsTheAnnotations) {
  const std::vector<ApiMethod> methods = ApiMethods(ApiFiles());
  const ApiMethod* create = Find(methods, "/depthtween.v1.JobService/CreateJob");
  ASSERT_NE(create, nullptr);
  EXPECT_EQ(create->http_method, "POST");
  EXPECT_EQ(create->path, "/v1/jobs");
  EXPECT_EQ(create->body, "job");
  const ApiMethod* stream = Find(methods, "/depthtween.v1.OutputService/StreamFrames");
  ASSERT_NE(stream, nullptr);
  EXPECT_EQ(stream->path, "/v1/{name=jobs/*/outputs/*}:streamFrames");
  EXPECT_EQ(stream->body, "");
}

// Each service of ours, each method: one that is forgotten could not be reached. And each can be routed.
TEST(Api, EveryMethodHasARoute) {
  const std::vector<ApiMethod> methods = ApiMethods(ApiFiles());
  int services = 0;
  for (const auto* file : ApiFiles()) {
    for (int s = 0; s < file->service_count(); ++s) {
      ++services;
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        const std::string rpc = "/" + file->service(s)->full_name() + "/" + file->service(s)->method(m)->name();
        const ApiMethod* method = Find(methods, rpc);
        ASSERT_NE(method, nullptr) << rpc;
        const auto path = PathTemplate::Parse(method->path);
        ASSERT_TRUE(path.ok()) << path.status();
        for (const std::string& variable : path->variables()) {
          const auto* field = method->descriptor->input_type()->FindFieldByName(variable);
          ASSERT_NE(field, nullptr) << rpc << " " << variable;
          EXPECT_EQ(field->type(), google::protobuf::FieldDescriptor::TYPE_STRING);
        }
        EXPECT_TRUE(method->body.empty() || method->body == "*" ||
                    method->descriptor->input_type()->FindFieldByName(method->body) != nullptr);
      }
    }
  }
  EXPECT_GE(services, 4);
}

}  // namespace
}  // namespace depthtween::server
