// The shape of a lens's opening as it appears around an unsharp point: rows of pixels, with fractions at their ends.
//
// Threads: immutable once made.
#ifndef DEPTHTWEEN_CORE_RENDER_APERTURE_H_
#define DEPTHTWEEN_CORE_RENDER_APERTURE_H_

#include <cmath>
#include <cstdint>
#include <vector>

namespace depthtween {

class Aperture {
 public:
  // A point spreads evenly along a row from `begin` to `end`, both relative to it. Each lies `*_share` of a pixel
  // beyond the left border of a whole pixel: begin = begin_px - 0.5 + begin_share. Empty rows have begin == end.
  struct Row {
    int16_t begin_px, end_px;
    float begin_share, end_share;
  };

  // A regular polygon of 3 or more `blades`, one tip up, or a disc for 0. Radii up to `max_radius_px` in size are
  // rounded to kStep. Shapes have the area of the disc, and negative radii are upside down, as in front of the focus.
  Aperture(int blades, float max_radius_px);

  static constexpr float kStep = 0.125F;  // pixels: too little for an eye to see it jump

  struct Shape {
    int first_row;  // index of its row 0
    int reach;      // it has rows -reach..reach
    float area;     // square pixels: the sum of its rows. Up to a radius of 0.5 all of it lies in the pixel itself
  };
  const Shape& Scaled(float radius_px) const {
    return shapes_[static_cast<int>(std::lround(radius_px / kStep)) + middle_];
  }
  const Row& RowAt(int index) const { return rows_[index]; }

 private:
  int middle_;                 // index of radius 0
  std::vector<Shape> shapes_;  // by radius
  std::vector<Row> rows_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_APERTURE_H_
