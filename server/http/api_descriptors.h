// The .proto files of depthtween.v1 as a serialized google.protobuf.FileDescriptorSet with comments: made by the build.
#ifndef DEPTHTWEEN_SERVER_HTTP_API_DESCRIPTORS_H_
#define DEPTHTWEEN_SERVER_HTTP_API_DESCRIPTORS_H_

#include <cstddef>

namespace depthtween::server {

extern const unsigned char kApiDescriptors[];
extern const size_t kApiDescriptorsSize;

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_API_DESCRIPTORS_H_
