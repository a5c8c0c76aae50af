// Rendering the frames of a finished result, in the steps that `depthtween-core render` takes in one process and the
// server in several.
//
// Any frames in any order, batching and process give the same bits: what a frame looks at is the frames around it, read
// from the result, the constants of the clip, and for a followed focus the frames from its start on.
// Memory: a window of 2 * kRenderReachFrames + 1 frames, whatever the length of the clip.
#ifndef DEPTHTWEEN_CORE_SESSION_RENDER_RUN_H_
#define DEPTHTWEEN_CORE_SESSION_RENDER_RUN_H_

#include <array>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/render/comfort.h"
#include "core/render/focus.h"
#include "core/sequence/sequence.h"
#include "core/session/render_options.h"
#include "core/session/upsample_run.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// Other frames that are asked what lies behind an edge, in order of preference. Near ones are like this one; far ones
// show more: at 240 fps, what moves a pixel a frame has uncovered six.
inline constexpr std::array kNeighborOffsets = {2, -2, 6, -6};
inline constexpr int kRenderReachFrames = 6;

// Where frames come from.
struct RenderInput {
  const FrameSource* recording = nullptr;  // its colours
  std::string result;                      // folder with their depth, and their motion if it was kept
  ClipConstants constants;
  // Asked of a frame whose depth, or motion, is not in the result: OK if it was never made, DataLoss if it was. Empty:
  // nobody knows. May be called concurrently.
  std::function<absl::Status(int frame, bool motion)> was_made = nullptr;
  // Called when a frame was rendered, or the focus followed to one, from the thread that runs. May be empty.
  std::function<void()> on_item = nullptr;
};

// The error of what was made and is gone from a result: "depth", "motion" or "color" of a frame. DataLoss.
absl::Status LostError(std::string_view what, int frame);
// {"what": "motion", "frame": 3} of such an error; null of any other.
nlohmann::json LostOf(const absl::Status& status);

// What a run of consecutive frames leaves beside its pictures: facts for the report, and where a followed focus stood,
// so that the frames after or before go on from there. Its JSON form is exact.
struct RenderPart {
  int first_frame = 0, frames = 0;
  double seconds = 0.0;
  double focus_near_m = 0.0, focus_far_m = 0.0;  // of depth of field
  std::optional<FocusPoint> first_focus, last_focus;
  std::optional<ComfortStatistics> comfort;  // of stereo
};
nlohmann::json ToJson(const RenderPart& part);
absl::StatusOr<RenderPart> ParseRenderPart(std::string_view json);

// Gets the pictures of a frame, one for each stream, in the order of frames, on the thread that runs.
using PictureSink = std::function<absl::Status(int frame, std::vector<Image<Rgb8>> pictures)>;

// One render of one clip. Threads: one at a time.
class ClipRenderer {
 public:
  // Decides what holds for the whole clip. `path` is where the options stand, for errors about them: InvalidArgument
  // with the field when they do not fit this clip. Borrows `input.recording`.
  static absl::StatusOr<std::unique_ptr<ClipRenderer>> Create(const RenderOptions& options, const RenderInput& input,
                                                              const std::string& path);
  virtual ~ClipRenderer() = default;

  // Renders frames [first, first + count). `near` may hold a part right before or after them, which saves following the
  // focus from its start. Errors: NotFound if one of these frames is not in the result; a neighbour that is missing is
  // done without, and so is motion, unless they are lost: DataLoss, see LostError. Cancelled when `stop` fires; what
  // `sink` returns.
  virtual absl::StatusOr<RenderPart> Run(int first, int count, const RenderPart* near, int threads,
                                         std::stop_token stop, const PictureSink& sink) = 0;

  // What is told about the render when all parts are there, in any order.
  virtual nlohmann::json Report(const std::vector<RenderPart>& parts) const = 0;
};

// What can be said against a render of this clip before there is a result: InvalidArgument with the field.
absl::Status CheckRender(const RenderOptions& options, const Sequence& sequence, const ClipConstants& constants,
                         const std::string& path);

absl::StatusOr<std::string> EncodePicture(ImageView<const Rgb8> picture, FrameFormat format);

// Writes <stream>/<stem>.<extension> below a folder, durably.
class PictureFolders {
 public:
  // Makes the folders that are missing.
  static absl::StatusOr<PictureFolders> Create(const std::string& dir, const RenderOptions& options,
                                               const RenderPlan& plan);
  absl::Status Write(const std::string& stem, const std::vector<Image<Rgb8>>& pictures) const;
  // Of one stream.
  std::string PictureFile(size_t stream, const std::string& stem) const;

 private:
  std::string dir_;
  FrameFormat format_ = FrameFormat::kPng;
  RenderPlan plan_;
};

// The videos of a render, one for each stream, fed with frames in their order at the rate of the recording.
//
// Create Write* Finish  - as VideoWriter.
class PictureVideos {
 public:
  // `files` has one path for each stream; the container is that of options.container.
  static absl::StatusOr<PictureVideos> Create(const std::vector<std::string>& files, const RenderOptions& options,
                                              const Sequence& sequence);
  absl::Status Write(int frame, const std::vector<Image<Rgb8>>& pictures);
  absl::Status Finish();
  const FrameClock& clock() const { return clock_; }
  std::string_view encoder() const { return videos_.front().encoder(); }

 private:
  std::vector<std::string> files_;
  VideoOptions options_;
  FrameClock clock_;
  std::vector<VideoWriter> videos_;  // none before the first frame: it tells their size
};

// Makes the videos that `plan` names in `dir` from the pictures there. `on_frame` is called after each frame; may be
// empty.
absl::Status AssembleVideos(const std::string& dir, const RenderOptions& options, const RenderPlan& plan,
                            const Sequence& sequence, std::stop_token stop,
                            const std::function<void(int frame)>& on_frame = nullptr);

// Whether `dir` is a recording that has yet to be upsampled; else it is taken for a result.
bool IsRecording(const std::string& dir);

// A whole render in one process: what of, how, and where to.
struct ClipRender {
  std::string input;         // recording, or folder that upsample wrote
  std::string sequence;      // the recording of a result; empty: where its report says it was
  std::string out;           // video, if options.container; else a folder of images named as the colour frames
  RenderOptions options;     // their path in messages is "options"
  UpsampleOptions upsample;  // of a recording. `threads` serve the render too, and do not change the pictures
  bool force = false;        // replaces what is at `out`
  // Makes the self-check of a recording before it is upsampled, as AssembleResult takes it.
  std::function<absl::StatusOr<nlohmann::json>(const SequenceFolder& recording)> self_check;
  // Makes the observer of the upsampling, then that of the render, which is one interval.
  std::function<std::unique_ptr<RunObserver>(const ClipPlan& plan)> observe;
};

struct ClipRendered {
  std::vector<std::string> files;  // videos, one for each stream, named as players know their format by; or the folder
  int frames = 0;
  double seconds = 0.0;       // wall time
  double video_fps = 0.0;     // of videos, as they are shown
  bool rate_changes = false;  // video_fps is a mean: each frame is shown at its stamp
  std::string encoder;        // of videos
  std::string report;         // ClipRenderer::Report as text
};

// Finds what is wrong with the order before it computes anything. The result of a recording is temporary, beside `out`.
// Errors: AlreadyExists when something is at `out` and `force` is not given; InvalidArgument with the field of
// `options`; Cancelled when `stop` fires; what `self_check`, observers and files return. Threads: both callbacks come
// from the calling thread.
absl::StatusOr<ClipRendered> RenderClip(const ClipRender& order, std::stop_token stop);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_RENDER_RUN_H_
