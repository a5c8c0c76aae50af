// Numbers of a grid of points, one plane each, laid out for eight points at a time: every row starts on a boundary of
// eight and is followed by padding, so that the neighbours of any point may be read, and whole rows be written, without
// asking where the grid ends. Padding holds zeros and has weight zero.
#ifndef DEPTHTWEEN_CORE_SOLVE_PLANES_H_
#define DEPTHTWEEN_CORE_SOLVE_PLANES_H_

#include <cstddef>
#include <cstring>
#include <vector>

#include "core/base/image.h"
#include "core/base/lanes.h"
#include "core/solve/triple.h"

namespace depthtween {

struct Grid {
  int width = 0, height = 0;

  ptrdiff_t stride() const { return ptrdiff_t{(width + kLanes - 1) / kLanes} * kLanes + kLanes; }
  ptrdiff_t at(int x, int y) const { return (y + 1) * stride() + kLanes + x; }
  size_t size() const { return static_cast<size_t>((height + 2) * stride() + 2 * ptrdiff_t{kLanes}); }
  int blocks_per_row() const { return (width + kLanes - 1) / kLanes; }
  int blocks() const { return blocks_per_row() * height; }
  // body(index of the block's first point, number of the block), in order.
  template <typename Body>
  void ForEachBlock(const Body& body) const {
    const int per_row = blocks_per_row();
    for (int y = 0, block = 0; y < height; ++y)
      for (int b = 0; b < per_row; ++b, ++block) body(at(b * kLanes, y), block);
  }
};

class Planes {
 public:
  Planes() = default;
  Planes(const Grid& grid, int count, float fill = 0.0F)
      : size_((static_cast<int>(grid.size()) + 15) / 16 * 16), count_(count), values_(size_, count, fill) {}
  int count() const { return count_; }
  bool empty() const { return count_ == 0; }
  float* operator[](int plane) { return values_.data() + static_cast<ptrdiff_t>(plane) * size_; }
  const float* operator[](int plane) const { return values_.data() + static_cast<ptrdiff_t>(plane) * size_; }
  Planes Clone() const {
    Planes copy;
    copy.size_ = size_, copy.count_ = count_, copy.values_ = values_.Clone();
    return copy;
  }
  void Clear() { values_.Fill(0.0F); }

 private:
  int size_ = 0, count_ = 0;
  Image<float> values_;
};

inline void StoreLanes(float* p, Lanes v) { std::memcpy(p, &v, sizeof(v)); }
// Three planes from `first` on.
inline Triple<Lanes> LoadPoint(const Planes& planes, int first, ptrdiff_t at) {
  return {LoadLanes(planes[first] + at), LoadLanes(planes[first + 1] + at), LoadLanes(planes[first + 2] + at)};
}
inline void StorePoint(Planes& planes, int first, ptrdiff_t at, const Triple<Lanes>& v) {
  StoreLanes(planes[first] + at, v.x);
  StoreLanes(planes[first + 1] + at, v.y);
  StoreLanes(planes[first + 2] + at, v.z);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_PLANES_H_
