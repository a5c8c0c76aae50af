// How a depth image must be moved so that it lies on the colour image, and how that was measured (core/capture measures
// it). It lies here, below all that computes, because plans and reports keep it.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_REGISTRATION_H_
#define DEPTHTWEEN_CORE_SEQUENCE_REGISTRATION_H_

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "core/base/image.h"

namespace depthtween {

// A pixel of a depth image that measured z metres at (x, y) is seen in colour at (x, y) plus its displacement. Two
// cameras side by side with parallel axes obey it exactly: their intrinsics differ by shift and scale, and the distance
// between them makes the parallax.
struct Registration {
  double right_px = 0.0, down_px = 0.0;                 // in the middle of the image, at reference_m
  double scale = 1.0;                                   // of the image, about its middle
  double parallax_x_px_m = 0.0, parallax_y_px_m = 0.0;  // times (1/z - 1/reference_m)
  double reference_m = 1.0;                             // > 0

  bool IsIdentity() const {
    return right_px == 0 && down_px == 0 && scale == 1 && parallax_x_px_m == 0 && parallax_y_px_m == 0;
  }
  // Of a pixel of an image of this size, z > 0.
  Flow2 Displacement(int width, int height, double x, double y, double z) const;
};

// What the images say. Sigmas are one standard deviation; -1 = unknown.
struct RegistrationEstimate {
  // Why there is nothing to go by, for people; empty if there is, and only then `model` is more than a guess.
  std::string reason;
  Registration model;  // scale 1, parallax 0 where the images do not tell them from none
  double shift_sigma_px = -1.0, scale_sigma = -1.0, parallax_sigma_px_m = -1.0;
  // Root mean square over the depth edges: how far `model` moves them, and how sure that is.
  double moves_px = 0.0, moves_sigma_px = -1.0;
  int keys = 0;       // depth frames that were compared
  int64_t edges = 0;  // pixels of their edges

  // Whether depth lies beside colour by more than a pixel, beyond doubt.
  bool IsOff() const;
};

// In one sentence for people, such as "depth edges lie 12.3 px (+-0.2 px) beside those of colour: ...".
std::string Summary(const RegistrationEstimate& estimate);

nlohmann::json ToJson(const Registration& registration);
Registration RegistrationFromJson(const nlohmann::json& registration);
// The members with their units, "trusted" (no reason against it) and "summary".
nlohmann::json ToJson(const RegistrationEstimate& estimate);
// The inverses, to the last bit. Throw nlohmann::json::exception for JSON that ToJson did not make.
RegistrationEstimate RegistrationEstimateFromJson(const nlohmann::json& estimate);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_REGISTRATION_H_
