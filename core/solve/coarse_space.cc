#include "core/solve/coarse_space.h"

#include <algorithm>
#include <cmath>

#include "core/solve/reg_term.h"

namespace depthtween {
namespace {

using Point8 = Triple<Lanes>;

constexpr int kCorners = 4;
constexpr int kPairs = kCorners * (kCorners + 1) / 2;
// Rounding of single precision can eat a pivot that has almost no information of its own: share of what it was.
constexpr float kLeastPivot = 1e-6F;

// Where eight points of a row are between the nodes of a cell.
struct Hats {
  Lanes x, y;  // shares of the way to the second column, to the second row
  Lanes Of(int corner) const { return (corner % 2 ? x : 1.0F - x) * (corner / 2 ? y : 1.0F - y); }
};

// A 3 x 3 matrix, as rows.
struct Matrix3 {
  Triple<float> row[3];
};
Matrix3 Symmetric(const float* lower) {
  return {{{lower[0], lower[1], lower[3]}, {lower[1], lower[2], lower[4]}, {lower[3], lower[4], lower[5]}}};
}
Matrix3 Transposed(const Matrix3& a) {
  return {{{a.row[0].x, a.row[1].x, a.row[2].x},
           {a.row[0].y, a.row[1].y, a.row[2].y},
           {a.row[0].z, a.row[1].z, a.row[2].z}}};
}
Matrix3 operator+(const Matrix3& a, const Matrix3& b) {
  return {{a.row[0] + b.row[0], a.row[1] + b.row[1], a.row[2] + b.row[2]}};
}
Matrix3 operator*(float s, const Matrix3& a) { return {{s * a.row[0], s * a.row[1], s * a.row[2]}}; }
// a [v], where [v] p = v x p.
Matrix3 TimesCross(const Matrix3& a, const Triple<float>& v) {
  return {{Cross(a.row[0], v), Cross(a.row[1], v), Cross(a.row[2], v)}};
}

// What a quadratic form H of a point's motion says to the rigid motions of corners a and b. With q the way to the point
// from the middle of the cell and d_a the way to there from the corner, it moves by t_a - [q + d_a] w_a. Summed are
// H, H [q] and [q]^T H [q], times both hats: 6, 9 and 6 numbers, symmetric matrices as xx yx yy zx zy zz.
constexpr int kFormSums = 6 + 9 + 6;
void FormOf(const Lanes* h, const Point8& q, Lanes* sums) {
  const Point8 g[3] = {Cross(Point8{h[0], h[1], h[3]}, q), Cross(Point8{h[1], h[2], h[4]}, q),
                       Cross(Point8{h[3], h[4], h[5]}, q)};
  const Point8 x = Cross(Point8{g[0].x, g[1].x, g[2].x}, q), y = Cross(Point8{g[0].y, g[1].y, g[2].y}, q);
  const Point8 z = Cross(Point8{g[0].z, g[1].z, g[2].z}, q);
  const Lanes all[kFormSums] = {h[0],   h[1],   h[2],   h[3],   h[4], h[5], g[0].x, g[0].y, g[0].z, g[1].x, g[1].y,
                                g[1].z, g[2].x, g[2].y, g[2].z, x.x,  x.y,  y.y,    x.z,    y.z,    z.z};
  std::copy_n(all, kFormSums, sums);
}
// Of |sum over a of difference_a (t_a - [q + d_a] w_a)|^2, as an edge says it of either end: 1, q and q q^T are enough,
// times both differences of hats.
constexpr int kEdgeSums = 1 + 3 + 6;
void FormOfEdge(const float* s, float* sums) {
  const float square = s[4] + s[6] + s[9];
  const float all[kFormSums] = {
      s[0],          0,     s[0],          0,     0,     s[0],         0, -s[3], s[2], s[3], 0, -s[1], -s[2], s[1], 0,
      square - s[4], -s[5], square - s[6], -s[7], -s[8], square - s[9]};
  std::copy_n(all, kFormSums, sums);
}

// Adds the block of corners a, b with the ways d_a, d_b, and `turn` on the diagonal of rotations, to the lower half.
void AddForm(const float* sums, const Triple<float>& way_a, const Triple<float>& way_b, float turn, int a, int b,
             BlockBand& matrix) {
  const Matrix3 h = Symmetric(sums),
                hq{{{sums[6], sums[7], sums[8]}, {sums[9], sums[10], sums[11]}, {sums[12], sums[13], sums[14]}}};
  const Matrix3 of_a = hq + TimesCross(h, way_a), of_b = hq + TimesCross(h, way_b);  // H [q + d]
  // [q + d_a]^T H [q + d_b]
  Matrix3 turns =
      Symmetric(sums + 15) + TimesCross(Transposed(hq), way_b) + Transposed(TimesCross(Transposed(of_b), way_a));
  turns.row[0].x += turn, turns.row[1].y += turn, turns.row[2].z += turn;
  const Matrix3 parts[2][2] = {{h, -1.0F * of_b}, {-1.0F * Transposed(of_a), turns}};
  Lanes* const to = a >= b ? matrix.Block(a, b) : matrix.Block(b, a);
  for (int i = 0; i < kRigid; ++i)
    for (int part = 0; part < 2; ++part) {
      const Triple<float>& row = parts[i / 3][part].row[i % 3];
      const float values[3] = {row.x, row.y, row.z};
      for (int j = 0; j < 3; ++j) (a >= b ? to[3 * part + j][i] : to[i][3 * part + j]) += values[j];
    }
}

// A symmetric positive kRigid x kRigid matrix, as columns, becomes its inverse.
void Invert(const float* least_pivot, Lanes* columns) {
  double l[kRigid][kRigid], inverse[kRigid][kRigid], over_d[kRigid];  // A = L D L^T; inverse: of L
  for (int i = 0; i < kRigid; ++i) {
    double pivot = columns[i][i], scaled[kRigid];  // L D
    for (int j = 0; j < i; ++j) {
      scaled[j] = columns[j][i];
      for (int k = 0; k < j; ++k) scaled[j] -= scaled[k] * l[j][k];
      l[i][j] = scaled[j] * over_d[j];
      pivot -= scaled[j] * l[i][j];
    }
    over_d[i] = 1 / std::max(pivot, static_cast<double>(least_pivot[i]));
    inverse[i][i] = 1;
    for (int j = 0; j < i; ++j) {
      inverse[i][j] = 0;
      for (int k = j; k < i; ++k) inverse[i][j] -= l[i][k] * inverse[k][j];
    }
  }
  for (int i = 0; i < kRigid; ++i)
    for (int j = 0; j <= i; ++j) {
      double sum = 0;
      for (int k = i; k < kRigid; ++k) sum += inverse[k][i] * over_d[k] * inverse[k][j];
      columns[i][j] = columns[j][i] = static_cast<float>(sum);
    }
}

}  // namespace

BlockBand::BlockBand(int blocks, int reach)
    : blocks_(blocks),
      reach_(std::min(reach, blocks - 1)),
      lower_(static_cast<size_t>(blocks_) * (reach_ + 1) * kRigid),
      upper_(lower_.size()) {}

void BlockBand::Clear() { std::fill(lower_.begin(), lower_.end(), Lanes{}); }

void BlockBand::Add(const BlockBand& other) {
  for (size_t i = 0; i < lower_.size(); ++i) lower_[i] += other.lower_[i];
}

void BlockBand::Factor() {
  std::vector<float> least(static_cast<size_t>(blocks_) * kRigid);
  for (int n = 0; n < blocks_; ++n)
    for (int i = 0; i < kRigid; ++i) least[n * kRigid + i] = std::max(kLeastPivot * Block(n, n)[i][i], 1e-20F);
  std::vector<Lanes> scaled(static_cast<size_t>(reach_ + 1) * kRigid);
  for (int n = 0; n < blocks_; ++n) {
    Invert(&least[static_cast<size_t>(n) * kRigid], Block(n, n));
    const Lanes* const inverse = Block(n, n);
    const int end = std::min(reach_, blocks_ - 1 - n);
    for (int m = 1; m <= end; ++m) {
      const Lanes* const own = Block(n + m, n);
      Lanes* const to = &scaled[static_cast<size_t>(m) * kRigid];
      for (int c = 0; c < kRigid; ++c) {
        Lanes sum{};
        for (int r = 0; r < kRigid; ++r) sum += inverse[c][r] * own[r];
        to[c] = sum;
      }
    }
    for (int l = 1; l <= end; ++l) {
      const Lanes* const other = Block(n + l, n);
      for (int m = l; m <= end; ++m) {
        const Lanes* const own = &scaled[static_cast<size_t>(m) * kRigid];
        Lanes* const to = Block(n + m, n + l);
        for (int c = 0; c < kRigid; ++c) {
          Lanes sum = to[c];
          for (int r = 0; r < kRigid; ++r) sum -= other[r][c] * own[r];
          to[c] = sum;
        }
      }
    }
    for (int m = 1; m <= end; ++m) {
      Lanes* const lower = Block(n + m, n);
      Lanes* const upper = &upper_[Start(n + m, n)];
      for (int c = 0; c < kRigid; ++c) {
        lower[c] = scaled[static_cast<size_t>(m) * kRigid + c];
        for (int r = 0; r < kRigid; ++r) upper[r][c] = lower[c][r];
      }
    }
  }
}

void BlockBand::Solve(Lanes* x) const {
  const auto times = [](const Lanes* columns, const Lanes& v) {
    return (v[0] * columns[0] + v[1] * columns[1]) + (v[2] * columns[2] + v[3] * columns[3]) +
           (v[4] * columns[4] + v[5] * columns[5]);
  };
  for (int n = 0; n < blocks_; ++n) {
    const Lanes own = x[n];
    const int end = std::min(reach_, blocks_ - 1 - n);
    for (int m = 1; m <= end; ++m) x[n + m] -= times(&lower_[Start(n + m, n)], own);
  }
  for (int n = blocks_ - 1; n >= 0; --n) {
    Lanes sum = times(&lower_[Start(n, n)], x[n]);
    const int end = std::min(reach_, blocks_ - 1 - n);
    for (int m = 1; m <= end; ++m) sum -= times(&upper_[Start(n + m, n)], x[n + m]);
    x[n] = sum;
  }
}

CoarseSpace::Axis::Axis(int points, int spacing) : cell(points), share(points) {
  const int cells = std::max(1, (points - 2 + spacing) / spacing);
  for (int n = 0; n <= cells; ++n) place.push_back((n * (points - 1) + cells / 2) / cells);
  for (int p = 0, c = 0; p < points; ++p) {
    if (c + 1 < cells && p >= place[c + 1]) ++c;
    cell[p] = c;
    share[p] =
        place[c + 1] > place[c] ? static_cast<float>(p - place[c]) / static_cast<float>(place[c + 1] - place[c]) : 0.0F;
  }
}

CoarseSpace::CoarseSpace(const EnergyData& data, int spacing)
    : data_(data),
      columns_(data.grid.width, spacing),
      rows_(data.grid.height, spacing),
      centre_(nodes()),
      pull_(data.grid, 6 * data.rank()),
      edges_(nodes(), std::min(columns_.nodes(), rows_.nodes()) + 1),
      matrices_(data.rank(), edges_),
      spread_(static_cast<size_t>(rows_.nodes()) * kRigid * data.rank() * data.grid.blocks_per_row()),
      forces_(static_cast<size_t>(nodes()) * data.rank()),
      moves_(forces_.size()) {
  const Grid& grid = data.grid;
  std::vector<float> weight(nodes());
  float points = 0;
  for (int y = 0; y < grid.height; ++y)
    for (int x = 0; x < grid.width; ++x) {
      const ptrdiff_t at = grid.at(x, y);
      if (data.exists[0][at] == 0) continue;
      const Triple<float> p{data.point[0][at], data.point[1][at], data.point[2][at]};
      origin_ = origin_ + p, points += 1;
      for (int corner = 0; corner < kCorners; ++corner) {
        const float hat = (corner % 2 ? columns_.share[x] : 1 - columns_.share[x]) *
                          (corner / 2 ? rows_.share[y] : 1 - rows_.share[y]);
        const int node = NodeAt(columns_.cell[x] + corner % 2, rows_.cell[y] + corner / 2);
        centre_[node] = centre_[node] + hat * p, weight[node] += hat;
      }
    }
  origin_ = 1.0F / std::max(points, 1.0F) * origin_;
  for (int node = 0; node < nodes(); ++node)
    centre_[node] = weight[node] > 0 ? 1.0F / weight[node] * centre_[node] : origin_;
}

void CoarseSpace::GatherPull(const NormalMatrix& matrix) {
  const PointBlocks& motion = matrix.motion();
  const bool turned = !data_.basis.per_frame() && data_.rank() == 2;
  const auto entry = [&](const Lanes* block, int row, int column) {
    return row >= column ? block[motion.at(row, column)] : block[motion.at(column, row)];
  };
  if (turned) {
    Lanes first{}, second{}, both{};
    data_.grid.ForEachBlock([&](ptrdiff_t at, int b) {
      const Lanes* const block = motion.block(b);
      const Lanes exists = LoadLanes(data_.exists[0] + at);
      for (int axis = 0; axis < 3; ++axis) {
        first += exists * entry(block, axis, axis);
        second += exists * entry(block, 3 + axis, 3 + axis);
        both += exists * entry(block, 3 + axis, axis);
      }
    });
    const float angle = 0.5F * std::atan2(2 * SumLanes(both), SumLanes(first) - SumLanes(second));
    cosine_ = std::cos(angle), sine_ = std::sin(angle);
  }
  constexpr int kLower[6][2] = {{0, 0}, {1, 0}, {1, 1}, {2, 0}, {2, 1}, {2, 2}};
  data_.grid.ForEachBlock([&](ptrdiff_t at, int b) {
    const Lanes* const block = motion.block(b);
    const Lanes exists = LoadLanes(data_.exists[0] + at);
    for (int i = 0; i < 6; ++i) {
      const auto [r, c] = kLower[i];
      if (!turned) {
        for (int k = 0; k < data_.rank(); ++k)
          StoreLanes(pull_[6 * k + i] + at, exists * entry(block, 3 * k + r, 3 * k + c));
        continue;
      }
      const Lanes first = entry(block, r, c), second = entry(block, 3 + r, 3 + c);
      const Lanes both = cosine_ * sine_ * (entry(block, 3 + r, c) + entry(block, 3 + c, r));
      StoreLanes(pull_[i] + at, exists * (cosine_ * cosine_ * first + sine_ * sine_ * second + both));
      StoreLanes(pull_[6 + i] + at, exists * (sine_ * sine_ * first + cosine_ * cosine_ * second - both));
    }
  });
}

// Four nodes and the points between them.
struct CoarseSpace::Cell {
  int x0, x1, y0, y1;    // of the nodes
  int x_end, y_end;      // its own points end before; the last cell of a row has those at its end too
  float step_x, step_y;  // of hats, per point
  int node[kCorners];
  Triple<float> middle, way[kCorners];  // from each corner to the middle

