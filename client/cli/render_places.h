// Where the pictures and videos of a render go on this machine. Names from a server cannot lead elsewhere.
#ifndef DEPTHTWEEN_CLIENT_CLI_RENDER_PLACES_H_
#define DEPTHTWEEN_CLIENT_CLI_RENDER_PLACES_H_

#include <string>

#include "client/lib/status.h"
#include "depthtween/v1/output.pb.h"

namespace depthtween::cli {

// Of a video of the render `name`, beside `out`: "out.mp4" gets what the server put between name and extension, such as
// "out_LRF_Full_SBS.mp4". DataLoss when the server's name could lead elsewhere.
absl::StatusOr<std::string> VideoPlace(const std::string& out, const std::string& name, const v1::Output& output);

// Of pictures of the render `name`: one stream lies in `out` itself, those of two eyes in "out/left" and "out/right".
// DataLoss as above.
absl::StatusOr<std::string> PictureFolder(const std::string& out, const std::string& name, const v1::Output& output);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_RENDER_PLACES_H_
