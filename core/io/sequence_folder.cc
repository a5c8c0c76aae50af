#include "core/io/sequence_folder.h"

#include <algorithm>
#include <array>
#include <mutex>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/io/color.h"
#include "core/io/file.h"
#include "core/io/folder_parts.h"
#include "core/io/frame_list.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sequence/camera_json.h"

namespace depthtween {
namespace {

constexpr char kColorList[] = "rgb.txt";
constexpr char kDepthList[] = "depth.txt";
constexpr char kCameraFile[] = "camera.json";

// Where indoor depth cameras look, with room to spare: the Kinect v2 sees 0.5 to 4.5 m, RealSense from 0.1 m.
constexpr double kMinPlausibleMedianM = 0.1;
constexpr double kMaxPlausibleMedianM = 30.0;

Sequence ReadHeader(const std::string& dir, ViolationList& violations) {
  Sequence sequence;
  const CameraFile camera_file = ReadCameraPart(dir, violations);
  sequence.camera = camera_file.camera;
  sequence.depth_scale = camera_file.depth_scale;
  sequence.color = ReadListPart(dir, kColorList, violations);
  sequence.depth = ReadListPart(dir, kDepthList, violations);
  return sequence;
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

template <typename T>
absl::Status CheckSize(const Image<T>& image, const Camera& camera) {
  if (image.width() == camera.width && image.height() == camera.height) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("is %d x %d pixels, camera.json says %d x %d: they must agree",
                                                    image.width(), image.height(), camera.width, camera.height));
}

absl::StatusOr<Image<Rgb8>> LoadColor(const std::string& dir, const std::string& name, const ImageLimits& limits = {}) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(JoinPath(dir, name)));
  return DecodeColor(bytes, limits);
}

absl::StatusOr<Image<uint16_t>> LoadDepth(const std::string& dir, const std::string& name,
                                          const ImageLimits& limits = {}) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(JoinPath(dir, name)));
  absl::StatusOr<Image<uint16_t>> units = DecodePng16(bytes, limits);
  if (absl::IsInvalidArgument(units.status()))
    return absl::InvalidArgumentError(
        absl::StrCat(units.status().message(), ": store depth as whole numbers, depth_scale of them per metre"));
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
    for (size_t value = 1; value < counts_.size(); ++value) known += counts_[value];
    int64_t below = 0;
    for (size_t value = 1; value < counts_.size(); ++value) {
      below += counts_[value];
      if (2 * below >= known && known > 0) return static_cast<int>(value);
    }
    return 0;
  }

 private:
  std::vector<int64_t> counts_ = std::vector<int64_t>(65536);
};

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
  Sequence sequence = ReadHeader(dir, violations);
  if (!violations.empty()) return WithContext(violations.ToStatus(), dir);
  return sequence;
}

absl::StatusOr<SequenceCheck> CheckSequenceFolder(const std::string& dir, const CheckOptions& options) {
  RETURN_IF_ERROR(CheckFolder(dir));
  SequenceCheck check;
  ViolationList violations;
  check.sequence = ReadHeader(dir, violations);
  const bool camera_was_read = !violations.Contains(kCameraFile);
  AddSequenceViolations(check.sequence, violations);

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
  const auto explain = [&](const absl::Status& status) {
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
  return check;
}

std::optional<std::string> ImplausibleDepthScale(double median_depth_m, double depth_scale) {
  if (median_depth_m <= 0 || (median_depth_m >= kMinPlausibleMedianM && median_depth_m <= kMaxPlausibleMedianM))
    return std::nullopt;
  const std::string found =
      absl::StrFormat("depth_scale = %g is implausible: the median depth would be %.4g m", depth_scale, median_depth_m);
  const double median_units = median_depth_m * depth_scale;
  // What cameras and datasets use: millimetres (most), TUM RGB-D, tenths of a millimetre, RealSense L515, KITTI,
  // centimetres.
  for (const double scale : {1000.0, 5000.0, 10000.0, 4000.0, 256.0, 100.0}) {
    const double median_m = median_units / scale;
    if (median_m >= 0.3 && median_m <= 10.0)
      return absl::StrFormat("%s; %g units per metre would make it %.4g m", found, scale, median_m);
  }
  return absl::StrCat(found, "; check how many units a metre has");
}

absl::StatusOr<std::unique_ptr<SequenceFolder>> SequenceFolder::Open(const std::string& dir) {
  RETURN_IF_ERROR(CheckFolder(dir));
  ViolationList violations;
  Sequence sequence = ReadHeader(dir, violations);
  AddSequenceViolations(sequence, violations);
  if (!violations.empty()) return WithContext(violations.ToStatus(), dir);
  return std::unique_ptr<SequenceFolder>(new SequenceFolder(dir, std::move(sequence)));
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
  return DequantiseDepth(*units, sequence_.depth_scale);
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
