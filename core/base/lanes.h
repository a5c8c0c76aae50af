// Eight floats computed on at once. GCC and clang turn arithmetic on them into vector instructions of whatever width
// the processor has; comparisons give lanes of all ones or all zeros, which `?:` takes.
#ifndef DEPTHTWEEN_CORE_BASE_LANES_H_
#define DEPTHTWEEN_CORE_BASE_LANES_H_

#include <cstdint>
#include <cstring>

namespace depthtween {

constexpr int kLanes = 8;
typedef float Lanes __attribute__((vector_size(32)));
typedef int32_t LaneInts __attribute__((vector_size(32)));

// From any address.
inline Lanes LoadLanes(const float* p) {
  Lanes v;
  std::memcpy(&v, p, sizeof(v));
  return v;
}
inline Lanes AllLanes(float value) { return Lanes{} + value; }
inline Lanes AbsLanes(Lanes v) { return reinterpret_cast<Lanes>(reinterpret_cast<LaneInts>(v) & 0x7FFFFFFF); }
inline Lanes MinLanes(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes MaxLanes(Lanes a, Lanes b) { return a > b ? a : b; }
template <typename T = float>  // what the sum is kept in
T SumLanes(Lanes v) {
  T sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += v[i];
  return sum;
}
// `value` where `mask` is set, else 0.
inline Lanes KeepLanes(LaneInts mask, Lanes value) {
  return reinterpret_cast<Lanes>(mask & reinterpret_cast<LaneInts>(value));
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_LANES_H_
