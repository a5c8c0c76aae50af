#include "core/session/render_run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/io/color.h"
#include "core/io/file.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"
#include "core/io/result_folder.h"

namespace depthtween {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

struct LoadedFrame {
  Image<Rgb8> color;
  Image<float> depth_m;
  FrameMotion motion;  // empty where the frame has none

  RenderView view() const { return {.color = color, .depth_m = depth_m}; }
};

constexpr char kLostPayload[] = "depthtween/lost";

// Reads what a result says of one colour frame. NotFound when the frame is not in it.
absl::StatusOr<Image<float>> ReadDepth(const RenderInput& input, int frame) {
  const Sequence& sequence = input.recording->sequence();
  auto depth = ReadResultDepth(input.result, sequence.color[frame].Stem(), sequence.depth_scale);
  if (absl::IsNotFound(depth.status()) && input.was_made) RETURN_IF_ERROR(input.was_made(frame, /*motion=*/false));
  return depth;
}

absl::StatusOr<FrameMotion> ReadMotion(const RenderInput& input, int frame) {
  absl::StatusOr<FrameMotion> motion = ReadResultMotion(input.result, input.recording->sequence().color[frame].Stem());
  if (!absl::IsNotFound(motion.status())) return motion;
  if (input.was_made) RETURN_IF_ERROR(input.was_made(frame, /*motion=*/true));
  return FrameMotion();
}

// The frames around the one that is rendered, each read once while the window slides over it.
class FrameWindow {
 public:
  FrameWindow(const RenderInput& input, int reach) : input_(input), reach_(reach) {}

  // Afterwards the frames around `centre` are there, as far as the result has them; `centre` itself in any case.
  absl::Status MoveTo(int centre, int threads) {
    const int count = static_cast<int>(input_.recording->sequence().color.size());
    const int first = std::max(0, centre - reach_), last = std::min(count - 1, centre + reach_);
    std::erase_if(frames_, [&](const auto& entry) { return entry.first < first || entry.first > last; });
    std::vector<int> missing;
    for (int i = first; i <= last; ++i)
      if (frames_.count(i) == 0) missing.push_back(i);
    std::vector<absl::StatusOr<LoadedFrame>> loaded(missing.size());
    ParallelFor(static_cast<int>(missing.size()), threads, [&](int i) { loaded[i] = Load(missing[i]); });
    for (size_t i = 0; i < missing.size(); ++i) {
      if (absl::IsNotFound(loaded[i].status()) && missing[i] != centre) continue;
      ASSIGN_OR_RETURN(frames_[missing[i]], std::move(loaded[i]));
    }
    return absl::OkStatus();
  }

  // Null if it is not there.
  const LoadedFrame* Find(int frame) const {
    const auto found = frames_.find(frame);
    return found == frames_.end() ? nullptr : &found->second;
  }

 private:
  absl::StatusOr<LoadedFrame> Load(int frame) const {
    LoadedFrame loaded;
    ASSIGN_OR_RETURN(loaded.depth_m, ReadDepth(input_, frame));
    absl::StatusOr<Image<Rgb8>> color = input_.recording->Color(frame);
    if (absl::IsNotFound(color.status())) return LostError("color", frame);  // the recording was whole
    ASSIGN_OR_RETURN(loaded.color, std::move(color));
    if (!loaded.color.view().SameSize(loaded.depth_m.view()))
      return absl::DataLossError(absl::StrFormat(
          "frame %d: colour is %d x %d pixels, its depth %d x %d: they must agree", frame, loaded.color.width(),
          loaded.color.height(), loaded.depth_m.width(), loaded.depth_m.height()));
    if (reach_ == 0) return loaded;
    ASSIGN_OR_RETURN(loaded.motion, ReadMotion(input_, frame));
    if (!loaded.motion.next.empty() && !loaded.motion.next.view().SameSize(loaded.depth_m.view()))
      return absl::DataLossError(absl::StrFormat("frame %d: its motion is of another size than its depth", frame));
    return loaded;
  }

