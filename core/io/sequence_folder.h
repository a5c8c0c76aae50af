// The sequence folder: rgb/ depth/ rgb.txt depth.txt camera.json, and gt/depth/ beside them where truth is known.
//
// Files are named relative to the folder. A folder may come from a stranger: names that leave it, by `..`, an absolute
// path or a symbolic link, are refused; so is what is over a limit, before it costs memory.
#ifndef DEPTHTWEEN_CORE_IO_SEQUENCE_FOLDER_H_
#define DEPTHTWEEN_CORE_IO_SEQUENCE_FOLDER_H_

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/io/jpeg.h"
#include "core/io/violation_list.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// The lists and the camera, not yet validated (Validate(sequence) does that). The files listed exist; none is decoded.
// An error names every offending file (the first 20), and has the code of the first.
absl::StatusOr<Sequence> ReadSequenceHeader(const std::string& dir);

// What a full check found. `sequence` holds what could be read, violations or not.
struct SequenceCheck {
  Sequence sequence;
  std::vector<FileViolation> violations;  // one per offending file: camera.json, lists, then frames in their order
  std::vector<std::string>
      warnings;  // facts that are no violation, such as an implausible depth_scale, or clocks that do not meet
  double median_depth_m = 0.0;  // over all known pixels of all depth frames; 0 when there are none

  bool ok() const { return violations.empty(); }
};

struct CheckOptions {
  int threads = 1;
  // Of all frames together, colour and depth: more is a violation of camera.json, and no frame is decoded. Where the
  // camera is unknown, no frame may have more than an equal share. Frames are compressed, so that their bytes say
  // nothing: 20 GB of PNG can hold 20 terapixels.
  int64_t max_pixels = std::numeric_limits<int64_t>::max();
  std::stop_token stop = {};
  // Called after each decoded frame, from one thread at a time. May be empty.
  std::function<void(int checked, int total)> on_progress = nullptr;
};

// Reads the header, validates it, and decodes every frame: whole, of the right kind, of the camera's size. One that is
// larger than the camera's is refused by its header.
// Errors: NotFound when there is no such folder; Cancelled when `stop` fires. What is wrong inside it is no error of
// this function but its answer.
absl::StatusOr<SequenceCheck> CheckSequenceFolder(const std::string& dir, const CheckOptions& options = {});

// Frames decoded on demand.
class SequenceFolder : public FrameSource {
 public:
  // Reads the header and validates it.
  static absl::StatusOr<std::unique_ptr<SequenceFolder>> Open(const std::string& dir);

  const Sequence& sequence() const override { return sequence_; }
  const std::string& dir() const { return dir_; }
  // Errors name the file: what the decoder says, or InvalidArgument when its size is not the camera's.
  absl::StatusOr<Image<Rgb8>> Color(int index) const override;
  absl::StatusOr<Image<float>> Depth(int index) const override;
  // What lists and camera made it assume, and how many pixels hold the largest code, which Depth takes for unknown:
  // looks at 64 depth frames, spread over the recording.
  std::vector<std::string> Warnings(int threads) const override;

 private:
  SequenceFolder(std::string dir, Sequence sequence, std::vector<std::string> header_warnings)
      : dir_(std::move(dir)), sequence_(std::move(sequence)), header_warnings_(std::move(header_warnings)) {}

  const std::string dir_;
  const Sequence sequence_;
  const std::vector<std::string> header_warnings_;
};

// dir/gt/depth/<stem>.png, the exact depth of the colour frame of that stem; none when there is no such file.
std::optional<std::string> GroundTruthDepthPath(const std::string& dir, const std::string& stem);

// Writes a sequence folder.  Create (AddColor AddTruth? | AddDepth)* Finish  - each stream in ascending time; frames
// are numbered 000000, 000001, ... per stream. Without Finish the folder has no lists and is no sequence.
class SequenceWriter {
 public:
  enum class ColorFormat { kPng, kJpeg };
  struct Options {
    ColorFormat color_format = ColorFormat::kPng;
    int jpeg_quality = kDefaultJpegQuality;
  };

  // AlreadyExists when the folder holds a sequence. InvalidArgument when camera or scale do not validate.
  static absl::StatusOr<SequenceWriter> Create(const std::string& dir, const Camera& camera, double depth_scale,
                                               const Options& options);
  static absl::StatusOr<SequenceWriter> Create(const std::string& dir, const Camera& camera, double depth_scale) {
    return Create(dir, camera, depth_scale, Options());
  }

  // InvalidArgument when an image is not of the camera's size.
  absl::Status AddColor(int64_t time_ns, ImageView<const Rgb8> color);
  absl::Status AddDepth(int64_t time_ns, ImageView<const float> depth_m);
  // Exact depth of the colour frame added last, under gt/depth/. FailedPrecondition when there is none.
  absl::Status AddTruth(ImageView<const float> depth_m);
  // Writes lists and camera. InvalidArgument when what was added is no valid sequence.
  absl::Status Finish();

  const Sequence& sequence() const { return sequence_; }

 private:
  SequenceWriter(std::string dir, Sequence sequence, const Options& options)
      : dir_(std::move(dir)), sequence_(std::move(sequence)), options_(options) {}

  std::string dir_;
  Sequence sequence_;
  Options options_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_SEQUENCE_FOLDER_H_
