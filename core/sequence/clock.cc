#include "core/sequence/clock.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

namespace depthtween {
namespace {

// A century: one clock may count from 1970 and the other from when its camera was switched on.
constexpr double kMaxOffsetNs = 3155760000e9;
constexpr double kMaxDriftPpm = 1e5;
// Under this share of a period, stamps are of one moment: motion within it is far below a pixel.
constexpr double kCoincident = 0.02;
// Nearly all that jitter makes is within so many deviations, but for one frame in kOutliers that was late; half of it
// within kHalfSigmas, which leaves room for a steady delay as large as the jitter.
constexpr double kJitterSigmas = 4.0, kHalfSigmas = 2.0;
constexpr ptrdiff_t kOutliers = 20;

double Median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<double> Gaps(const std::vector<FrameRef>& frames) {
  std::vector<double> gaps;
  for (size_t i = 1; i < frames.size(); ++i)
    gaps.push_back(static_cast<double>(frames[i].time_ns - frames[i - 1].time_ns));
  return gaps;
}

}  // namespace

int64_t StampJitterNs(const std::vector<FrameRef>& frames) {
  if (frames.size() < 4) return 0;
  std::vector<double> gaps = Gaps(frames);
  std::vector<double> sorted = gaps;
  const double period = Median(sorted);
  for (double& gap : gaps) gap = std::abs(gap - period * std::max(1.0, std::round(gap / period)));
  // A gap is the difference of two stamps: its deviation is sqrt(2) times one stamp's. 1.4826: median to standard
  // deviation.
  return static_cast<int64_t>(1.4826 / std::sqrt(2.0) * Median(gaps));
}

int64_t MedianPeriodNs(const std::vector<FrameRef>& frames) {
  if (frames.size() < 2) return 0;
  std::vector<double> gaps = Gaps(frames);
  return std::llround(Median(gaps));
}

int64_t ClockModel::ColorTime(int64_t depth_stamp_ns) const {
  // What is taken from the stamp is small enough for a double, the stamp itself is not.
  const double drift = 1e-6 * drift_ppm, since = static_cast<double>(depth_stamp_ns - reference_ns);
  int64_t time_ns = 0;
  const int64_t ahead_ns = std::llround((offset_ns + drift * since) / (1.0 + drift));
  if (__builtin_sub_overflow(depth_stamp_ns, ahead_ns, &time_ns))
    return ahead_ns > 0 ? std::numeric_limits<int64_t>::min() : std::numeric_limits<int64_t>::max();
  return time_ns;
}

absl::Status ClockModel::Validate() const {
  const auto error = [](const char* field, double value, const char* rule) {
    return absl::InvalidArgumentError(absl::StrFormat("ClockModel.%s = %g, must be %s", field, value, rule));
  };
  if (!(std::abs(offset_ns) <= kMaxOffsetNs)) return error("offset_ns", offset_ns, "within a century (3.15576e18)");
  if (!(std::abs(drift_ppm) <= kMaxDriftPpm)) return error("drift_ppm", drift_ppm, "within 100000 (a tenth)");
  return absl::OkStatus();
}

absl::StatusOr<ClockChoice> ParseClockChoice(std::string_view text) {
  constexpr size_t kMaxBytes = 64;
  if (text == "stamps") return ClockChoice{};
  if (text == "index") return ClockChoice{.mode = ClockChoice::Mode::kIndex};
  if (text == "estimate") return ClockChoice{.mode = ClockChoice::Mode::kEstimate};
  ClockChoice choice{.mode = ClockChoice::Mode::kGiven};
  const absl::string_view shown(text.data(), std::min(text.size(), kMaxBytes));
  const std::vector<std::string> numbers = absl::StrSplit(shown, ',');
  if (text.size() > kMaxBytes || numbers.size() > 2 || !absl::SimpleAtod(numbers[0], &choice.offset_ms) ||
      (numbers.size() == 2 && !absl::SimpleAtod(numbers[1], &choice.drift_ppm)))
    return absl::InvalidArgumentError(
        absl::StrFormat("'%s', must be stamps, index, estimate, or OFFSET_MS[,DRIFT_PPM] such as 4 or 4,3000",
                        absl::CHexEscape(shown)));
  RETURN_IF_ERROR(ClockModel({.offset_ns = 1e6 * choice.offset_ms, .drift_ppm = choice.drift_ppm}).Validate());
  return choice;
}

Sequence CorrectDepthStamps(const Sequence& sequence, const ClockModel& clock) {
  Sequence corrected = sequence;
  for (FrameRef& frame : corrected.depth) frame.time_ns = clock.ColorTime(frame.time_ns);
  return corrected;
}

Sequence PairDepthWithinJitter(const Sequence& sequence) {
  const double jitter = std::hypot(static_cast<double>(StampJitterNs(sequence.color)),
                                   static_cast<double>(StampJitterNs(sequence.depth)));
  Sequence paired = sequence;
  std::vector<double> distances;
  for (FrameRef& frame : paired.depth) {
    const int64_t color_ns = sequence.color[NearestColorFrame(sequence, frame.time_ns)].time_ns;
    distances.push_back(static_cast<double>(std::llabs(frame.time_ns - color_ns)));
    frame.time_ns = color_ns;
  }
  const auto beyond = [&](double limit) {
    return std::count_if(distances.begin(), distances.end(), [limit](double distance) { return distance > limit; });
  };
  const auto count = static_cast<ptrdiff_t>(distances.size());
  const bool explained =
      beyond(kJitterSigmas * jitter) <= count / kOutliers && beyond(kHalfSigmas * jitter) <= count / 2;
  const double coincident = kCoincident * static_cast<double>(MedianPeriodNs(sequence.color));
  const double near = explained ? std::max(kJitterSigmas * jitter, coincident) : coincident;
  for (size_t k = 0; k < distances.size(); ++k)
    if (distances[k] > near) paired.depth[k].time_ns = sequence.depth[k].time_ns;
  // Back to its own stamp what would no longer come after the frame before and before the one after. One that goes back
  // may stand in the way of its neighbour: until nothing changes.
  for (bool changed = true; changed;) {
    changed = false;
    for (size_t k = 0; k + 1 < paired.depth.size(); ++k) {
      if (paired.depth[k].time_ns < paired.depth[k + 1].time_ns) continue;
      for (const size_t i : {k, k + 1}) paired.depth[i].time_ns = sequence.depth[i].time_ns;
      changed = true;
    }
  }
  return paired;
}

Sequence PairDepthByIndex(const Sequence& sequence, int color_per_depth) {
  Sequence paired = sequence;
  const size_t ratio = color_per_depth, count = (sequence.color.size() + ratio - 1) / ratio;
  if (paired.depth.size() > count) paired.depth.resize(count);
  for (size_t k = 0; k < paired.depth.size(); ++k) paired.depth[k].time_ns = sequence.color[k * ratio].time_ns;
  return paired;
}

int ColorFramesPerDepth(const Sequence& sequence) {
  const auto color = static_cast<double>(MedianPeriodNs(sequence.color));
  const auto depth = static_cast<double>(MedianPeriodNs(sequence.depth));
  return color > 0 ? std::max(1, static_cast<int>(std::lround(depth / color))) : 1;
}

}  // namespace depthtween
