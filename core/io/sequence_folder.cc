#include "core/io/sequence_folder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numeric>
#include <type_traits>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/io/color.h"
#include "core/io/file.h"
#include "core/io/folder_parts.h"
#include "core/io/foreign_folder.h"
#include "core/io/frame_list.h"
#include "core/io/image_kind.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sequence/camera_json.h"
#include "core/sequence/clock.h"
#include "core/sequence/depth_scale.h"

namespace depthtween {
namespace {

constexpr char kColorList[] = "rgb.txt";
constexpr char kDepthList[] = "depth.txt";
constexpr char kCameraFile[] = "camera.json";
constexpr std::array<const char*, 3> kParts = {kCameraFile, kColorList, kDepthList};

// Depth frames that are read to tell what the whole recording is like.
constexpr int kFramesLookedAt = 64;

struct Header {
  Sequence sequence;
  std::vector<std::string> warnings;
};

std::string UnitWarning(const char* list_name, const FrameList& list) {
  return absl::StrFormat(
      "%s: its time stamps are taken for %s, a frame every %.4g ms; results are in seconds. A line '# unit: s' (ms, "
      "us, "
      "ns) at the top of a list says its unit",
      list_name, std::string(LongName(list.unit)), 1e-6 * static_cast<double>(MedianPeriodNs(list.frames)));
}

// Depth is read in the unit that goes with colour; what was assumed is said.
void SettleUnits(const FrameList& color, FrameList& depth, ViolationList& violations,
                 std::vector<std::string>& warnings) {
  if (!depth.unit_is_said) {
    const absl::Status status = SetTimeUnit(GuessDepthTimeUnit(color.stamps, color.unit, depth.stamps), depth);
    if (!status.ok()) violations.Add(kDepthList, status);
  }
  const auto say = [&](const char* name, const FrameList& list) {
    if (!list.unit_is_said && list.unit != TimeUnit::kSeconds) warnings.push_back(UnitWarning(name, list));
  };
  say(kColorList, color);
  say(kDepthList, depth);
}

Header ReadHeader(const std::string& dir, ViolationList& violations) {
  Header header;
  CameraFile camera_file = ReadCameraPart(dir, violations);
  header.warnings = std::move(camera_file.warnings);
  for (std::string& doubt : camera_file.camera.Doubts()) header.warnings.push_back(std::move(doubt));
  FrameList color = ReadListPart(dir, kColorList, violations);
  FrameList depth = ReadListPart(dir, kDepthList, violations);
  const bool part_missing =
      std::any_of(kParts.begin(), kParts.end(), [&](const char* part) { return !FileExists(JoinPath(dir, part)); });
  if (part_missing) {
    if (const auto found = DescribeForeignFolder(dir)) {
      const auto* missing = std::find_if(kParts.begin(), kParts.end(),
                                         [&](const char* part) { return !FileExists(JoinPath(dir, part)); });
      violations.Add(*missing, absl::NotFoundError(*found));
    }
  }
  SettleUnits(color, depth, violations, header.warnings);
  header.sequence = {.camera = camera_file.camera,
                     .depth_scale = camera_file.depth_scale,
                     .color = std::move(color.frames),
                     .depth = std::move(depth.frames)};
  return header;
}

// Violations(sequence), each under the file it is about. A file that could not be read is not blamed for what is
// missing.
void AddSequenceViolations(const Sequence& sequence, ViolationList& violations) {
  const bool camera_unread = violations.Contains(kCameraFile);
  const bool color_unread = violations.Contains(kColorList) && sequence.color.empty();
  const bool depth_unread = violations.Contains(kDepthList) && sequence.depth.empty();
  for (const absl::Status& status : Violations(sequence)) {
    const std::string_view message(status.message().data(), status.message().size());
    if (message.starts_with("camera.")) {
      if (!camera_unread) violations.Add(kCameraFile, status);
    } else if (message.starts_with(kColorList)) {
      if (!color_unread) violations.Add(kColorList, status);
    } else if (!depth_unread) {
      violations.Add(kDepthList, status);
    }
  }
}

// How depth of another size comes onto colour's pixels.
std::string DepthSizeAdvice(int width, int height, const Camera& camera) {
  const double ratio_x = static_cast<double>(camera.width) / width;
  const double ratio_y = static_cast<double>(camera.height) / height;
  const bool same_shape = std::abs(ratio_x - ratio_y) < 0.02 * ratio_x;
  std::string text =
      absl::StrFormat("Colour is %.4g times as wide and %.4g times as high as depth. ", ratio_x, ratio_y);
  if (same_shape)
    absl::StrAppendFormat(
        &text,
        "If depth is registered to colour and only of another resolution, resize it to the nearest pixel (anything "
        "else "
        "invents depth between surfaces), and leave camera.json as it is: `python3 -c \"import cv2,glob; "
        "[cv2.imwrite(f, cv2.resize(cv2.imread(f,-1), (%d,%d), interpolation=cv2.INTER_NEAREST)) for f in "
        "glob.glob('depth/*.png')]\"`. If it is as the depth camera saw it, register it: ",
        camera.width, camera.height);
  else
    absl::StrAppend(&text, "Another shape of image means that depth is as the depth camera saw it. Register it: ");
  absl::StrAppend(
      &text,
      "take each pixel to a point by the depth camera's intrinsics, move it by the pose between the cameras, "
      "project it by the fx, fy, cx, cy of camera.json, and keep the nearest point of each pixel (librealsense "
      "rs.align, k4a_transformation, OpenCV rgbd.registerDepth do so)");
  return text;
}

std::string ColorSizeAdvice(int width, int height, const Camera& camera) {
  return absl::StrFormat(
      "If these are the images, set width and height to theirs and scale fx and cx by %.4g, fy and cy by %.4g where "
      "the "
      "intrinsics are of the other size",
      static_cast<double>(width) / camera.width, static_cast<double>(height) / camera.height);
}

template <typename T>
absl::Status CheckSize(const Image<T>& image, const Camera& camera) {
  if (image.width() == camera.width && image.height() == camera.height) return absl::OkStatus();
  constexpr bool kIsDepth = std::is_same_v<T, uint16_t>;
  return absl::InvalidArgumentError(
      absl::StrCat(absl::StrFormat("is %d x %d pixels, camera.json says %d x %d: they must agree. ", image.width(),
                                   image.height(), camera.width, camera.height),
                   kIsDepth ? DepthSizeAdvice(image.width(), image.height(), camera)
                            : ColorSizeAdvice(image.width(), image.height(), camera)));
}

absl::StatusOr<Image<Rgb8>> LoadColor(const std::string& dir, const std::string& name, const ImageLimits& limits = {}) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(JoinPath(dir, name)));
  return DecodeColor(bytes, limits);
}