  // body(index of eight points, number of the first in its row, its row): all points up to x1, and own rows.
  template <typename Body>
  void ForEachEight(const Grid& grid, const Body& body) const {
    for (int y = y0; y < y_end; ++y)
      for (int x = x0; x <= x1; x += kLanes) body(grid.at(x, y), x, y);
  }
  Hats HatsAt(int x, int y) const {
    return {(static_cast<float>(x - x0) + kNumber) * step_x, AllLanes(static_cast<float>(y - y0) * step_y)};
  }
  // Which of eight points from x on are in [first, end).
  static LaneInts Within(int x, int first, int end) {
    return (kNumber >= static_cast<float>(first - x)) & (kNumber < static_cast<float>(end - x));
  }
  static constexpr Lanes kNumber = {0, 1, 2, 3, 4, 5, 6, 7};
};

CoarseSpace::Cell CoarseSpace::CellAt(int column, int row) const {
  Cell cell{.x0 = columns_.place[column],
            .x1 = columns_.place[column + 1],
            .y0 = rows_.place[row],
            .y1 = rows_.place[row + 1]};
  cell.x_end = column + 2 == columns_.nodes() ? cell.x1 + 1 : cell.x1;
  cell.y_end = row + 2 == rows_.nodes() ? cell.y1 + 1 : cell.y1;
  cell.step_x = 1.0F / static_cast<float>(std::max(1, cell.x1 - cell.x0));
  cell.step_y = 1.0F / static_cast<float>(std::max(1, cell.y1 - cell.y0));
  for (int a = 0; a < kCorners; ++a) {
    cell.node[a] = NodeAt(column + a % 2, row + a / 2);
    cell.middle = cell.middle + 0.25F * centre_[cell.node[a]];
  }
  for (int a = 0; a < kCorners; ++a) cell.way[a] = cell.middle - centre_[cell.node[a]];
  return cell;
}

// A rigid motion of all corners moves no edge, so that an edge sees differences of hats only.
void CoarseSpace::AddEdges(const Cell& cell) {
  const Point8 middle{AllLanes(cell.middle.x), AllLanes(cell.middle.y), AllLanes(cell.middle.z)};
  Lanes forms[kPairs][kEdgeSums] = {}, reg_sums[kPairs] = {};
  cell.ForEachEight(data_.grid, [&](ptrdiff_t at, int x, int y) {
    const Hats here = cell.HatsAt(x, y);
    const Point8 p = LoadPoint(data_.point, 0, at) - middle;
    for (int d = 0; d < 4; ++d) {
      const auto [dx, dy] = kEdgeSteps[d];
      if (dy > 0 && y >= cell.y1) continue;  // leads out of the grid
      const int first = dx < 0 ? cell.x0 + 1 : cell.x0, end = dx == 0 ? cell.x_end : dx > 0 ? cell.x1 : cell.x1 + 1;
      const Lanes strain = KeepLanes(Cell::Within(x, first, end), LoadLanes(data_.strain[d] + at));
      const Point8 q = LoadPoint(data_.point, 0, at + dy * data_.grid.stride() + dx) - middle;
      const Point8 edge = p - q, both = p + q;
      const Lanes rigid = data_.weights.rigid * strain,
                  reg = kRegPair * data_.weights.reg * RegArea(data_, edge) * strain;
      const Lanes sums[kEdgeSums] = {2.0F * rigid,
                                     rigid * both.x,
                                     rigid * both.y,
                                     rigid * both.z,
                                     rigid * (p.x * p.x + q.x * q.x),
                                     rigid * (p.y * p.x + q.y * q.x),
                                     rigid * (p.y * p.y + q.y * q.y),
                                     rigid * (p.z * p.x + q.z * q.x),
                                     rigid * (p.z * p.y + q.z * q.y),
                                     rigid * (p.z * p.z + q.z * q.z)};
      const Hats there{here.x + static_cast<float>(dx) * cell.step_x, here.y + static_cast<float>(dy) * cell.step_y};
      Lanes difference[kCorners];
      for (int a = 0; a < kCorners; ++a) difference[a] = here.Of(a) - there.Of(a);
      for (int a = 0, pair = 0; a < kCorners; ++a)
        for (int b = 0; b <= a; ++b, ++pair) {
          const Lanes product = difference[a] * difference[b];
          for (int i = 0; i < kEdgeSums; ++i) forms[pair][i] += product * sums[i];
          reg_sums[pair] += product * reg;
        }
    }
  });
  for (int a = 0, pair = 0; a < kCorners; ++a)
    for (int b = 0; b <= a; ++b, ++pair) {
      float sums[kEdgeSums], form[kFormSums];
      for (int i = 0; i < kEdgeSums; ++i) sums[i] = SumLanes(forms[pair][i]);
      FormOfEdge(sums, form);
      AddForm(form, cell.way[a], cell.way[b], SumLanes(reg_sums[pair]), cell.node[a], cell.node[b], edges_);
    }
}

void CoarseSpace::AddPull(const Cell& cell, int k) {
  const Point8 middle{AllLanes(cell.middle.x), AllLanes(cell.middle.y), AllLanes(cell.middle.z)};
  // Products of two hats differ in how many of their factors are of the second column, of the second row.
  Lanes forms[9][kFormSums] = {}, damping[9] = {};
  cell.ForEachEight(data_.grid, [&](ptrdiff_t at, int x, int y) {
    const LaneInts own = Cell::Within(x, cell.x0, cell.x_end);
    const Lanes exists = KeepLanes(own, LoadLanes(data_.exists[0] + at));
    Lanes h[6], sums[kFormSums];
    for (int i = 0; i < 6; ++i) h[i] = KeepLanes(own, LoadLanes(pull_[6 * k + i] + at));
    FormOf(h, LoadPoint(data_.point, 0, at) - middle, sums);
    const Hats hats = cell.HatsAt(x, y);
    const Lanes along_x[3] = {(1.0F - hats.x) * (1.0F - hats.x), (1.0F - hats.x) * hats.x, hats.x * hats.x};
    const Lanes along_y[3] = {(1.0F - hats.y) * (1.0F - hats.y), (1.0F - hats.y) * hats.y, hats.y * hats.y};
    for (int n = 0; n < 9; ++n) {
      const Lanes product = along_x[n % 3] * along_y[n / 3];
      for (int i = 0; i < kFormSums; ++i) forms[n][i] += product * sums[i];
      damping[n] += product * exists;
    }
  });
  float sums[9][kFormSums];
  for (int n = 0; n < 9; ++n)
    for (int i = 0; i < kFormSums; ++i) sums[n][i] = SumLanes(forms[n][i]);
  for (int a = 0; a < kCorners; ++a)
    for (int b = 0; b <= a; ++b) {
      const int n = a % 2 + b % 2 + 3 * (a / 2 + b / 2);
      AddForm(sums[n], cell.way[a], cell.way[b], kDamping * SumLanes(damping[n]), cell.node[a], cell.node[b],
              matrices_[k]);
    }
}

void CoarseSpace::Factor(const NormalMatrix& matrix) {
  GatherPull(matrix);
  edges_.Clear();
  for (BlockBand& of : matrices_) of.Clear();
  for (int row = 0; row + 1 < rows_.nodes(); ++row)
    for (int column = 0; column + 1 < columns_.nodes(); ++column) {
      const Cell cell = CellAt(column, row);
      AddEdges(cell);
      for (int k = 0; k < data_.rank(); ++k) AddPull(cell, k);
    }
  for (BlockBand& of : matrices_) {
    of.Add(edges_);
    of.Factor();
  }
}

void CoarseSpace::Turn(float sine, std::vector<Lanes>& of) const {
  if (sine == 0) return;
  for (int node = 0; node < nodes(); ++node) {
    const Lanes first = of[node], second = of[nodes() + node];
    of[node] = cosine_ * first + sine * second;
    of[nodes() + node] = cosine_ * second - sine * first;
  }
}

void CoarseSpace::Restrict(const Planes& r) {
  const Grid& grid = data_.grid;
  const int rank = data_.rank(), per_row = grid.blocks_per_row();
  const Point8 origin{AllLanes(origin_.x), AllLanes(origin_.y), AllLanes(origin_.z)};
  std::fill(spread_.begin(), spread_.end(), Lanes{});
  for (int y = 0; y < grid.height; ++y)
    for (int b = 0; b < per_row; ++b) {
      const ptrdiff_t at = grid.at(b * kLanes, y);
      const Lanes exists = LoadLanes(data_.exists[0] + at);
      const Point8 way = LoadPoint(data_.point, 0, at) - origin;
      for (int k = 0; k < rank; ++k) {
        const Point8 force = exists * LoadPoint(r, 3 * k, at);
        const Point8 torque = exists * LoadPoint(r, data_.first_turn() + 3 * k, at) + Cross(way, force);
        const Lanes values[kRigid] = {force.x, force.y, force.z, torque.x, torque.y, torque.z};
        Lanes* const above = Spread(rows_.cell[y], k) + b;
        Lanes* const below = Spread(rows_.cell[y] + 1, k) + b;
        for (int i = 0; i < kRigid; ++i) {
          const Lanes there = rows_.share[y] * values[i];
          above[i * per_row] += values[i] - there, below[i * per_row] += there;
        }
      }
    }
  std::fill(forces_.begin(), forces_.end(), Lanes{});
  for (int k = 0; k < rank; ++k) {
    Lanes* const forces = &forces_[static_cast<size_t>(k) * nodes()];
    for (int row = 0; row < rows_.nodes(); ++row)
      for (int i = 0; i < kRigid; ++i) {
        const float* const values = reinterpret_cast<const float*>(Spread(row, k) + i * per_row);
        for (int column = 0, x = 0; column + 1 < columns_.nodes(); ++column) {
          float all = 0, there = 0;
          for (; x < grid.width && columns_.cell[x] == column; ++x)
            all += values[x], there += columns_.share[x] * values[x];
          forces[NodeAt(column, row)][i] += all - there;
          forces[NodeAt(column + 1, row)][i] += there;
        }
      }
    for (int node = 0; node < nodes(); ++node) {
      Lanes& own = forces[node];
      const Triple<float> torque = Cross(origin_ - centre_[node], Triple<float>{own[0], own[1], own[2]});
      own[3] += torque.x, own[4] += torque.y, own[5] += torque.z;
    }
  }
}

void CoarseSpace::Prolong(Planes& out) {
  const Grid& grid = data_.grid;
  const int rank = data_.rank(), per_row = grid.blocks_per_row();
  for (int k = 0; k < rank; ++k) {
    Lanes* const moves = &moves_[static_cast<size_t>(k) * nodes()];
    for (int node = 0; node < nodes(); ++node) {
      Lanes& own = moves[node];
      const Triple<float> move = Cross(Triple<float>{own[3], own[4], own[5]}, origin_ - centre_[node]);
      own[0] += move.x, own[1] += move.y, own[2] += move.z;
    }
    for (int row = 0; row < rows_.nodes(); ++row)
      for (int i = 0; i < kRigid; ++i) {
        float* const values = reinterpret_cast<float*>(Spread(row, k) + i * per_row);
        for (int column = 0, x = 0; column + 1 < columns_.nodes(); ++column) {
          const float here = moves[NodeAt(column, row)][i], step = moves[NodeAt(column + 1, row)][i] - here;
          for (; x < grid.width && columns_.cell[x] == column; ++x) values[x] = here + columns_.share[x] * step;
        }
      }
  }
  const Point8 origin{AllLanes(origin_.x), AllLanes(origin_.y), AllLanes(origin_.z)};
  for (int y = 0; y < grid.height; ++y)
    for (int b = 0; b < per_row; ++b) {
      const ptrdiff_t at = grid.at(b * kLanes, y);
      const Lanes exists = LoadLanes(data_.exists[0] + at);
      const Point8 way = LoadPoint(data_.point, 0, at) - origin;
      for (int k = 0; k < rank; ++k) {
        const Lanes* const above = Spread(rows_.cell[y], k) + b;
        const Lanes* const below = Spread(rows_.cell[y] + 1, k) + b;
        Lanes v[kRigid];
        for (int i = 0; i < kRigid; ++i)
          v[i] = exists * (above[i * per_row] + rows_.share[y] * (below[i * per_row] - above[i * per_row]));
        const Point8 turn{v[3], v[4], v[5]}, move = Point8{v[0], v[1], v[2]} + Cross(turn, way);
        StorePoint(out, 3 * k, at, LoadPoint(out, 3 * k, at) + move);
        const int plane = data_.first_turn() + 3 * k;
        StorePoint(out, plane, at, LoadPoint(out, plane, at) + turn);
      }
    }
}

double CoarseSpace::Correct(const Planes& r, Planes& out) {
  Restrict(r);
  Turn(sine_, forces_);
  moves_ = forces_;
  Lanes product{};
  for (int k = 0; k < data_.rank(); ++k) {
    const size_t first = static_cast<size_t>(k) * nodes();
    matrices_[k].Solve(&moves_[first]);
    for (int node = 0; node < nodes(); ++node) product += forces_[first + node] * moves_[first + node];
  }
  Turn(-sine_, moves_);
  Prolong(out);
  return SumLanes(product);
}

}  // namespace depthtween
