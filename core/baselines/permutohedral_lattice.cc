#include "core/baselines/permutohedral_lattice.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>

namespace depthtween {
namespace {

constexpr size_t kFirstTable = 1024;  // slots, a power of two

}  // namespace

PermutohedralLattice::PermutohedralLattice(int dimension, int channels)
    : dimension_(dimension), channels_(channels), table_(kFirstTable, -1) {
  assert(dimension >= 1 && dimension <= kMaxDimension && channels >= 1);
  // Column i of the basis is (1, ..., 1, -(i+1), 0, ...) with i + 1 ones, of length sqrt((i+1)(i+2)).
  for (int i = 0; i < dimension; ++i)
    scale_[i] = static_cast<float>((dimension + 1) * std::sqrt(2.0 / 3.0) / std::sqrt((i + 1.0) * (i + 2.0)));
}

PermutohedralLattice::Simplex PermutohedralLattice::Enclosing(const float* position) const {
  const int d = dimension_, n = d + 1;
  // The position in the hyperplane: the basis times the position, by sums from the back.
  std::array<float, kMaxDimension + 1> lifted;
  float sum = 0.0F;
  for (int i = d - 1; i >= 0; --i) {
    assert(std::abs(position[i]) <= kMaxPosition);
    const float scaled = position[i] * scale_[i];
    lifted[i + 1] = sum - static_cast<float>(i + 1) * scaled;
    sum += scaled;
  }
  lifted[0] = sum;

  // The nearest lattice point whose coordinates are all multiples of n: round each; when the sum is off by k n, those
  // that were rounded furthest in the wrong direction go one step back.
  std::array<int, kMaxDimension + 1> base, rank = {};
  std::array<float, kMaxDimension + 1> rest;
  int excess = 0;
  for (int i = 0; i < n; ++i) {
    const int multiple = static_cast<int>(std::lround(lifted[i] / static_cast<float>(n)));
    base[i] = multiple * n;
    excess += multiple;
    rest[i] = lifted[i] - static_cast<float>(base[i]);
  }
  // rank: how many coordinates have a larger rest; equal ones in order.
  for (int i = 0; i < n; ++i)
    for (int j = i + 1; j < n; ++j) ++rank[rest[i] < rest[j] ? i : j];
  for (int i = 0; i < n; ++i) {
    rank[i] += excess;
    if (rank[i] < 0) {
      rank[i] += n;
      base[i] += n;
    } else if (rank[i] >= n) {
      rank[i] -= n;
      base[i] -= n;
    }
  }

  // In order of rank the rests descend from t_0 to t_d, and the point is base plus its rests: corner k of the simplex
  // is base plus k in the n - k coordinates of lowest rank and k - n in the others, its weight the step between
  // neighbouring rests over n.
  std::array<float, kMaxDimension + 1> by_rank;
  for (int i = 0; i < n; ++i) by_rank[rank[i]] = lifted[i] - static_cast<float>(base[i]);
  Simplex simplex;
  float others = 0.0F;
  for (int k = 1; k < n; ++k) {
    simplex.weights[k] = std::max(0.0F, (by_rank[n - 1 - k] - by_rank[n - k]) / static_cast<float>(n));
    others += simplex.weights[k];
  }
  simplex.weights[0] = std::max(0.0F, 1.0F - others);
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < d; ++i) simplex.corners[k][i] = static_cast<int16_t>(base[i] + (rank[i] < n - k ? k : k - n));
  return simplex;
}

size_t PermutohedralLattice::SlotOf(const Key& key) const {
  static_assert(sizeof(Key) == 16);
  uint64_t low, high;
  std::memcpy(&low, key.data(), 8);
  std::memcpy(&high, key.data() + 4, 8);
  uint64_t hash = (low ^ (high * 0x9E3779B97F4A7C15U)) * 0xD6E8FEB86659FD93U;
  hash ^= hash >> 32;
  hash *= 0xD6E8FEB86659FD93U;
  const size_t mask = table_.size() - 1;
  size_t slot = (hash ^ (hash >> 29)) & mask;
  while (table_[slot] >= 0 && keys_[table_[slot]] != key) slot = (slot + 1) & mask;
  return slot;
}