absl::StatusOr<Image<uint16_t>> LoadDepth(const std::string& dir, const std::string& name,
                                          const ImageLimits& limits = {}) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(JoinPath(dir, name)));
  if (!LooksLikePng(bytes) && !ImageKind(bytes).empty()) return NotADepthImage(bytes);
  absl::StatusOr<Image<uint16_t>> units = DecodePng16(bytes, limits);
  if (absl::IsInvalidArgument(units.status()))
    return absl::InvalidArgumentError(absl::StrCat(
        units.status().message(),
        ": store depth as whole numbers, depth_scale of them per metre. 8 bits or colours are a picture of depth for "
        "viewing, from which it cannot be read back: export the sensor's values as 16-bit grey"));
  return units;
}

// How often each stored depth value occurs; exact medians of any number of frames.
class DepthHistogram {
 public:
  void Add(ImageView<const uint16_t> units) {
    for (int y = 0; y < units.height(); ++y) {
      for (int x = 0; x < units.width(); ++x) ++counts_[units(x, y)];
    }
  }
  // 0 when nothing is known.
  int Median() const {
    int64_t known = 0;
    for (size_t value = 1; value < kLargestDepthUnits; ++value) known += counts_[value];
    int64_t below = 0;
    for (size_t value = 1; value < kLargestDepthUnits; ++value) {
      below += counts_[value];
      if (2 * below >= known && known > 0) return static_cast<int>(value);
    }
    return 0;
  }
  int64_t Pixels() const { return std::accumulate(counts_.begin(), counts_.end(), int64_t{0}); }
  int64_t Largest() const { return counts_[kLargestDepthUnits]; }

