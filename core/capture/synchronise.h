// How far the depth camera's clock is from the colour camera's, measured from the images.
//
// An edge of a depth frame lies where the colour frame of the same instant has one too. At any other instant the edge
// has moved on: by its speed times the error of the stamp. So the distance from depth edges to colour edges, along the
// edges' normals and over their speeds, tells the error. First the clip is searched for the offset and drift under
// which most edges meet, and for how depth lies beside colour, since an error of place looks like one of time. Then the
// distances are fitted, robustly, together with all else that moves edges apart (edge_fit.h): a wrong registration,
// depth edges that lie outside (or inside) of objects, and rows of colour that are exposed one after another.
//
// Where neither objects nor camera move, nothing can be told, and that is said.
#ifndef DEPTHTWEEN_CORE_CAPTURE_SYNCHRONISE_H_
#define DEPTHTWEEN_CORE_CAPTURE_SYNCHRONISE_H_

#include <cstdint>
#include <functional>
#include <stop_token>

#include "core/base/status.h"
#include "core/sequence/clock_estimate.h"
#include "core/sequence/sequence.h"

namespace depthtween {

struct SynchroniseOptions {
  int max_keys = 128;  // depth frames looked at, spread evenly over the clip. >= kMinSynchroniseKeys
  int threads = 1;     // does not change the result. >= 1
  std::stop_token stop = {};
  // Called now and then from the calling thread. May be empty.
  std::function<void(int done, int total)> on_progress = nullptr;

  // InvalidArgument with field, value and rule.
  absl::Status Validate() const;
};

// Fewer depth frames than this do not tell an offset from the chance of a few edges.
inline constexpr int kMinSynchroniseKeys = 6;

// Stamps may be off by up to two periods of depth anywhere in the clip, and drift by 1 %. `source` must hold a valid
// sequence. Errors: what the source returns; Cancelled when the token fires; InvalidArgument for options.
absl::StatusOr<ClockEstimate> EstimateClock(const FrameSource& source, const SynchroniseOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_SYNCHRONISE_H_
