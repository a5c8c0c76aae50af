// Where and when the depth frames of a clip belong, and the recording as an upsampling sees it.
#ifndef DEPTHTWEEN_CORE_SESSION_CLIP_ALIGNMENT_H_
#define DEPTHTWEEN_CORE_SESSION_CLIP_ALIGNMENT_H_

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string_view>

#include "core/base/status.h"
#include "core/sequence/registration.h"
#include "core/sequence/sequence.h"
#include "core/session/clip_clock.h"

namespace depthtween {

// Of one clip: decided once and then frozen.
struct ClipAlignment {
  ClipClock clock;
  Registration registration;                       // the identity where depth is taken as it lies
  std::optional<RegistrationEstimate> registered;  // what the images say of it
};

// Measures how depth lies beside colour, from the input's frames. `choice` is the option `register`: with "estimate"
// depth is moved, where the images tell enough. Errors: of EstimateRegistration.
absl::Status DecideRegistration(const FrameSource& recording, std::string_view choice, int key_every, int threads,
                                std::stop_token stop, ClipAlignment& alignment);

// The fields "clock" and "registration" of a clip plan or report.
void AddTo(const ClipAlignment& alignment, nlohmann::json& plan_or_report);
// Throws nlohmann::json::exception if AddTo did not make them.
ClipAlignment AlignmentOf(const nlohmann::json& plan_or_report);

// A depth map of the recording where colour sees it.
Image<float> Align(Image<float> depth_m, const Registration& registration);

// The input of an upsampling as a source of frames. Borrows `recording`.
class ClipSource : public FrameSource {
 public:
  ClipSource(const FrameSource& recording, const ClipAlignment& alignment, int key_every)
      : recording_(recording),
        registration_(alignment.registration),
        key_every_(key_every),
        sequence_(InputOf(recording.sequence(), alignment.clock, key_every)) {}
  const Sequence& sequence() const override { return sequence_; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return recording_.Color(index); }
  absl::StatusOr<Image<float>> Depth(int index) const override;

 private:
  const FrameSource& recording_;
  const Registration registration_;
  const int key_every_;
  const Sequence sequence_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_CLIP_ALIGNMENT_H_
