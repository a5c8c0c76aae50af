// The flags of depth of field and stereo, for every command that renders, in both programs.
#ifndef DEPTHTWEEN_CORE_FLAGS_RENDER_FLAGS_H_
#define DEPTHTWEEN_CORE_FLAGS_RENDER_FLAGS_H_

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

struct RenderFlags {
  bool dof = false, stereo = false;
  nlohmann::json dof_options = nlohmann::json::object(), stereo_options = nlohmann::json::object();
  std::string frame_format;  // empty: the default
};

// `flags` must outlive the parsing.
void AddRenderFlags(CLI::App& command, RenderFlags& flags);

// The renders that are asked for, as documents (core/session/render_options.h); none if neither --dof nor --stereo was
// given. `container` is "mp4", "mkv" or empty. InvalidArgument for flags of a render that was not asked for.
absl::StatusOr<std::vector<nlohmann::json>> RendersOf(const RenderFlags& flags, const std::string& container);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLAGS_RENDER_FLAGS_H_
