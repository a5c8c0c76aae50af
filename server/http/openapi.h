// The OpenAPI 3.1 description of the HTTP interface, from the descriptors and the comments beside them.
#ifndef DEPTHTWEEN_SERVER_HTTP_OPENAPI_H_
#define DEPTHTWEEN_SERVER_HTTP_OPENAPI_H_

#include <google/protobuf/descriptor.h>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/http/router.h"

namespace depthtween::server {

// The descriptors of depthtween.v1 with their comments, which the build puts into the program: those that generated
// code carries have none. The files are those that declare services.
class CommentedApi {
 public:
  // Internal: what was built in does not fit together.
  static absl::StatusOr<std::unique_ptr<CommentedApi>> Load();
  const std::vector<const google::protobuf::FileDescriptor*>& files() const { return files_; }

 private:
  google::protobuf::DescriptorPool pool_;
  std::vector<const google::protobuf::FileDescriptor*> files_;
};

// JSON. Every annotated method and every route of files is an operation; every message and enum that one can reach is a
// schema; every operation can fail with google.rpc.Status. Comments become descriptions where the descriptors have
// them.
std::string OpenApiDocument(const std::vector<const google::protobuf::FileDescriptor*>& files,
                            std::string_view version);

// GET /openapi.json
absl::Status AddOpenApi(Router& router);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_OPENAPI_H_
