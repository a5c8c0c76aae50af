#include "core/sequence/sequence.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"

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
  if (!sequence.color.empty() && !sequence.depth.empty()) {
    const auto& c = sequence.color;
    const auto& d = sequence.depth;
    if (c.back().time_ns < d.front().time_ns || d.back().time_ns < c.front().time_ns)
      out.push_back(absl::InvalidArgumentError(absl::StrFormat(
          "colour (%s to %s s) and depth (%s to %s s) do not overlap in time: bring both lists onto one clock",
          FormatSeconds(c.front().time_ns), FormatSeconds(c.back().time_ns), FormatSeconds(d.front().time_ns),
          FormatSeconds(d.back().time_ns))));
  }
  return out;
}

absl::Status Validate(const Sequence& sequence) {
  const std::vector<absl::Status> violations = Violations(sequence);
  return violations.empty() ? absl::OkStatus() : violations.front();
}

absl::StatusOr<int64_t> ParseSeconds(std::string_view text) {
  const auto error = [&] {
    return absl::InvalidArgumentError(
        absl::StrFormat("'%s' is not a time stamp: expected decimal seconds such as 12.345678",
                        absl::string_view(text.data(), std::min<size_t>(text.size(), 64))));
  };
  size_t i = 0;
  bool negative = false;
  if (i < text.size() && (text[i] == '-' || text[i] == '+')) negative = text[i++] == '-';
  int64_t seconds = 0, fraction = 0;
  int digits = 0;
  for (; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i, ++digits) {
    seconds = seconds * 10 + (text[i] - '0');
    if (seconds > std::numeric_limits<int64_t>::max() / kNsPerSecond - 1) return error();
  }
  if (i < text.size() && text[i] == '.') {
    ++i;
    int64_t unit = kNsPerSecond / 10;
    for (; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i, ++digits) {
      fraction += unit * (text[i] - '0');  // digits past the ninth are below a nanosecond
      unit /= 10;
    }
  }
  if (i != text.size() || digits == 0) return error();
  const int64_t value = seconds * kNsPerSecond + fraction;
  return negative ? -value : value;
}

std::string FormatSeconds(int64_t time_ns) {
  const int64_t magnitude = std::abs(time_ns);
  return absl::StrFormat("%s%d.%09d", time_ns < 0 ? "-" : "", magnitude / kNsPerSecond, magnitude % kNsPerSecond);
}

}  // namespace depthtween
