// The methods that ours is compared with, behind the same interface: what a practitioner would use, built to be strong.
//
//   hold       the last key
//   nearest    the key nearer in time; the earlier one when both are as near
//   linear     per pixel in time; the known one where one is unknown
//   dolson, dolson-mode  Gaussian filter in position, colour and time, and its mode-seeking variant (dolson.h): seconds
//              a frame, where the others take milliseconds
//   tracking   surfaces tracked from depth alone (tracking.h): seconds an interval
//   flow-warp  both keys sampled along dense colour flow and blended (flow_warp.cc)
//
// Frames before the first and after the last key hold that key. Each frame is answered on its own, so Run also takes a
// part of an interval: any first_frame and frame_count inside it.
// sigma is that of one measurement at the depth given (ClipConstants): a baseline does not know its own errors.
#ifndef DEPTHTWEEN_CORE_BASELINES_BASELINES_H_
#define DEPTHTWEEN_CORE_BASELINES_BASELINES_H_

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "core/options/upsample_options.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// Those that cost less than the upsampling they are compared with: "hold", "nearest", "linear", "flow-warp".
const std::vector<std::string>& QuickBaselineNames();

// InvalidArgument lists the names if `name` is none of them.
absl::StatusOr<std::unique_ptr<Upsampler>> MakeBaseline(std::string_view name);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_BASELINES_H_
