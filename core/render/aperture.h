// The shape of a lens's opening as it appears around an unsharp point, in rows of partly covered pixels.
//
// Threads: immutable once made.
#ifndef DEPTHTWEEN_CORE_RENDER_APERTURE_H_
#define DEPTHTWEEN_CORE_RENDER_APERTURE_H_

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace depthtween {

class Aperture {
 public:
  // A regular polygon of 3 or more `blades`, one tip up, or a disc for 0. Radii up to `max_radius_px` in size are
  // rounded to kStep. Shapes have the area of the disc, and negative radii are upside down, as in front of the focus.
  Aperture(int blades, float max_radius_px);

  static constexpr float kStep = 0.125F;  // pixels: too little for an eye to see it jump

  // Along a row the share of each pixel that the shape covers changes only near its rims: at `px`, relative to the
  // point, by `change` from the pixel before.
  struct Change {
    int32_t px;
    float change;
  };
  struct Shape {
    int first_row;  // its row 0, for RowAt
    int reach;      // it has rows -reach..reach, and changes from -reach to reach + 1
    float area;     // square pixels. Up to a radius of 0.5 all of it lies in the pixel itself
  };
  const Shape& Scaled(float radius_px) const {
    return shapes_[static_cast<int>(std::lround(radius_px / kStep)) + middle_];
  }
  std::span<const Change> RowAt(int row) const {
    return {changes_.data() + row_begins_[row], changes_.data() + row_begins_[row + 1]};
  }

 private:
  int middle_;                       // index of radius 0
  std::vector<Shape> shapes_;        // by radius
  std::vector<int32_t> row_begins_;  // into changes_, and one more
  std::vector<Change> changes_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_APERTURE_H_
