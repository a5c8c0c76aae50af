// In which unit the time stamps of a stranger's list are, told from the stamps themselves.
//
// A list may be in seconds, milliseconds, microseconds or nanoseconds, and most do not say which. The units lie a
// factor of 1000 apart, and cameras take a frame every 4 ms to 4 s, so the median gap between colour frames tells one.
// Depth follows from colour: in the right unit both cameras ran at once, at rates that can be compared.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_TIME_UNIT_H_
#define DEPTHTWEEN_CORE_SEQUENCE_TIME_UNIT_H_

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "absl/numeric/int128.h"
#include "core/base/status.h"

namespace depthtween {

enum class TimeUnit { kSeconds, kMilliseconds, kMicroseconds, kNanoseconds };

// "s", "ms", "us" or "ns"; none for anything else.
std::optional<TimeUnit> ParseTimeUnit(std::string_view name);
std::string_view ShortName(TimeUnit unit);  // "ms"
std::string_view LongName(TimeUnit unit);   // "milliseconds"

// A stamp as it is written, in 1e-9 of a unit that need not be known yet: nine decimals are exact.
using Stamp = absl::int128;

// Parses a decimal number ("1305031232.193716", "1305031232193716"). Digits past the ninth decimal are dropped.
// InvalidArgument if it is not one, or has no meaning in any unit (from 2^63 on).
absl::StatusOr<Stamp> ParseStamp(std::string_view text);

// Nanoseconds, rounded towards zero; none beyond +-292 years.
std::optional<int64_t> StampNs(Stamp stamp, TimeUnit unit);

// The unit of a list by itself: by the median gap, or, for a single stamp, by whether it would be a time since 1970.
// InvalidArgument, with what settles it, when the gap says one unit and the value another, both of which make sense:
// Unix seconds half a minute apart look like a camera's milliseconds.
absl::StatusOr<TimeUnit> GuessTimeUnit(const std::vector<Stamp>& stamps);

// The unit of depth stamps beside colour stamps whose unit is known: the one in which most of them lie within the
// recording and the rates are nearest to one another; the colour's where that does as well.
TimeUnit GuessDepthTimeUnit(const std::vector<Stamp>& color, TimeUnit color_unit, const std::vector<Stamp>& depth);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_TIME_UNIT_H_
