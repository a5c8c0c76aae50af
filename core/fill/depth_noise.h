// The noise of a depth camera, and layers: which depths belong to one surface in spite of it.
//
// Units: metres along z. T is float, or Lanes for eight depths at once.
#ifndef DEPTHTWEEN_CORE_FILL_DEPTH_NOISE_H_
#define DEPTHTWEEN_CORE_FILL_DEPTH_NOISE_H_

namespace depthtween {

// Standard deviation of a measurement at depth z: a + b z^2, metres.
struct DepthNoise {
  float a_m = 0.0015F;
  float b_per_m = 0.0004F;
  template <typename T>
  T At(T z) const {
    return a_m + b_per_m * z * z;
  }
};

// Two depths belong to different layers when they differ by more than this share of the nearer one (or by the noise):
// wider than any slant a camera sees well over one pixel, narrower than the gap between things that move apart.
constexpr float kLayerGap = 0.02F;
// The widest gap within the layer of a surface at `nearer_m`.
template <typename T>
T WidestGap(T nearer_m, const DepthNoise& noise) {
  return kLayerGap * nearer_m + 4.0F * noise.At(nearer_m);
}
inline bool SameLayer(float a, float b, const DepthNoise& noise) {
  const float nearer = a < b ? a : b;
  const float gap = a < b ? b - a : a - b;
  return gap <= WidestGap(nearer, noise);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FILL_DEPTH_NOISE_H_