 private:
  std::vector<int64_t> counts_ = std::vector<int64_t>(65536);
};

// Says how many pixels hold the largest code, if any do.
std::optional<std::string> LargestCodeWarning(int64_t largest, int64_t pixels, int frames) {
  if (largest == 0) return std::nullopt;
  return absl::StrFormat(
      "%.2g %% of the pixels of %d depth frame%s hold 65535, the largest number that 16 bits hold: nothing was "
      "measured "
      "there, or a depth did not fit. They are taken for unknown; store 0 instead",
      100.0 * static_cast<double>(largest) / static_cast<double>(pixels), frames, frames == 1 ? "" : "s");
}

absl::Status CheckWriterSize(int width, int height, const Camera& camera) {
  if (width == camera.width && height == camera.height) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("image is %d x %d pixels, must be the camera's %d x %d", width,
                                                    height, camera.width, camera.height));
}

std::string TruthName(const std::string& stem) { return absl::StrCat("gt/depth/", stem, ".png"); }

}  // namespace

absl::StatusOr<Sequence> ReadSequenceHeader(const std::string& dir) {
  RETURN_IF_ERROR(CheckFolder(dir));
  ViolationList violations;
  Header header = ReadHeader(dir, violations);
  if (!violations.empty()) return WithContext(violations.ToStatus(), dir);
  return std::move(header.sequence);
}

absl::StatusOr<SequenceCheck> CheckSequenceFolder(const std::string& dir, const CheckOptions& options) {
  RETURN_IF_ERROR(CheckFolder(dir));
  SequenceCheck check;
  ViolationList violations;
  Header header = ReadHeader(dir, violations);
  check.sequence = std::move(header.sequence);
  check.warnings = std::move(header.warnings);
  const bool camera_was_read = !violations.Contains(kCameraFile);
  AddSequenceViolations(check.sequence, violations);
  if (violations.empty())
    if (const absl::Status overlap = CheckOverlap(check.sequence); !overlap.ok())
      check.warnings.emplace_back(overlap.message());

  struct Frame {
    const std::string* name;
    bool is_depth;
    absl::Status status;
  };
  std::vector<Frame> frames;
  for (const FrameRef& frame : check.sequence.color)
    if (!violations.Contains(frame.path)) frames.push_back({&frame.path, /*is_depth=*/false, {}});
  for (const FrameRef& frame : check.sequence.depth)
    if (!violations.Contains(frame.path)) frames.push_back({&frame.path, /*is_depth=*/true, {}});

  // What a frame may hold, from what is known before any is decoded.
  const Camera& camera = check.sequence.camera;
  const auto frame_count = static_cast<int64_t>(frames.size());
  ImageLimits limits;
  if (camera_was_read && camera.Validate().ok()) {
    const int64_t pixels = int64_t{camera.width} * camera.height;
    if (frame_count > options.max_pixels / pixels) {
      violations.Add(kCameraFile, absl::ResourceExhaustedError(absl::StrFormat(
                                      "%d frames of %d x %d pixels are %.4g pixels, at most %.4g are allowed in a "
                                      "sequence: cut it into parts, or scale it down",
                                      frame_count, camera.width, camera.height,
                                      static_cast<double>(frame_count) * static_cast<double>(pixels),
                                      static_cast<double>(options.max_pixels))));
      frames.clear();
    }
    limits.max_pixels = std::min(limits.max_pixels, pixels);
  } else if (frame_count > 0) {
    limits.max_pixels = std::min(limits.max_pixels, options.max_pixels / frame_count);
  }
  // A limit that the camera sets is told as such.
  const auto explain = [&](absl::Status status) {
    if (!camera_was_read || !absl::IsResourceExhausted(status)) return status;
    return WithContext(status,
                       absl::StrFormat("camera.json says %d x %d, and they must agree", camera.width, camera.height));
  };

  std::mutex mutex;
  DepthHistogram histogram;  // guarded by mutex
  int checked = 0;           // guarded by mutex
  const auto size_status = [&](const auto& image) {
    return camera_was_read ? CheckSize(image, check.sequence.camera) : absl::OkStatus();
  };
  ParallelFor(static_cast<int>(frames.size()), options.threads, [&](int i) {
    if (options.stop.stop_requested()) return;
    Frame& frame = frames[i];
    if (frame.is_depth) {
      const absl::StatusOr<Image<uint16_t>> units = LoadDepth(dir, *frame.name, limits);
      frame.status = units.ok() ? size_status(*units) : explain(units.status());
      if (units.ok()) {
        const std::lock_guard lock(mutex);
        histogram.Add(*units);
      }
    } else {
      const absl::StatusOr<Image<Rgb8>> color = LoadColor(dir, *frame.name, limits);
      frame.status = color.ok() ? size_status(*color) : explain(color.status());
    }
    const std::lock_guard lock(mutex);
    if (options.on_progress) options.on_progress(++checked, static_cast<int>(frames.size()));
  });
  if (options.stop.stop_requested()) return absl::CancelledError("checking the sequence was stopped");

  for (const Frame& frame : frames)
    if (!frame.status.ok()) violations.Add(*frame.name, frame.status);
  check.violations = violations.PerFile();
  if (!violations.Contains(kCameraFile)) {
    check.median_depth_m = histogram.Median() / check.sequence.depth_scale;
    if (const auto warning = ImplausibleDepthScale(check.median_depth_m, check.sequence.depth_scale))
      check.warnings.push_back(*warning);
  }
  const auto depth_frames = std::count_if(frames.begin(), frames.end(),
                                          [](const Frame& frame) { return frame.is_depth && frame.status.ok(); });
  if (auto warning = LargestCodeWarning(histogram.Largest(), histogram.Pixels(), static_cast<int>(depth_frames)))
    check.warnings.push_back(*std::move(warning));
  return check;
}

