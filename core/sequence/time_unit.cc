#include "core/sequence/time_unit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

struct UnitFacts {
  TimeUnit unit;
  std::string_view short_name, long_name;
  int64_t per_second;
};
constexpr std::array<UnitFacts, 4> kUnits = {{{TimeUnit::kSeconds, "s", "seconds", 1},
                                              {TimeUnit::kMilliseconds, "ms", "milliseconds", 1000},
                                              {TimeUnit::kMicroseconds, "us", "microseconds", 1000000},
                                              {TimeUnit::kNanoseconds, "ns", "nanoseconds", 1000000000}}};

constexpr int64_t kStampsPerUnit = 1000000000;
// The longest gap that is taken for one of its unit; a thousandth of it is the shortest. Cameras with depth make 250
// frames per second at most, and what takes a frame less often than every four seconds shows no motion to follow.
constexpr double kLongestGap = 4.0;
// Unix time in the years 2000 to 2100.
constexpr double kFirstUnixS = 946684800.0, kLastUnixS = 4102444800.0;
// A time lapse may take a frame a minute.
constexpr double kLongestTimeLapseGapS = 60.0;
// Ten depth frames for one colour frame, at most; one depth frame for about 4 colour frames is usual.
constexpr double kMinGapRatio = 0.1, kUsualGapRatio = 4.0;
// Beyond so many colour frames for one of depth, streams that do not meet are more likely of two units.
constexpr double kMaxGapRatioApart = 250.0;

const UnitFacts& FactsOf(TimeUnit unit) { return kUnits[static_cast<size_t>(unit)]; }

double InUnits(Stamp stamp) { return static_cast<double>(stamp) / static_cast<double>(kStampsPerUnit); }
double InSeconds(Stamp stamp, TimeUnit unit) { return InUnits(stamp) / static_cast<double>(FactsOf(unit).per_second); }

// Of the gaps that go forward, in units; 0 when there is none.
double MedianGap(const std::vector<Stamp>& stamps) {
  std::vector<Stamp> gaps;
  for (size_t i = 1; i < stamps.size(); ++i)
    if (stamps[i] > stamps[i - 1]) gaps.push_back(stamps[i] - stamps[i - 1]);
  if (gaps.empty()) return 0.0;
  const auto middle = gaps.begin() + static_cast<ptrdiff_t>(gaps.size() / 2);
  std::nth_element(gaps.begin(), middle, gaps.end());
  return InUnits(*middle);
}

std::optional<TimeUnit> UnixUnit(Stamp stamp) {
  for (const UnitFacts& facts : kUnits) {
    const double seconds = InSeconds(stamp, facts.unit);
    if (seconds >= kFirstUnixS && seconds <= kLastUnixS) return facts.unit;
  }
  return std::nullopt;
}

TimeUnit UnitByGap(double gap) {
  double longest = kLongestGap;
  for (const UnitFacts& facts : kUnits) {
    if (gap < longest) return facts.unit;
    longest *= 1000.0;
  }
  return TimeUnit::kNanoseconds;
}

}  // namespace

std::optional<TimeUnit> ParseTimeUnit(std::string_view name) {
  for (const UnitFacts& facts : kUnits)
    if (name == facts.short_name) return facts.unit;
  return std::nullopt;
}

std::string_view ShortName(TimeUnit unit) { return FactsOf(unit).short_name; }
std::string_view LongName(TimeUnit unit) { return FactsOf(unit).long_name; }

absl::StatusOr<Stamp> ParseStamp(std::string_view text) {
  const auto error = [&] {
    return absl::InvalidArgumentError(
        absl::StrFormat("'%s' is not a time stamp: expected decimal seconds such as 12.345678",
                        absl::string_view(text.data(), std::min<size_t>(text.size(), 64))));
  };
  size_t i = 0;
  bool negative = false;
  if (i < text.size() && (text[i] == '-' || text[i] == '+')) negative = text[i++] == '-';
  Stamp whole = 0, fraction = 0;
  int digits = 0;
  for (; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i, ++digits) {
    whole = whole * 10 + (text[i] - '0');
    if (whole > std::numeric_limits<int64_t>::max()) return error();
  }
  if (i < text.size() && text[i] == '.') {
    ++i;
    int64_t digit_worth = kStampsPerUnit / 10;
    for (; i < text.size() && text[i] >= '0' && text[i] <= '9'; ++i, ++digits) {
      fraction += digit_worth * (text[i] - '0');  // 0 past the ninth
      digit_worth /= 10;
    }
  }
  if (i != text.size() || digits == 0) return error();
  const Stamp value = whole * kStampsPerUnit + fraction;
  return negative ? -value : value;
}

