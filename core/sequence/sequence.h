// A recording as values: time-stamped colour and depth frames and the camera they are seen by.
//
// Depth is registered to colour: both share one camera and one image size. Time stamps are nanoseconds on one clock;
// colour and depth stamps may be asynchronous and irregular.
// Invariant of a validated Sequence: stamps strictly ascend in each stream, the camera is valid, there is at least one
// frame of each kind. Whether the streams overlap in time is asked once a clock has been applied (CheckOverlap).
// Threads: a Sequence is a value. A FrameSource must allow concurrent calls.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_SEQUENCE_H_
#define DEPTHTWEEN_CORE_SEQUENCE_SEQUENCE_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/geometry/camera.h"

namespace depthtween {

// One frame of a stream: when, and its file relative to the sequence folder (for a source without files: its name).
struct FrameRef {
  int64_t time_ns = 0;
  std::string path;
  // The file name without folder and extension: names this frame's outputs.
  std::string Stem() const;
};

struct Sequence {
  Camera camera;
  double depth_scale = 0.0;  // stored 16-bit units per metre
  std::vector<FrameRef> color;
  std::vector<FrameRef> depth;
};

// Depth frames 0, n, 2n, ...: the input of a leave-out experiment. n >= 1.
Sequence KeepEveryNthDepth(const Sequence& sequence, int n);

// The colour frame nearest in time; the earlier one of two as near. `sequence` must be valid.
int NearestColorFrame(const Sequence& sequence, int64_t time_ns);

// Everything wrong with a sequence that can be said without decoding a frame, one message each that names field or
// file, value, rule and how to fix it. Empty when valid.
std::vector<absl::Status> Violations(const Sequence& sequence);
// The first violation, or OK.
absl::Status Validate(const Sequence& sequence);

// InvalidArgument when no depth frame lies within the time of colour nor the other way round; says by what `clock` they
// would meet. `applied_ms` has been taken from the depth stamps already. `sequence` must be valid.
absl::Status CheckOverlap(const Sequence& sequence, double applied_ms = 0.0);

// Parses a decimal number of seconds ("1305031232.193716") exactly into nanoseconds. InvalidArgument if it is not one,
// or outside +-292 years.
absl::StatusOr<int64_t> ParseSeconds(std::string_view text);
// The inverse, with 9 decimals.
std::string FormatSeconds(int64_t time_ns);

// Where frames come from: a folder, a renderer, memory. Indices are those of sequence().
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const Sequence& sequence() const = 0;
  // W x H sRGB.
  virtual absl::StatusOr<Image<Rgb8>> Color(int index) const = 0;
  // W x H metres, 0 = unknown.
  virtual absl::StatusOr<Image<float>> Depth(int index) const = 0;
  // What was assumed in reading the recording, in sentences for people: what, where, how to fix it. May look at frames,
  // with so many threads, which do not change the answer.
  virtual std::vector<std::string> Warnings(int /*threads*/) const { return {}; }
};

// Frames held in memory: for tests and for callers that have no files.
class MemorySource : public FrameSource {
 public:
  MemorySource(Sequence sequence, std::vector<Image<Rgb8>> color, std::vector<Image<float>> depth_m)
      : sequence_(std::move(sequence)), color_(std::move(color)), depth_m_(std::move(depth_m)) {}
  const Sequence& sequence() const override { return sequence_; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return color_.at(index).Clone(); }
  absl::StatusOr<Image<float>> Depth(int index) const override { return depth_m_.at(index).Clone(); }

 private:
  const Sequence sequence_;
  const std::vector<Image<Rgb8>> color_;
  const std::vector<Image<float>> depth_m_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_SEQUENCE_H_