  const RenderInput& input_;
  const int reach_;
  std::map<int, LoadedFrame> frames_;
};

// Frames that see what an edge hides, with the motion composed from neighbour to neighbour that leads there.
struct Neighbors {
  std::vector<Image<Flow2>> motions;
  std::vector<NeighborFrame> frames;
};

Neighbors FindNeighbors(const FrameWindow& window, int centre, int threads) {
  std::array<Image<Flow2>, kNeighborOffsets.size()> motions;
  // Forward and backward.
  ParallelFor(2, std::min(threads, 2), [&](int side) {
    const int direction = side == 0 ? 1 : -1;
    Image<Flow2> motion;
    for (int step = 1; step <= kRenderReachFrames; ++step) {
      const int from = centre + direction * (step - 1);
      const LoadedFrame* frame = window.Find(direction > 0 ? from : from - 1);
      if (frame == nullptr || window.Find(from + direction) == nullptr) return;
      const Image<Flow2>& onward = direction > 0 ? frame->motion.next : frame->motion.back;
      if (onward.empty()) return;
      motion = step == 1 ? onward.Clone() : Compose(motion, onward);
      for (size_t k = 0; k < kNeighborOffsets.size(); ++k)
        if (kNeighborOffsets[k] == direction * step) motions[k] = motion.Clone();
    }
  });
  Neighbors neighbors;
  neighbors.motions.reserve(motions.size());
  for (size_t k = 0; k < motions.size(); ++k) {
    if (motions[k].empty()) continue;
    const Image<Flow2>& motion = neighbors.motions.emplace_back(std::move(motions[k]));
    neighbors.frames.push_back({.view = window.Find(centre + kNeighborOffsets[k])->view(), .motion = motion});
  }
  return neighbors;
}

json FocusToJson(const FocusPoint& point) {
  return {{"frame", point.frame}, {"x", point.x}, {"y", point.y}, {"depth_m", point.depth_m}};
}

FocusPoint FocusFromJson(const json& value) {
  return {.frame = value.at("frame"), .x = value.at("x"), .y = value.at("y"), .depth_m = value.at("depth_m")};
}

// What both products do alike: the window, the neighbours, the time.
class WindowRenderer : public ClipRenderer {
 public:
  WindowRenderer(RenderInput input, int reach) : input_(std::move(input)), reach_(reach) {}

  absl::StatusOr<RenderPart> Run(int first, int count, const RenderPart* near, int threads, std::stop_token stop,
                                 const PictureSink& sink) override {
    const int frame_count = static_cast<int>(input_.recording->sequence().color.size());
    if (first < 0 || count < 1 || first >= frame_count || count > frame_count - first)
      return absl::InvalidArgumentError(absl::StrFormat(
          "%d frames from frame %d on are not there: this clip has frames 0 to %d", count, first, frame_count - 1));
    const auto start = Clock::now();
    RenderPart part = {.first_frame = first, .frames = count};
    RETURN_IF_ERROR(Begin(first, count, near, stop, part));
    FrameWindow window(input_, reach_);
    for (int frame = first; frame < first + count; ++frame) {
      if (stop.stop_requested()) return absl::CancelledError("stopped");
      RETURN_IF_ERROR(window.MoveTo(frame, threads));
      const Neighbors neighbors = reach_ > 0 ? FindNeighbors(window, frame, threads) : Neighbors();
      ASSIGN_OR_RETURN(std::vector<Image<Rgb8>> pictures,
                       RenderOne(frame, window.Find(frame)->view(), neighbors.frames, threads, part));
      RETURN_IF_ERROR(sink(frame, std::move(pictures)));
      if (input_.on_item) input_.on_item();
    }
    part.seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return part;
  }

