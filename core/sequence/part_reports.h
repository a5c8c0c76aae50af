// Names of what tasks leave beside the frames of an interval in a result folder: for `assemble`, for pictures of the
// intervals around it, and for the server, which moves them.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_PART_REPORTS_H_
#define DEPTHTWEEN_CORE_SEQUENCE_PART_REPORTS_H_

#include <string>

#include "absl/strings/str_format.h"

namespace depthtween {

inline std::string IntervalReportName(int interval) { return absl::StrFormat("interval_%06d.json", interval); }

inline std::string RenderReportName(const std::string& render, int interval) {
  return absl::StrFormat("render_%s_%06d.json", render, interval);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_PART_REPORTS_H_
