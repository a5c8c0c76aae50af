#include "core/synthetic/synthetic_sequence.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/io/file.h"
#include "core/io/flow_png.h"
#include "core/io/frame_list.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/io/sequence_folder.h"

namespace depthtween {
namespace {

constexpr int kMaxFrames = 100000;
constexpr double kMaxFps = 100000.0;  // stamps are nanoseconds; beyond this neighbours come near to colliding
constexpr int kJpegQuality = 96;
// f = 365 px at 512 px width: the field of view of a Kinect v2's depth camera.
constexpr double kFocalPerWidth = 365.0 / 512.0;

int64_t ToNanoseconds(double seconds) { return std::llround(1e9 * seconds); }

// Writes the truth of a frame or of a pair of frames under the names of the sequence format.
class TruthWriter {
 public:
  explicit TruthWriter(std::string dir) : dir_(std::move(dir)) {}

  absl::Status MakeFolders() const {
    for (const char* folder :
         {"depth_clean", "gt/depth", "gt/flow", "gt/occ", "gt/object", "gt/flow_key", "gt/sceneflow_key"})
      RETURN_IF_ERROR(MakeFolder(JoinPath(dir_, folder)));
    return absl::OkStatus();
  }

  absl::Status WriteObjects(const Scene& scene) const {
    nlohmann::json objects = nlohmann::json::array();
    for (size_t i = 0; i < scene.bodies().size(); ++i)
      objects.push_back({{"index", i + 1}, {"name", scene.bodies()[i].name}, {"dynamic", scene.bodies()[i].moves}});
    return WriteFile(JoinPath(dir_, "gt/objects.json"), objects.dump(1) + "\n");
  }

  absl::Status WriteSurface(const std::string& stem, const SurfaceTruth& truth) const {
    RETURN_IF_ERROR(WritePng16(Path("gt/depth/", stem, ".png"), QuantiseDepth(truth.depth_m, kSyntheticDepthScale)));
    return WritePng8(Path("gt/object/", stem, ".png"), truth.object);
  }

  absl::Status WriteMotion(const std::string& stem, const MotionTruth& truth) const {
    RETURN_IF_ERROR(WriteFlowPng(Path("gt/flow/", stem, ".png"), truth.flow, truth.valid));
    return WritePng8(Path("gt/occ/", stem, ".png"), truth.occluded);
  }

  absl::Status WriteCleanDepth(const std::string& stem, const SurfaceTruth& truth) const {
    return WritePng16(Path("depth_clean/", stem, ".png"), QuantiseDepth(truth.depth_m, kSyntheticDepthScale));
  }

  // From key `from` to its neighbour `to`; scene flow goes with the forward direction.
  absl::Status WriteKeyMotion(const std::string& from, const std::string& to, const MotionTruth& truth,
                              bool forward) const {
    const std::string pair = absl::StrCat(from, "_", to);
    RETURN_IF_ERROR(
        WriteFlowPng(Path(forward ? "gt/flow_key/fwd_" : "gt/flow_key/bwd_", pair, ".png"), truth.flow, truth.valid));
    RETURN_IF_ERROR(WritePng8(Path("gt/flow_key/occ_", pair, ".png"), truth.occluded));
    if (!forward) return absl::OkStatus();
    const int64_t width = truth.scene_flow.width(), height = truth.scene_flow.height();
    std::vector<float> components;
    components.reserve(3 * truth.scene_flow.pixel_count());
    NpyArray valid{.type = ElementType::kBool, .shape = {height, width}};
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const Float3& s = truth.scene_flow(x, y);
        components.insert(components.end(), {s.x, s.y, s.z});
        valid.bytes.push_back(static_cast<char>(truth.valid(x, y)));
      }
    Npz arrays;
    arrays.emplace("sf", NpyArray::FromFloats({height, width, 3}, components, ElementType::kFloat16));
    arrays.emplace("valid", std::move(valid));
    return WriteNpz(Path("gt/sceneflow_key/", pair, ".npz"), arrays);
  }