 protected:
  // Before the frames of a part.
  virtual absl::Status Begin(int first, int count, const RenderPart* near, const std::stop_token& stop,
                             RenderPart& part) {
    return absl::OkStatus();
  }
  virtual absl::StatusOr<std::vector<Image<Rgb8>>> RenderOne(int frame, const RenderView& view,
                                                             const std::vector<NeighborFrame>& neighbors, int threads,
                                                             RenderPart& part) = 0;

  const RenderInput input_;

 private:
  const int reach_;
};

class DepthOfFieldRenderer : public WindowRenderer {
 public:
  DepthOfFieldRenderer(const DepthOfFieldRender& options, RenderInput input, int reach, std::string focus_path)
      : WindowRenderer(std::move(input), reach), options_(options), focus_path_(std::move(focus_path)) {}

  // A focus that one frame decides for all.
  absl::Status FixFocus() {
    const Camera& camera = input_.recording->sequence().camera;
    if (const auto* depth = std::get_if<FocusDepth>(&options_.focus)) fixed_focus_m_ = depth->depth_m;
    if (std::holds_alternative<FocusMedian>(options_.focus)) fixed_focus_m_ = input_.constants.median_depth_m;
    if (const auto* pixel = std::get_if<FocusPixel>(&options_.focus)) {
      ASSIGN_OR_RETURN(const FocusPoint point, StartAt(*pixel, focus_path_ + ".pixel"));
      fixed_focus_m_ = point.depth_m;
    }
    if (!fixed_focus_m_) return absl::OkStatus();
    const absl::Status fits = MakeCircleOfConfusion(camera, options_.lens, *fixed_focus_m_).status();
    return fits.ok() ? fits : FieldError(focus_path_, absl::StrCat("leads to ", fits.message()));
  }

  json Report(const std::vector<RenderPart>& parts) const override {
    double near_m = std::numeric_limits<double>::infinity(), far_m = 0;
    for (const RenderPart& part : parts)
      near_m = std::min(near_m, part.focus_near_m), far_m = std::max(far_m, part.focus_far_m);
    return {{"focus_near_m", near_m}, {"focus_far_m", far_m}};
  }

