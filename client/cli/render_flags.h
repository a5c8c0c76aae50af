// The options of renders on the command line, as `depthtween-core render` names them. The server knows what is allowed.
#ifndef DEPTHTWEEN_CLIENT_CLI_RENDER_FLAGS_H_
#define DEPTHTWEEN_CLIENT_CLI_RENDER_FLAGS_H_

#include <CLI/CLI.hpp>

#include "client/lib/status.h"
#include "depthtween/v1/render.pb.h"

namespace depthtween::cli {

struct RenderFlags {
  bool dof = false, stereo = false;
  v1::DepthOfField dof_options;
  v1::Stereo stereo_options;
  v1::RenderOptions::FrameFormat frame_format = v1::RenderOptions::FRAME_FORMAT_UNSPECIFIED;
};

// Adds the flags to a subcommand. `flags` must outlive the parsing.
void AddRenderFlags(CLI::App& command, RenderFlags& flags);

// What is to be rendered; none if neither --dof nor --stereo was given. InvalidArgument for options of one that was
// not.
absl::StatusOr<std::vector<v1::RenderOptions>> RendersOf(const RenderFlags& flags,
                                                         v1::RenderOptions::Container container);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_RENDER_FLAGS_H_