std::optional<int64_t> StampNs(Stamp stamp, TimeUnit unit) {
  const Stamp ns = stamp / FactsOf(unit).per_second;
  if (ns > std::numeric_limits<int64_t>::max() || ns < -Stamp(std::numeric_limits<int64_t>::max())) return std::nullopt;
  return static_cast<int64_t>(ns);
}

absl::StatusOr<TimeUnit> GuessTimeUnit(const std::vector<Stamp>& stamps) {
  if (stamps.empty()) return TimeUnit::kSeconds;
  const std::optional<TimeUnit> since_1970 = UnixUnit(stamps.front());
  const double gap = MedianGap(stamps);
  if (gap == 0.0) return since_1970.value_or(TimeUnit::kSeconds);
  const TimeUnit by_gap = UnitByGap(gap);
  if (!since_1970.has_value() || *since_1970 == by_gap) return by_gap;
  if (*since_1970 > by_gap) return *since_1970;  // no coarser unit holds a time so late
  const double gap_s = gap / static_cast<double>(FactsOf(*since_1970).per_second);
  if (gap_s > kLongestTimeLapseGapS) return by_gap;
  return absl::InvalidArgumentError(absl::StrFormat(
      "the unit of the time stamps is not clear: %s since 1970, one frame every %.4g s, or %s with one every %.4g ms? "
      "Say it by a line '# unit: %s' or '# unit: %s' at the top of the list",
      std::string(LongName(*since_1970)), gap_s, std::string(LongName(by_gap)),
      1e3 * gap / static_cast<double>(FactsOf(by_gap).per_second), std::string(ShortName(*since_1970)),
      std::string(ShortName(by_gap))));
}

TimeUnit GuessDepthTimeUnit(const std::vector<Stamp>& color, TimeUnit color_unit, const std::vector<Stamp>& depth) {
  const double color_gap_s = MedianGap(color) / static_cast<double>(FactsOf(color_unit).per_second);
  const double depth_gap = MedianGap(depth);
  if (color_gap_s == 0.0 || depth.empty()) return color_unit;
  const auto [first, last] = std::minmax_element(color.begin(), color.end());
  const double first_s = InSeconds(*first, color_unit) - color_gap_s;
  const double last_s = InSeconds(*last, color_unit) + color_gap_s;
  TimeUnit best = color_unit;
  ptrdiff_t best_inside = -1;
  double best_distance = std::numeric_limits<double>::infinity();
  for (const UnitFacts& facts : kUnits) {
    // A single depth frame has no rate, so only where it lies counts.
    const double ratio =
        depth_gap > 0.0 ? depth_gap / static_cast<double>(facts.per_second) / color_gap_s : kUsualGapRatio;
    if (ratio < kMinGapRatio) continue;
    const auto inside = std::count_if(depth.begin(), depth.end(), [&](Stamp stamp) {
      const double seconds = InSeconds(stamp, facts.unit);
      return seconds >= first_s && seconds <= last_s;
    });
    // Where streams do not meet in any unit, which a clock set wrongly does, the rates decide alone.
    const bool same_as_color = facts.unit == color_unit && (inside > 0 || ratio < kMaxGapRatioApart);
    const double distance = same_as_color ? -1.0 : std::abs(std::log(ratio / kUsualGapRatio));
    if (inside > best_inside || (inside == best_inside && distance < best_distance)) {
      best = facts.unit;
      best_inside = inside;
      best_distance = distance;
    }
  }
  return best;
}

}  // namespace depthtween