 protected:
  absl::Status Begin(int first, int count, const RenderPart* near, const std::stop_token& stop,
                     RenderPart& part) override {
    followed_.clear();
    const auto* track = std::get_if<FocusTrack>(&options_.focus);
    if (track == nullptr) return absl::OkStatus();
    FocusPoint point;
    const int start = track->start.frame;
    if (near != nullptr && near->last_focus && near->last_focus->frame == first - 1 && start <= first - 1) {
      point = *near->last_focus;
    } else if (near != nullptr && near->first_focus && near->first_focus->frame == first + count &&
               start >= first + count) {
      point = *near->first_focus;
    } else {
      ASSIGN_OR_RETURN(point, StartAt(track->start, focus_path_ + ".track"));
    }
    // From where it stands to both ends of the part.
    followed_[point.frame] = point;
    const int last = first + count - 1;
    if (point.frame < last) RETURN_IF_ERROR(Follow(point, last, stop));
    if (point.frame > first) RETURN_IF_ERROR(Follow(point, first, stop));
    part.first_focus = followed_.at(first);
    part.last_focus = followed_.at(last);
    std::erase_if(followed_, [&](const auto& entry) { return entry.first < first || entry.first >= first + count; });
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<Image<Rgb8>>> RenderOne(int frame, const RenderView& view,
                                                     const std::vector<NeighborFrame>& neighbors, int threads,
                                                     RenderPart& part) override {
    const double focus_m = FocusOf(frame);
    ASSIGN_OR_RETURN(const CircleOfConfusion circle,
                     MakeCircleOfConfusion(input_.recording->sequence().camera, options_.lens, focus_m));
    part.focus_near_m = part.focus_near_m == 0 ? focus_m : std::min(part.focus_near_m, focus_m);
    part.focus_far_m = std::max(part.focus_far_m, focus_m);
    HiddenBackground hidden;
    if (options_.blur.method == DepthOfFieldMethod::kLayers)
      hidden = FindHiddenBackground(view, neighbors, {.reach_px = ReachPx(circle)}, threads);
    std::vector<Image<Rgb8>> pictures;
    pictures.push_back(RenderDepthOfField(view, hidden, circle, options_.blur, threads));
    return pictures;
  }

 private:
  absl::StatusOr<FocusPoint> StartAt(const FocusPixel& pixel, const std::string& path) const {
    ASSIGN_OR_RETURN(const Image<float> depth_m, ReadDepth(input_, pixel.frame));
    absl::StatusOr<FocusPoint> point = StartFocus(pixel, depth_m);
    if (!point.ok()) return FieldError(path, absl::StrCat("points at nothing: ", point.status().message()));
    return point;
  }

  // Enters every frame after `point` up to frame `last`, which may lie before it in time.
  absl::Status Follow(FocusPoint point, int last, const std::stop_token& stop) {
    ASSIGN_OR_RETURN(Image<float> depth_m, ReadDepth(input_, point.frame));
    const int step = last > point.frame ? 1 : -1;
    while (point.frame != last) {
      if (stop.stop_requested()) return absl::CancelledError("stopped");
      const int next = point.frame + step;
      ASSIGN_OR_RETURN(const FrameMotion motion, ReadMotion(input_, std::min(point.frame, next)));
      ASSIGN_OR_RETURN(Image<float> next_depth_m, ReadDepth(input_, next));
      point = FollowFocus(point, depth_m, step > 0 ? motion.next : motion.back, next, next_depth_m);
      followed_[point.frame] = point;
      depth_m = std::move(next_depth_m);
      if (input_.on_item) input_.on_item();
    }
    return absl::OkStatus();
  }

  double FocusOf(int frame) const {
    if (fixed_focus_m_) return *fixed_focus_m_;
    if (const auto* keys = std::get_if<FocusKeys>(&options_.focus)) return FocusDepthOf(*keys, frame);
    return followed_.at(frame).depth_m;
  }

  // What lies behind an edge matters as far as blur reaches.
  int ReachPx(const CircleOfConfusion& circle) const {
    const auto near_m = static_cast<float>(input_.constants.preview_near_m);
    const auto far_m = static_cast<float>(input_.constants.preview_far_m);
    const float radius = std::max(std::abs(circle.RadiusPx(near_m)), std::abs(circle.RadiusPx(far_m)));
    const double cut = std::min<double>(radius, options_.blur.max_radius_px);
    return std::clamp(static_cast<int>(std::ceil(cut)) + 1, 2, 256);
  }

  const DepthOfFieldRender options_;
  const std::string focus_path_;
  std::optional<double> fixed_focus_m_;
  std::map<int, FocusPoint> followed_;  // by frame
};

class StereoRenderer : public WindowRenderer {
 public:
  StereoRenderer(const StereoRender& options, RenderInput input, int reach, StereoGeometry geometry)
      : WindowRenderer(std::move(input), reach), options_(options), geometry_(geometry) {}

  json Report(const std::vector<RenderPart>& parts) const override {
    ComfortStatistics comfort;
    for (const RenderPart& part : parts)
      if (part.comfort) comfort.Merge(*part.comfort);
    return {{"baseline_m", geometry_.baseline_m},
            {"convergence_m", geometry_.convergence_m},
            {"window_px", geometry_.window_px},
            {"comfort", comfort.Report(options_.screen).ToJson()}};
  }

 protected:
  absl::StatusOr<std::vector<Image<Rgb8>>> RenderOne(int frame, const RenderView& view,
                                                     const std::vector<NeighborFrame>& neighbors, int threads,
                                                     RenderPart& part) override {
    const HiddenBackground hidden = FindHiddenBackground(view, neighbors, geometry_.background, threads);
    const StereoPair pair = RenderStereo(view, hidden, geometry_, options_.eyes, threads);
    if (!part.comfort) part.comfort.emplace();
    part.comfort->AddFrame(view.depth_m, geometry_);
    return PackStereo(options_.format, pair);
  }