  absl::Status WriteCleanList(const std::vector<FrameRef>& depth) const {
    std::vector<FrameRef> clean = depth;
    for (FrameRef& frame : clean) frame.path = absl::StrCat("depth_clean/", frame.Stem(), ".png");
    return WriteFile(JoinPath(dir_, "depth_clean.txt"), FormatFrameList(clean));
  }

 private:
  std::string Path(const char* prefix, const std::string& stem, const char* extension) const {
    return JoinPath(dir_, absl::StrCat(prefix, stem, extension));
  }

  const std::string dir_;
};

// Calls render(i) for i in [0, count) on up to `threads` threads, a few at a time, and add(i, result) in order on this
// one.
template <typename Result>
absl::Status InOrder(int count, const SyntheticWriteOptions& options,
                     const std::function<absl::StatusOr<Result>(int)>& render,
                     const std::function<absl::Status(int, Result)>& add) {
  for (int first = 0; first < count; first += options.threads) {
    if (options.stop.stop_requested()) return absl::CancelledError("stopped while rendering");
    const int batch = std::min(options.threads, count - first);
    std::vector<std::optional<absl::StatusOr<Result>>> results(batch);
    ParallelFor(batch, options.threads, [&](int i) { results[i].emplace(render(first + i)); });
    for (int i = 0; i < batch; ++i) {
      ASSIGN_OR_RETURN(Result result, std::move(*results[i]));
      RETURN_IF_ERROR(add(first + i, std::move(result)));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status SyntheticOptions::Validate() const {
  const auto error = [](const char* field, double value, const std::string& rule) {
    return absl::InvalidArgumentError(absl::StrFormat("SyntheticOptions.%s = %g, must be %s", field, value, rule));
  };
  if (frames < 1 || frames > kMaxFrames) return error("frames", frames, absl::StrCat("between 1 and ", kMaxFrames));
  if (!(color_fps > 0 && color_fps <= kMaxFps))
    return error("color_fps", color_fps, absl::StrFormat("above 0 and at most %g frames per second", kMaxFps));
  if (!(depth_fps > 0 && depth_fps <= color_fps))
    return error("depth_fps", depth_fps, absl::StrFormat("above 0 and at most color_fps (%g)", color_fps));
  const double last_color_s = (frames - 1) / color_fps;
  if (!(depth_phase_s >= 0 && depth_phase_s <= last_color_s))
    return error("depth_phase_s", depth_phase_s,
                 absl::StrFormat("between 0 and the time of the last colour frame (%g s)", last_color_s));
  if (width < 16 || width > 8192) return error("width", width, "between 16 and 8192 pixels");
  if (height < 16 || height > 8192) return error("height", height, "between 16 and 8192 pixels");
  if (!(std::abs(depth_clock.offset_s) <= 3600))
    return error("depth_clock.offset_s", depth_clock.offset_s, "within 3600 s");
  if (!(std::abs(depth_clock.drift_ppm) <= 1e5))
    return error("depth_clock.drift_ppm", depth_clock.drift_ppm, "within 100000");
  return sensor.Validate();
}

SyntheticSequence::SyntheticSequence(const SyntheticOptions& options, std::unique_ptr<const Scene> scene, int threads)
    : options_(options), scene_(std::move(scene)), threads_(threads) {
  const double focal = kFocalPerWidth * options.width;
  sequence_.camera = {.width = options.width,
                      .height = options.height,
                      .fx = focal,
                      .fy = focal,
                      .cx = 0.5 * (options.width - 1),
                      .cy = 0.5 * (options.height - 1)};
  sequence_.depth_scale = kSyntheticDepthScale;
  for (int i = 0; i < options.frames; ++i)
    sequence_.color.push_back({ToNanoseconds(i / options.color_fps), absl::StrFormat("rgb/%06d.jpg", i)});
  // A billionth of a second of grace, so that an exposure at the last colour frame's time is not lost to rounding.
  const double last_color_s = (options.frames - 1) / options.color_fps;
  for (int k = 0; DepthTime(k) <= last_color_s + 1e-9; ++k)
    sequence_.depth.push_back(
        {ToNanoseconds(options.depth_clock.Reading(DepthTime(k))), absl::StrFormat("depth/%06d.png", k)});
}

absl::StatusOr<std::unique_ptr<SyntheticSequence>> SyntheticSequence::Create(const SyntheticOptions& options,
                                                                             int threads) {
  RETURN_IF_ERROR(options.Validate());
  ASSIGN_OR_RETURN(std::unique_ptr<const Scene> scene, MakeScene(options.scene, options.seed));
  auto sequence = std::unique_ptr<SyntheticSequence>(new SyntheticSequence(options, std::move(scene), threads));
  RETURN_IF_ERROR(depthtween::Validate(sequence->sequence()));
  RETURN_IF_ERROR(CheckOverlap(sequence->sequence()));
  return sequence;
}

Image<Rgb8> SyntheticSequence::RecordedColor(const Renderer& view, int index) const {
  return MeasureColor(options_.sensor, view.Color(threads_), options_.seed, index);
}

Image<float> SyntheticSequence::RecordedDepth(const SurfaceTruth& truth, int index) const {
  return MeasureDepth(options_.sensor, truth, options_.seed, index);
}

absl::Status WriteSyntheticSequence(const SyntheticOptions& options, const std::string& dir,
                                    const SyntheticWriteOptions& write_options) {
  // Frames are rendered side by side, so each uses one thread.
  ASSIGN_OR_RETURN(const std::unique_ptr<SyntheticSequence> clip, SyntheticSequence::Create(options, 1));
  const Sequence& sequence = clip->sequence();
  ASSIGN_OR_RETURN(SequenceWriter writer, SequenceWriter::Create(dir, sequence.camera, sequence.depth_scale,
                                                                 {.color_format = SequenceWriter::ColorFormat::kJpeg,
                                                                  .jpeg_quality = kJpegQuality}));
  const TruthWriter truth(dir);
  if (write_options.truth) {
    RETURN_IF_ERROR(truth.MakeFolders());
    RETURN_IF_ERROR(truth.WriteObjects(clip->scene()));
  }
  const int color_count = static_cast<int>(sequence.color.size()), key_count = static_cast<int>(sequence.depth.size());
  int done = 0;
  const auto report = [&] {
    ++done;
    if (write_options.on_progress) write_options.on_progress(done, color_count + key_count);
  };

  const auto render_color = [&](int i) -> absl::StatusOr<Image<Rgb8>> {
    const Renderer view = clip->ColorView(i);
    if (write_options.truth) {
      RETURN_IF_ERROR(truth.WriteSurface(sequence.color[i].Stem(), view.Surface(1)));
      if (i + 1 < color_count)
        RETURN_IF_ERROR(truth.WriteMotion(sequence.color[i].Stem(), view.MotionTo(clip->ColorView(i + 1), 1)));
    }
    return clip->RecordedColor(view, i);
  };
  RETURN_IF_ERROR(InOrder<Image<Rgb8>>(color_count, write_options, render_color, [&](int i, Image<Rgb8> color) {
    report();
    return writer.AddColor(sequence.color[i].time_ns, color);
  }));

  const auto render_key = [&](int k) -> absl::StatusOr<Image<float>> {
    const Renderer view = clip->DepthView(k);
    const SurfaceTruth surface = view.Surface(1);
    if (write_options.truth) {
      const std::string stem = sequence.depth[k].Stem();
      RETURN_IF_ERROR(truth.WriteCleanDepth(stem, surface));
      if (k + 1 < key_count)
        RETURN_IF_ERROR(
            truth.WriteKeyMotion(stem, sequence.depth[k + 1].Stem(), view.MotionTo(clip->DepthView(k + 1), 1), true));
      if (k > 0)
        RETURN_IF_ERROR(
            truth.WriteKeyMotion(stem, sequence.depth[k - 1].Stem(), view.MotionTo(clip->DepthView(k - 1), 1), false));
    }
    return clip->RecordedDepth(surface, k);
  };
  RETURN_IF_ERROR(InOrder<Image<float>>(key_count, write_options, render_key, [&](int k, Image<float> depth) {
    report();
    return writer.AddDepth(sequence.depth[k].time_ns, depth);
  }));
  if (write_options.truth) RETURN_IF_ERROR(truth.WriteCleanList(sequence.depth));
  return writer.Finish();
}

}  // namespace depthtween
