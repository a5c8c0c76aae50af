// How far the depth camera's clock is from the colour camera's, as it was measured (core/capture measures it): the
// value as everybody has it who keeps or shows it, and its one form in JSON. It lies here, below all that computes,
// because a server keeps it too.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_CLOCK_ESTIMATE_H_
#define DEPTHTWEEN_CORE_SEQUENCE_CLOCK_ESTIMATE_H_

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "core/sequence/clock.h"

namespace depthtween {

// What the images say. Sigmas are one standard deviation; -1 = unknown.
struct ClockEstimate {
  // Why there is nothing to go by, for people; empty if there is, and only then `model` is more than a guess.
  std::string reason;
  ClockModel model;  // reference: the first colour frame; drift 0 where the clip is too short to tell one
  double offset_sigma_ns = -1.0;
  double drift_sigma_ppm = -1.0;
  double stamp_sigma_ns = -1.0;  // of a corrected stamp, where in the clip it is largest
  // Each row of colour is exposed this much later, against depth, than the row above it. Not corrected.
  double row_time_ns = 0.0;
  double row_time_sigma_ns = -1.0;
  int keys = 0;       // depth frames that were compared
  int64_t edges = 0;  // pixels of their edges
};

// In one sentence for people, such as "the depth camera's clock is 4.00 ms ahead ... and gains 3012 ppm (+-20 ppm)...".
std::string Summary(const ClockEstimate& estimate);

// The members with their units, "trusted" (no reason against it) and "summary". The field "clock.estimate" of clip
// plans and of report.json, and what a server keeps.
nlohmann::json ToJson(const ClockEstimate& estimate);
// The inverse, to the last bit. Throws nlohmann::json::exception for JSON that ToJson did not make.
ClockEstimate ClockEstimateFromJson(const nlohmann::json& estimate);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_CLOCK_ESTIMATE_H_