 private:
  const StereoRender options_;
  const StereoGeometry geometry_;
};

absl::StatusOr<StereoGeometry> Geometry(const StereoRender& stereo, const Sequence& sequence,
                                        const ClipConstants& constants, const std::string& path) {
  const absl::StatusOr<StereoGeometry> geometry =
      ResolveStereo(sequence.camera, stereo.eyes,  // the range of previews without its margin: the percentiles
                    {.near_m = constants.preview_near_m / (1 - kPreviewMargin),
                     .far_m = constants.preview_far_m / (1 + kPreviewMargin),
                     .median_m = constants.median_depth_m});
  if (!geometry.ok()) return InObject(path + ".stereo", geometry.status());
  return geometry;
}

}  // namespace

absl::Status LostError(std::string_view what, int frame) {
  const std::string name(what);
  absl::Status status = absl::DataLossError(absl::StrFormat("the %s of frame %d was made, but is lost", name, frame));
  status.SetPayload(kLostPayload, absl::Cord(json({{"what", name}, {"frame", frame}}).dump()));
  return status;
}

json LostOf(const absl::Status& status) {
  const auto lost = status.GetPayload(kLostPayload);
  return lost ? json::parse(std::string(*lost)) : json();
}

json ToJson(const RenderPart& part) {
  json value = {{"first_frame", part.first_frame},
                {"frames", part.frames},
                {"seconds", part.seconds},
                {"focus_near_m", part.focus_near_m},
                {"focus_far_m", part.focus_far_m}};
  if (part.first_focus) value["first_focus"] = FocusToJson(*part.first_focus);
  if (part.last_focus) value["last_focus"] = FocusToJson(*part.last_focus);
  if (part.comfort) value["comfort"] = part.comfort->ToJson();
  return value;
}

absl::StatusOr<RenderPart> ParseRenderPart(std::string_view text) {
  try {
    const json value = json::parse(text);
    RenderPart part = {.first_frame = value.at("first_frame"),
                       .frames = value.at("frames"),
                       .seconds = value.at("seconds"),
                       .focus_near_m = value.at("focus_near_m"),
                       .focus_far_m = value.at("focus_far_m")};
    if (value.contains("first_focus")) part.first_focus = FocusFromJson(value.at("first_focus"));
    if (value.contains("last_focus")) part.last_focus = FocusFromJson(value.at("last_focus"));
    if (value.contains("comfort")) {
      ASSIGN_OR_RETURN(part.comfort, ComfortStatistics::FromJson(value.at("comfort")));
    }
    return part;
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("part of a render: ", error.what()));
  }
}

absl::Status CheckRender(const RenderOptions& options, const Sequence& sequence, const ClipConstants& constants,
                         const std::string& path) {
  RETURN_IF_ERROR(PlanRender(options, sequence, path).status());
  const auto* stereo = std::get_if<StereoRender>(&options.product);
  return stereo == nullptr ? absl::OkStatus() : Geometry(*stereo, sequence, constants, path).status();
}

absl::StatusOr<std::unique_ptr<ClipRenderer>> ClipRenderer::Create(const RenderOptions& options,
                                                                   const RenderInput& input, const std::string& path) {
  const Sequence& sequence = input.recording->sequence();
  ASSIGN_OR_RETURN(const RenderPlan plan, PlanRender(options, sequence, path));
  if (const auto* blur = std::get_if<DepthOfFieldRender>(&options.product)) {
    auto renderer =
        std::make_unique<DepthOfFieldRenderer>(*blur, input, plan.reach_frames, path + ".depth_of_field.focus");
    RETURN_IF_ERROR(renderer->FixFocus());
    return renderer;
  }
  const auto& stereo = std::get<StereoRender>(options.product);
  ASSIGN_OR_RETURN(const StereoGeometry geometry, Geometry(stereo, sequence, input.constants, path));
  return std::make_unique<StereoRenderer>(stereo, input, plan.reach_frames, geometry);
}

