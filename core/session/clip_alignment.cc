#include "core/session/clip_alignment.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "core/capture/register.h"
#include "core/raster/registered_depth.h"

namespace depthtween {

using nlohmann::json;

absl::Status DecideRegistration(const FrameSource& recording, std::string_view choice, int key_every, int threads,
                                std::stop_token stop, ClipAlignment& alignment) {
  const ClipSource as_it_lies(recording, {.clock = alignment.clock}, key_every);
  ASSIGN_OR_RETURN(alignment.registered,
                   EstimateRegistration(as_it_lies, {.threads = threads, .stop = std::move(stop)}));
  if (choice == "estimate" && alignment.registered->IsOff()) alignment.registration = alignment.registered->model;
  return absl::OkStatus();
}

void AddTo(const ClipAlignment& alignment, json& plan_or_report) {
  plan_or_report["clock"] = ToJson(alignment.clock);
  json registration = {{"applied", ToJson(alignment.registration)}};
  if (alignment.registered.has_value()) registration["estimate"] = ToJson(*alignment.registered);
  plan_or_report["registration"] = std::move(registration);
}

ClipAlignment AlignmentOf(const json& plan_or_report) {
  const json& registration = plan_or_report.at("registration");
  ClipAlignment alignment{.clock = ClockOf(plan_or_report),
                          .registration = RegistrationFromJson(registration.at("applied"))};
  if (registration.contains("estimate"))
    alignment.registered = RegistrationEstimateFromJson(registration.at("estimate"));
  return alignment;
}

Image<float> Align(Image<float> depth_m, const Registration& registration) {
  return registration.IsIdentity() ? std::move(depth_m) : RegisterDepth(depth_m, registration);
}

absl::StatusOr<Image<float>> ClipSource::Depth(int index) const {
  ASSIGN_OR_RETURN(Image<float> depth_m, recording_.Depth(index * key_every_));
  return Align(std::move(depth_m), registration_);
}

}  // namespace depthtween
