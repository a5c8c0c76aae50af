// From options to the upsampler that they name.
#ifndef DEPTHTWEEN_CORE_API_MAKE_UPSAMPLER_H_
#define DEPTHTWEEN_CORE_API_MAKE_UPSAMPLER_H_

#include <memory>

#include "core/base/status.h"
#include "core/options/upsample_options.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// Errors: of Validate(options).
absl::StatusOr<std::unique_ptr<Upsampler>> MakeUpsampler(const UpsampleOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_API_MAKE_UPSAMPLER_H_
