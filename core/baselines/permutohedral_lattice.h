// Gaussian filtering of values at scattered points of a d-dimensional space, in time linear in points and dimensions.
//
// Grammar of use:  AddPoint* Splat* Blur (Slice | SliceAt)*.
//
// The space is laid into the hyperplane of R^(d+1) whose coordinates sum to zero and tiled there by the lattice A*_d. A
// point gives its value to the d + 1 corners of its simplex by barycentric weights, the values are blurred along the
// d + 1 directions of the lattice by (1 2 1)/4, and read back by the same weights. Why this is a Gaussian of unit
// variance: with e_k the unit vectors and v_k = (1, ..., 1) - (d+1) e_k, the sum of v_k v_k^T is (d+1)^2 times the
// identity on the hyperplane. The blur has covariance 1/2 of that; interpolation by barycentric weights is the box
// spline of the same directions, with 1/12, and it is done twice. Together (d+1)^2 (1/2 + 1/12 + 1/12): so one sigma is
// (d+1) sqrt(2/3) long. The shape is that of a Gaussian to a few per cent of its peak, the sums of weights are exact.
// Source: Adams, Baek and Davis, Fast High-Dimensional Filtering Using the Permutohedral Lattice, Eurographics 2010.
//
// Units:    positions in sigmas of their coordinate.  Values: any.
// Threads:  Slice and SliceAt may be called concurrently after Blur; everything else not.
#ifndef DEPTHTWEEN_CORE_BASELINES_PERMUTOHEDRAL_LATTICE_H_
#define DEPTHTWEEN_CORE_BASELINES_PERMUTOHEDRAL_LATTICE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace depthtween {

class PermutohedralLattice {
 public:
  static constexpr int kMaxDimension = 8;
  // A position's corners have 16-bit coordinates: no coordinate may lie further from 0, in sigmas.
  static constexpr float kMaxPosition = 2000.0F;

  // 1 <= dimension <= kMaxDimension, channels >= 1: values of one point.
  PermutohedralLattice(int dimension, int channels);

  // Makes room for the corners of a point (`dimension` coordinates within +-kMaxPosition) and returns its index, 0, 1,
  // ... Weight spreads only over corners of points that were added: add what will be read as well as what is given.
  int AddPoint(const float* position);
  // Adds `value` (`channels` numbers) at a point.
  void Splat(int point, const float* value);
  void Blur();
  // The filtered sum at a point that was added.
  void Slice(int point, float* value) const;
  // The same anywhere; corners that no point has count as 0.
  void SliceAt(const float* position, float* value) const;

  size_t corner_count() const { return keys_.size(); }

 private:
  // The first d coordinates of a lattice point; the last one follows, since they sum to zero.
  using Key = std::array<int16_t, kMaxDimension>;
  struct Simplex {
    std::array<Key, kMaxDimension + 1> corners = {};
    std::array<float, kMaxDimension + 1> weights = {};  // >= 0, sum 1
  };

  Simplex Enclosing(const float* position) const;
  // Where the table holds `key`, or the free slot for it.
  size_t SlotOf(const Key& key) const;
  int Find(const Key& key) const;  // -1 if absent
  int FindOrAdd(const Key& key);
  void Grow();

  const int dimension_, channels_;
  std::array<float, kMaxDimension> scale_ = {};
  std::vector<Key> keys_;             // of each corner, in the order they came
  std::vector<float> values_;         // channels_ of each corner
  std::vector<int> table_;            // open addressing: index into keys_, or -1
  std::vector<int> point_corners_;    // dimension_ + 1 of each point
  std::vector<float> point_weights_;  // the same
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASELINES_PERMUTOHEDRAL_LATTICE_H_
