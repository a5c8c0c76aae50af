#include "client/cli/clock_flag.h"

#include <cmath>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace depthtween::cli {

std::string ClockProblem(const std::string& text) {
  // As the server has them.
  constexpr size_t kMaxBytes = 64;
  constexpr double kMaxOffsetMs = 3600e3, kMaxDriftPpm = 1e5;
  if (text.empty() || text == "stamps" || text == "index" || text == "estimate") return "";
  const std::vector<std::string> numbers = absl::StrSplit(text, ',');
  double offset_ms = 0.0, drift_ppm = 0.0;
  if (text.size() > kMaxBytes || numbers.size() > 2 || !absl::SimpleAtod(numbers[0], &offset_ms) ||
      (numbers.size() == 2 && !absl::SimpleAtod(numbers[1], &drift_ppm))) {
    return "must be stamps, index, estimate, or OFFSET_MS[,DRIFT_PPM] such as 4 or 4,3000";
  }
  if (!(std::abs(offset_ms) <= kMaxOffsetMs)) return "the offset must be within an hour (3.6e6 ms)";
  if (!(std::abs(drift_ppm) <= kMaxDriftPpm)) return "the drift must be within 100000 ppm (a tenth)";
  return "";
}

}  // namespace depthtween::cli
