// Metres <-> the 16-bit units of stored depth and uncertainty, `depth_scale` units per metre.
//
// Depth:  0 = unknown.  Uncertainty (standard deviation): 65535 = unknown.  Values too large to store saturate.
// Stored depth survives the way to metres and back bit for bit.
#ifndef DEPTHTWEEN_CORE_IO_QUANTISE_H_
#define DEPTHTWEEN_CORE_IO_QUANTISE_H_

#include <cstdint>

#include "core/base/image.h"

namespace depthtween {

inline constexpr uint16_t kUnknownDepthUnits = 0;
inline constexpr uint16_t kUnknownSigmaUnits = 65535;
// Sensors and converters write it where nothing was measured, or where a depth was too large to store.
inline constexpr uint16_t kLargestDepthUnits = 65535;

// Rounds to nearest, saturates at 65535. 0 for what is not a positive number.
uint16_t DepthToUnits(float depth_m, double depth_scale);
// Rounds to nearest within 1..65534: a known uncertainty is never stored as none. 65535 for what is not a positive
// number.
uint16_t SigmaToUnits(float sigma_m, double depth_scale);

Image<uint16_t> QuantiseDepth(ImageView<const float> depth_m, double depth_scale);
Image<float> DequantiseDepth(ImageView<const uint16_t> units, double depth_scale);
// The same of depth that a sensor recorded: its largest code is no measurement, so it is unknown too.
Image<float> DequantiseRecordedDepth(ImageView<const uint16_t> units, double depth_scale);
Image<uint16_t> QuantiseSigma(ImageView<const float> sigma_m, double depth_scale);
// Unknown becomes 0, as in DepthResult.
Image<float> DequantiseSigma(ImageView<const uint16_t> units, double depth_scale);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_QUANTISE_H_
