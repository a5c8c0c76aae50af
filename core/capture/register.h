// How far depth lies beside colour in the image, measured from the images: the registration of a recording.
//
// An edge of a depth frame lies where the colour frame of the same instant has one too, if depth is registered to
// colour. First the recording is searched for the shift, scale and parallax under which most edges meet; then the
// distances that remain are fitted, together with all else that moves edges apart: a clock that is late, depth edges
// that lie outside of objects, and rows that are exposed one after another.
#ifndef DEPTHTWEEN_CORE_CAPTURE_REGISTER_H_
#define DEPTHTWEEN_CORE_CAPTURE_REGISTER_H_

#include <stop_token>

#include "core/base/status.h"
#include "core/sequence/registration.h"
#include "core/sequence/sequence.h"

namespace depthtween {

struct RegisterOptions {
  // Depth frames looked at, spread evenly over the clip; of images beyond 640 x 480 as many fewer as keep the memory,
  // 20 bytes for each of their pixels, but at least 4. >= 1
  int max_keys = 16;
  int threads = 1;  // does not change the result. >= 1
  std::stop_token stop = {};

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Depth may be shifted by up to a twelfth of the image's width, and be too large or small by 18 %. `source` must hold a
// valid sequence whose stamps are right to a few milliseconds. Errors: what the source returns; Cancelled when the
// token fires; InvalidArgument for options.
absl::StatusOr<RegistrationEstimate> EstimateRegistration(const FrameSource& source, const RegisterOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_REGISTER_H_
