// How far depth may be inferred from what was measured: what is farther stays unknown instead of being made up.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_FILL_LIMIT_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_FILL_LIMIT_H_

#include <memory>
#include <string_view>

#include "core/base/status.h"
#include "core/sequence/depth_result.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

// Where no key saw a surface, its depth is inferred from beside it (provenance 4).
enum class Fill {
  kAll,   // everywhere
  kNear,  // up to kNearShare of the image's width from what was seen, where sigma is at most kMostSigma of depth
  kNone   // nowhere
};
inline constexpr float kNearShare = 0.05F, kMostSigma = 0.25F;

// InvalidArgument for a word that is none of all, near, none.
absl::StatusOr<Fill> ParseFill(std::string_view word);

// Takes back what was inferred beyond the limit: depth 0, provenance 0.
void LimitFill(Fill fill, DepthResult& result);

// `upsampler` with its results limited.
std::unique_ptr<Upsampler> WithFillLimit(std::unique_ptr<Upsampler> upsampler, Fill fill);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_FILL_LIMIT_H_