absl::StatusOr<std::unique_ptr<SequenceFolder>> SequenceFolder::Open(const std::string& dir) {
  RETURN_IF_ERROR(CheckFolder(dir));
  ViolationList violations;
  Header header = ReadHeader(dir, violations);
  AddSequenceViolations(header.sequence, violations);
  if (!violations.empty()) return WithContext(violations.ToStatus(), dir);
  return std::unique_ptr<SequenceFolder>(
      new SequenceFolder(dir, std::move(header.sequence), std::move(header.warnings)));
}

std::vector<std::string> SequenceFolder::Warnings(int threads) const {
  const int keys = static_cast<int>(sequence_.depth.size()), looked_at = std::min(keys, kFramesLookedAt);
  std::vector<int64_t> largest(looked_at), pixels(looked_at);
  ParallelFor(looked_at, threads, [&](int i) {
    const int key = looked_at == 1 ? 0 : static_cast<int>(static_cast<int64_t>(i) * (keys - 1) / (looked_at - 1));
    const absl::StatusOr<Image<uint16_t>> units = LoadDepth(dir_, sequence_.depth[key].path);
    if (!units.ok()) return;  // said when the frame is needed
    pixels[i] = static_cast<int64_t>(units->pixel_count());
    for (int y = 0; y < units->height(); ++y)
      largest[i] += std::count(units->row(y), units->row(y) + units->width(), kLargestDepthUnits);
  });
  std::vector<std::string> warnings = header_warnings_;
  if (auto warning = LargestCodeWarning(std::accumulate(largest.begin(), largest.end(), int64_t{0}),
                                        std::accumulate(pixels.begin(), pixels.end(), int64_t{0}), looked_at))
    warnings.push_back(*std::move(warning));
  return warnings;
}

absl::StatusOr<Image<Rgb8>> SequenceFolder::Color(int index) const {
  const std::string& name = sequence_.color.at(index).path;
  absl::StatusOr<Image<Rgb8>> color = LoadColor(dir_, name);
  if (!color.ok()) return WithContext(color.status(), name);
  if (absl::Status size = CheckSize(*color, sequence_.camera); !size.ok()) return WithContext(size, name);
  return color;
}

