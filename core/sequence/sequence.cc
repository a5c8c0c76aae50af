#include "core/sequence/sequence.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "absl/strings/str_format.h"
#include "core/sequence/time_unit.h"

namespace depthtween {
namespace {

// A unit of a kilometre, and one of a nanometre. Beyond them depths in metres are no longer numbers to compute with.
constexpr double kMinDepthScale = 1e-3, kMaxDepthScale = 1e9;

constexpr int kMaxFrames = 100000;  // per stream; a longer recording is cut by its owner
constexpr int64_t kNsPerSecond = 1000000000;

void CheckStream(const std::vector<FrameRef>& frames, const char* list, std::vector<absl::Status>& out) {
  if (frames.empty()) {
    out.push_back(absl::InvalidArgumentError(absl::StrFormat("%s lists no frames, must list at least one", list)));
    return;
  }
  if (frames.size() > kMaxFrames)
    out.push_back(absl::ResourceExhaustedError(absl::StrFormat(
        "%s lists %d frames, at most %d are allowed: split the recording", list, frames.size(), kMaxFrames)));
  for (size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].time_ns <= frames[i - 1].time_ns)
      out.push_back(
          absl::InvalidArgumentError(absl::StrFormat("%s: %s has time stamp %s s, must be later than %s s of the frame "
                                                     "before it (%s): sort the list or drop the frame",
                                                     list, frames[i].path, FormatSeconds(frames[i].time_ns),
                                                     FormatSeconds(frames[i - 1].time_ns), frames[i - 1].path)));
  }
}

}  // namespace

std::string FrameRef::Stem() const {
  const size_t slash = path.find_last_of('/');
  const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
  const size_t dot = name.find_last_of('.');
  return dot == std::string::npos || dot == 0 ? name : name.substr(0, dot);
}

Sequence KeepEveryNthDepth(const Sequence& sequence, int n) {
  Sequence kept = sequence;
  kept.depth.clear();
  for (size_t k = 0; k < sequence.depth.size(); k += n) kept.depth.push_back(sequence.depth[k]);
  return kept;
}

int NearestColorFrame(const Sequence& sequence, int64_t time_ns) {
  const auto& color = sequence.color;
  const auto after = std::lower_bound(color.begin(), color.end(), time_ns,
                                      [](const FrameRef& frame, int64_t time) { return frame.time_ns < time; });
  if (after == color.begin()) return 0;
  if (after == color.end()) return static_cast<int>(color.size()) - 1;
  const auto before = after - 1;
  return static_cast<int>((time_ns - before->time_ns <= after->time_ns - time_ns ? before : after) - color.begin());
}

std::vector<absl::Status> Violations(const Sequence& sequence) {
  std::vector<absl::Status> out;
  if (absl::Status camera = sequence.camera.Validate(); !camera.ok()) out.push_back(camera);
  if (!(sequence.depth_scale >= kMinDepthScale && sequence.depth_scale <= kMaxDepthScale))
    out.push_back(absl::InvalidArgumentError(absl::StrFormat(
        "camera.depth_scale = %g, must be %g to %g: stored 16-bit units per metre (1000 for millimetres)",
        sequence.depth_scale, kMinDepthScale, kMaxDepthScale)));
  CheckStream(sequence.color, "rgb.txt", out);
  CheckStream(sequence.depth, "depth.txt", out);
  return out;
}

absl::Status CheckOverlap(const Sequence& sequence, double applied_ms) {
  const auto& c = sequence.color;
  const auto& d = sequence.depth;
  if (c.back().time_ns >= d.front().time_ns && d.back().time_ns >= c.front().time_ns) return absl::OkStatus();
  const double apart_ms =
      1e-6 * (static_cast<double>(d.front().time_ns) - static_cast<double>(c.front().time_ns)) + applied_ms;
  return absl::InvalidArgumentError(absl::StrFormat(
      "colour (%s to %s s) and depth (%s to %s s) do not overlap in time. If both cameras ran at once, their clocks "
      "differ: with --clock=%.3f (how far the depth clock is ahead, in ms) the first frames of both meet; --clock "
      "index "
      "pairs frames by their numbers, and --clock estimate measures from the images. A job has the field options.clock",
      FormatSeconds(c.front().time_ns), FormatSeconds(c.back().time_ns), FormatSeconds(d.front().time_ns),
      FormatSeconds(d.back().time_ns), apart_ms));
}

absl::Status Validate(const Sequence& sequence) {
  const std::vector<absl::Status> violations = Violations(sequence);
  return violations.empty() ? absl::OkStatus() : violations.front();
}

absl::StatusOr<int64_t> ParseSeconds(std::string_view text) {
  ASSIGN_OR_RETURN(const Stamp stamp, ParseStamp(text));
  const std::optional<int64_t> time_ns = StampNs(stamp, TimeUnit::kSeconds);
  if (!time_ns.has_value())
    return absl::InvalidArgumentError(absl::StrFormat("'%s' is not a time stamp: must be within 292 years of 0 seconds",
                                                      absl::string_view(text.data(), text.size())));
  return *time_ns;
}

std::string FormatSeconds(int64_t time_ns) {
  const int64_t magnitude = std::abs(time_ns);
  return absl::StrFormat("%s%d.%09d", time_ns < 0 ? "-" : "", magnitude / kNsPerSecond, magnitude % kNsPerSecond);
}

}  // namespace depthtween
