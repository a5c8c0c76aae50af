// NumPy's .npz: named arrays in a zip archive, stored or deflated.
//
// Source: numpy.lib.format (versions 1 to 3 of .npy) and PKWARE's APPNOTE 6.3 without zip64, encryption and spanning.
// Threads: safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_IO_NPZ_H_
#define DEPTHTWEEN_CORE_IO_NPZ_H_

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

// IEEE 754 half precision. To half: round to nearest even, overflow to infinity, NaN stays NaN.
uint16_t FloatToHalf(float value);
float HalfToFloat(uint16_t half);

enum class ElementType : uint8_t { kBool, kUint8, kInt16, kUint16, kInt32, kInt64, kFloat16, kFloat32, kFloat64 };
size_t ElementBytes(ElementType type);

// Elements in C order (the last index varies fastest), little endian.
struct NpyArray {
  ElementType type = ElementType::kFloat32;
  std::vector<int64_t> shape;  // empty: one element
  std::string bytes;

  int64_t element_count() const;
  // Every element as float, whatever the type (64-bit values are rounded).
  std::vector<float> ToFloats() const;
  // `type` must be kFloat16 or kFloat32; the product of `shape` must be values.size().
  static NpyArray FromFloats(std::vector<int64_t> shape, const std::vector<float>& values, ElementType type);
};

using Npz = std::map<std::string, NpyArray>;  // by name, without ".npy"

struct NpzLimits {
  int64_t max_bytes = int64_t{1} << 30;  // of all arrays together, unpacked
  int max_arrays = 1024;
};

// Errors: DataLoss for damaged bytes (structure, sizes or checksum); InvalidArgument for what we do not read (big
// endian, Fortran order, other types); ResourceExhausted over a limit, before it is allocated.
absl::StatusOr<Npz> DecodeNpz(std::string_view bytes, const NpzLimits& limits = {});
absl::StatusOr<Npz> ReadNpz(const std::string& path, const NpzLimits& limits = {});

// kFast takes a third of kDeflated's time for a few per cent more bytes.
enum class NpzCompression { kStored, kFast, kDeflated };
// InvalidArgument when an array's bytes are not of its shape, or when the archive would pass 2 GiB.
absl::StatusOr<std::string> EncodeNpz(const Npz& arrays, NpzCompression compression = NpzCompression::kDeflated);
absl::Status WriteNpz(const std::string& path, const Npz& arrays,
                      NpzCompression compression = NpzCompression::kDeflated);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_NPZ_H_
