// What may be asked of a render, locally and from a server: the options, their JSON form, and what follows from them
// before anything is rendered.
//
//   {"name": "dof", "frame_format": "png" | "jpeg", "container": "mp4" | "mkv",
//    "depth_of_field": {"focal_mm", "fstop", "aperture_mm", "sensor", "method": "layers" | "kraus" | "gather",
//    "layers",
//                       "blades", "max_radius_px",
//                       "focus": {"depth_m"} | {"pixel": {"frame", "x", "y"}} | {"track": {"frame", "x", "y"}} |
//                                {"keys": {"keys": [{"frame", "depth_m"}], "easing": "smooth" | "linear"}}}}
//   {..., "stereo": {"baseline_m", "divergence_percent", "convergence_m", "made": "left" | "right" | "both",
//                    "floating_window", "format": "full-sbs" ..., "metadata", "screen_width_m", "viewing_distance_m"}}
//
// The names are those of depthtween.v1.RenderOptions. What is left out has its default.
// Errors: InvalidArgument whose message begins with the path of the field; FieldOf(status) is that path.
#ifndef DEPTHTWEEN_CORE_SESSION_RENDER_OPTIONS_H_
#define DEPTHTWEEN_CORE_SESSION_RENDER_OPTIONS_H_

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/base/status.h"
#include "core/io/video.h"
#include "core/options/field_error.h"
#include "core/render/comfort.h"
#include "core/render/depth_of_field.h"
#include "core/render/focus.h"
#include "core/render/stereo_format.h"
#include "core/sequence/sequence.h"

namespace depthtween {

struct DepthOfFieldRender {
  LensOptions lens;
  FocusOptions focus;
  DepthOfFieldOptions blur;
};

struct StereoRender {
  StereoOptions eyes;
  StereoFormat format = StereoFormat::kFullSbs;
  bool metadata = false;  // videos say how the eyes are packed
  Screen screen;          // of the comfort report
};

enum class FrameFormat { kPng, kJpeg };

struct RenderOptions {
  std::string name;  // of the output and its files: [a-z][a-z0-9-]*, at most 40
  std::variant<DepthOfFieldRender, StereoRender> product;
  FrameFormat frame_format = FrameFormat::kPng;
  std::optional<VideoContainer> container;  // of the video made of the frames; none: no video
};

// `path` is where the object stands, such as "renders[0]". Everything is checked that can be without a recording.
// An empty or absent name becomes "dof" or "stereo".
absl::StatusOr<RenderOptions> ParseRender(const nlohmann::json& value, const std::string& path);
// A list, at path "renders". Absent names get numbers where they would repeat; names and files must differ.
absl::StatusOr<std::vector<RenderOptions>> ParseRenders(const nlohmann::json& list);

// What a render asks for and leaves, given the recording.
struct RenderPlan {
  int reach_frames = 0;   // frames before and after one that are looked at
  int anchor_frame = -1;  // all frames from this one to the one rendered are looked at too; -1: none
  bool uses_motion = false;
  std::vector<std::string> streams;  // folders of frames, <stream>/<stem>.<extension>
  std::string extension;             // "png" or "jpg"
  std::vector<std::string> videos;   // one for each stream, if a container was asked for
};
// Checks what needs the camera and the number of frames: the focus against the lens, pixels, frames, the size of
// videos.
absl::StatusOr<RenderPlan> PlanRender(const RenderOptions& options, const Sequence& sequence, const std::string& path);
nlohmann::json ToJson(const RenderOptions& options, const RenderPlan& plan);

// How a video of these options is written, without its size and rate.
VideoOptions VideoOptionsOf(const RenderOptions& options, VideoContainer container);
// The name of a video of stream `index`: the stem, what players know the format by, the container's extension.
std::string VideoFileName(const RenderOptions& options, const std::string& stem, size_t index,
                          VideoContainer container);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_RENDER_OPTIONS_H_