absl::StatusOr<std::string> EncodePicture(ImageView<const Rgb8> picture, FrameFormat format) {
  return format == FrameFormat::kPng ? EncodePngRgb8(picture) : EncodeJpeg(picture);
}

absl::StatusOr<PictureFolders> PictureFolders::Create(const std::string& dir, const RenderOptions& options,
                                                      const RenderPlan& plan) {
  PictureFolders folders;
  folders.dir_ = dir;
  folders.format_ = options.frame_format;
  folders.plan_ = plan;
  for (const std::string& stream : plan.streams) RETURN_IF_ERROR(MakeFolder(JoinPath(dir, stream)));
  return folders;
}

std::string PictureFolders::PictureFile(size_t stream, const std::string& stem) const {
  return JoinPath(dir_, absl::StrCat(plan_.streams[stream], "/", stem, ".", plan_.extension));
}

absl::Status PictureFolders::Write(const std::string& stem, const std::vector<Image<Rgb8>>& pictures) const {
  for (size_t i = 0; i < pictures.size(); ++i) {
    ASSIGN_OR_RETURN(const std::string bytes, EncodePicture(pictures[i], format_));
    RETURN_IF_ERROR(WriteFileDurably(PictureFile(i, stem), bytes));
  }
  return absl::OkStatus();
}

absl::StatusOr<PictureVideos> PictureVideos::Create(const std::vector<std::string>& files, const RenderOptions& options,
                                                    const Sequence& sequence) {
  PictureVideos videos;
  videos.files_ = files;
  videos.options_ = VideoOptionsOf(options, *options.container);
  std::vector<int64_t> stamps;
  for (const FrameRef& frame : sequence.color) stamps.push_back(frame.time_ns);
  videos.clock_ = ClockOf(stamps);
  videos.options_.frame_rate = videos.clock_.rate;
  videos.options_.tick_rate = videos.clock_.tick_rate;
  return videos;
}

absl::Status PictureVideos::Write(int frame, const std::vector<Image<Rgb8>>& pictures) {
  for (size_t i = 0; i < pictures.size(); ++i) {
    if (videos_.size() == i) {
      options_.width = pictures[i].width();
      options_.height = pictures[i].height();
      ASSIGN_OR_RETURN(VideoWriter video, VideoWriter::Create(files_[i], options_));
      videos_.push_back(std::move(video));
    }
    RETURN_IF_ERROR(videos_[i].Write(pictures[i], clock_.ticks[frame]));
  }
  return absl::OkStatus();
}

absl::Status PictureVideos::Finish() {
  for (VideoWriter& video : videos_) RETURN_IF_ERROR(video.Finish());
  return absl::OkStatus();
}

absl::Status AssembleVideos(const std::string& dir, const RenderOptions& options, const RenderPlan& plan,
                            const Sequence& sequence, std::stop_token stop, const std::function<void(int)>& on_frame) {
  if (plan.videos.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const PictureFolders folders, PictureFolders::Create(dir, options, plan));
  std::vector<std::string> files;
  for (const std::string& video : plan.videos) files.push_back(JoinPath(dir, video));
  ASSIGN_OR_RETURN(PictureVideos videos, PictureVideos::Create(files, options, sequence));
  for (size_t frame = 0; frame < sequence.color.size(); ++frame) {
    if (stop.stop_requested()) return absl::CancelledError("stopped");
    std::vector<Image<Rgb8>> pictures;
    for (size_t i = 0; i < plan.streams.size(); ++i) {
      ASSIGN_OR_RETURN(pictures.emplace_back(), ReadColor(folders.PictureFile(i, sequence.color[frame].Stem())));
    }
    RETURN_IF_ERROR(videos.Write(static_cast<int>(frame), pictures));
    if (on_frame) on_frame(static_cast<int>(frame));
  }
  return videos.Finish();
}

}  // namespace depthtween
