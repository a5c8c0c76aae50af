// The routes of files: what the annotations of depthtween.v1 cannot say, because it is no JSON.
//
//   GET, HEAD          /v1/jobs/J/outputs/O/frames/N.png     one frame: .png .jpg .npz .flo .pfm, as the output offers
//   GET, HEAD          /v1/jobs/J/outputs/O.zip              all frames of a job that SUCCEEDED
//   GET, HEAD          /v1/jobs/J/outputs/O:download         an output that is one file
//   POST               /v1/sequences/S/uploads:tus           tus 1.0: creation
//   HEAD, PATCH, POST,
//   DELETE             /v1/sequences/S/uploads/U:tus         tus 1.0: any upload, also one made by StartUpload
//   PUT                /v1/sequences/S/uploads/U             with Content-Range, or all at once
// Both routes of tus answer OPTIONS too.
#ifndef DEPTHTWEEN_SERVER_HTTP_FILE_ROUTE_H_
#define DEPTHTWEEN_SERVER_HTTP_FILE_ROUTE_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "depthtween/v1/types.pb.h"

namespace depthtween::server {

struct FileRoute {
  enum class Kind { kFrame, kArchive, kFile, kTusCreation, kTusUpload, kUpload };
  Kind kind = Kind::kFrame;
  std::string resource;  // "jobs/J/outputs/O", "sequences/S" of kTusCreation, "sequences/S/uploads/U"
  // Of kFrame.
  int frame = 0;
  v1::Encoding encoding = v1::ENCODING_UNSPECIFIED;
};

// `segments` of the path, decoded. nullopt if it is none of these routes. Whether the resource exists, the calls tell.
std::optional<FileRoute> MatchFileRoute(const std::vector<std::string>& segments);

// The methods of a route, for the header Allow. Of kUpload only PUT: the bridge has the others.
std::vector<std::string_view> MethodsOf(FileRoute::Kind kind);

// The extension that a frame's file has, with its dot.
std::string_view ExtensionOf(v1::Encoding encoding);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_FILE_ROUTE_H_