int PermutohedralLattice::Find(const Key& key) const { return table_[SlotOf(key)]; }

int PermutohedralLattice::FindOrAdd(const Key& key) {
  size_t slot = SlotOf(key);
  if (table_[slot] >= 0) return table_[slot];
  if (2 * (keys_.size() + 1) > table_.size()) {
    Grow();
    slot = SlotOf(key);
  }
  table_[slot] = static_cast<int>(keys_.size());
  keys_.push_back(key);
  values_.resize(values_.size() + channels_, 0.0F);
  return table_[slot];
}

void PermutohedralLattice::Grow() {
  table_.assign(2 * table_.size(), -1);
  for (size_t i = 0; i < keys_.size(); ++i) table_[SlotOf(keys_[i])] = static_cast<int>(i);
}

int PermutohedralLattice::AddPoint(const float* position) {
  const Simplex simplex = Enclosing(position);
  const int n = dimension_ + 1;
  const int point = static_cast<int>(point_corners_.size() / n);
  for (int k = 0; k < n; ++k) {
    point_corners_.push_back(FindOrAdd(simplex.corners[k]));
    point_weights_.push_back(simplex.weights[k]);
  }
  return point;
}

void PermutohedralLattice::Splat(int point, const float* value) {
  const size_t first = static_cast<size_t>(point) * (dimension_ + 1);
  for (size_t k = first; k < first + dimension_ + 1; ++k) {
    float* corner = values_.data() + static_cast<size_t>(point_corners_[k]) * channels_;
    for (int c = 0; c < channels_; ++c) corner[c] += point_weights_[k] * value[c];
  }
}

void PermutohedralLattice::Blur() {
  std::vector<float> blurred(values_.size());
  std::vector<int> ahead(keys_.size()), behind(keys_.size());
  for (int direction = 0; direction <= dimension_; ++direction) {
    std::fill(behind.begin(), behind.end(), -1);
    for (size_t i = 0; i < keys_.size(); ++i) {
      Key neighbour = keys_[i];
      for (int k = 0; k < dimension_; ++k)
        neighbour[k] = static_cast<int16_t>(neighbour[k] + (k == direction ? -dimension_ : 1));
      ahead[i] = Find(neighbour);
      if (ahead[i] >= 0) behind[ahead[i]] = static_cast<int>(i);
    }
    for (size_t i = 0; i < keys_.size(); ++i) {
      const float* own = values_.data() + i * channels_;
      float* out = blurred.data() + i * channels_;
      for (int c = 0; c < channels_; ++c) out[c] = 0.5F * own[c];
      for (const int at : {ahead[i], behind[i]}) {
        if (at < 0) continue;
        const float* value = values_.data() + static_cast<size_t>(at) * channels_;
        for (int c = 0; c < channels_; ++c) out[c] += 0.25F * value[c];
      }
    }
    values_.swap(blurred);
  }
}

void PermutohedralLattice::Slice(int point, float* value) const {
  std::fill_n(value, channels_, 0.0F);
  const size_t first = static_cast<size_t>(point) * (dimension_ + 1);
  for (size_t k = first; k < first + dimension_ + 1; ++k) {
    const float* corner = values_.data() + static_cast<size_t>(point_corners_[k]) * channels_;
    for (int c = 0; c < channels_; ++c) value[c] += point_weights_[k] * corner[c];
  }
}

void PermutohedralLattice::SliceAt(const float* position, float* value) const {
  std::fill_n(value, channels_, 0.0F);
  const Simplex simplex = Enclosing(position);
  for (int k = 0; k <= dimension_; ++k) {
    const int at = Find(simplex.corners[k]);
    if (at < 0) continue;
    const float* corner = values_.data() + static_cast<size_t>(at) * channels_;
    for (int c = 0; c < channels_; ++c) value[c] += simplex.weights[k] * corner[c];
  }
}

}  // namespace depthtween