absl::StatusOr<Image<float>> SequenceFolder::Depth(int index) const {
  const std::string& name = sequence_.depth.at(index).path;
  const absl::StatusOr<Image<uint16_t>> units = LoadDepth(dir_, name);
  if (!units.ok()) return WithContext(units.status(), name);
  if (absl::Status size = CheckSize(*units, sequence_.camera); !size.ok()) return WithContext(size, name);
  return DequantiseRecordedDepth(*units, sequence_.depth_scale);
}

std::optional<std::string> GroundTruthDepthPath(const std::string& dir, const std::string& stem) {
  std::string path = JoinPath(dir, TruthName(stem));
  if (!FileExists(path)) return std::nullopt;
  return path;
}

absl::StatusOr<SequenceWriter> SequenceWriter::Create(const std::string& dir, const Camera& camera, double depth_scale,
                                                      const Options& options) {
  RETURN_IF_ERROR(camera.Validate());
  if (!(depth_scale > 0))
    return absl::InvalidArgumentError(
        absl::StrFormat("depth_scale = %g, must be positive: units per metre", depth_scale));
  for (const char* name : {kColorList, kDepthList, kCameraFile}) {
    if (FileExists(JoinPath(dir, name)))
      return absl::AlreadyExistsError(
          absl::StrCat(JoinPath(dir, name), " is there: the folder holds a sequence, choose another"));
  }
  for (const char* folder : {"rgb", "depth"}) RETURN_IF_ERROR(MakeFolder(JoinPath(dir, folder)));
  return SequenceWriter(dir, Sequence{.camera = camera, .depth_scale = depth_scale}, options);
}

absl::Status SequenceWriter::AddColor(int64_t time_ns, ImageView<const Rgb8> color) {
  RETURN_IF_ERROR(CheckWriterSize(color.width(), color.height(), sequence_.camera));
  const bool as_jpeg = options_.color_format == ColorFormat::kJpeg;
  ASSIGN_OR_RETURN(const std::string bytes, as_jpeg ? EncodeJpeg(color, options_.jpeg_quality) : EncodePngRgb8(color));
  std::string name = absl::StrFormat("rgb/%06d.%s", sequence_.color.size(), as_jpeg ? "jpg" : "png");
  RETURN_IF_ERROR(WriteFile(JoinPath(dir_, name), bytes));
  sequence_.color.push_back({time_ns, std::move(name)});
  return absl::OkStatus();
}

absl::Status SequenceWriter::AddDepth(int64_t time_ns, ImageView<const float> depth_m) {
  RETURN_IF_ERROR(CheckWriterSize(depth_m.width(), depth_m.height(), sequence_.camera));
  std::string name = absl::StrFormat("depth/%06d.png", sequence_.depth.size());
  RETURN_IF_ERROR(WritePng16(JoinPath(dir_, name), QuantiseDepth(depth_m, sequence_.depth_scale)));
  sequence_.depth.push_back({time_ns, std::move(name)});
  return absl::OkStatus();
}

absl::Status SequenceWriter::AddTruth(ImageView<const float> depth_m) {
  if (sequence_.color.empty())
    return absl::FailedPreconditionError("AddTruth before AddColor: there is no colour frame yet");
  RETURN_IF_ERROR(CheckWriterSize(depth_m.width(), depth_m.height(), sequence_.camera));
  RETURN_IF_ERROR(MakeFolder(JoinPath(dir_, "gt/depth")));
  return WritePng16(JoinPath(dir_, TruthName(sequence_.color.back().Stem())),
                    QuantiseDepth(depth_m, sequence_.depth_scale));
}

absl::Status SequenceWriter::Finish() {
  RETURN_IF_ERROR(Validate(sequence_));
  RETURN_IF_ERROR(WriteFile(JoinPath(dir_, kCameraFile), FormatCameraJson(sequence_.camera, sequence_.depth_scale)));
  RETURN_IF_ERROR(WriteFile(JoinPath(dir_, kColorList), FormatFrameList(sequence_.color)));
  return WriteFile(JoinPath(dir_, kDepthList), FormatFrameList(sequence_.depth));
}

}  // namespace depthtween
