// The second level of the preconditioner. What block-Jacobi leaves is smooth, and smooth motions of a surface are
// nearly rigid, piece by piece.
//
// Nodes lie over the grid, `spacing` points apart. Each carries a rigid motion for every coefficient in time, and
// points take from the four nodes around them by hats, bilinear in the grid:
//     c_i = sum_a phi_a(i) (t_a + w_a x (p_i - centre_a)),    w_i = sum_a phi_a(i) w_a.
// Rigid motions are in that space, and motions that are linear in it. With c = P x, Correct adds
// P (P^T H P)^-1 P^T r. In P^T H P rotations count as at rest, where the edges of all coefficients have one matrix; the
// coefficients are turned so that the data hardly couple them, and what couplings remain are left out. That makes a
// band matrix for each. It decides how many steps are needed, not where they lead.
#ifndef DEPTHTWEEN_CORE_SOLVE_COARSE_SPACE_H_
#define DEPTHTWEEN_CORE_SOLVE_COARSE_SPACE_H_

#include <vector>

#include "core/solve/energy.h"

namespace depthtween {

// Unknowns of a rigid motion: translation, rotation.
constexpr int kRigid = 6;

// A symmetric positive matrix of blocks of kRigid x kRigid, zero further than `reach` blocks below its diagonal.
class BlockBand {
 public:
  BlockBand(int blocks, int reach);
  void Clear();
  // kRigid columns, of which lanes from kRigid on are zero. column <= row <= column + reach; all of blocks on the
  // diagonal counts.
  Lanes* Block(int row, int column) { return &lower_[Start(row, column)]; }
  // += of another one of the same shape.
  void Add(const BlockBand& other);
  // L D L^T in place, D inverted.
  void Factor();
  // x, a vector for each block, becomes what the factored matrix turns into x.
  void Solve(Lanes* x) const;

 private:
  size_t Start(int row, int column) const {
    return (static_cast<size_t>(column) * (reach_ + 1) + row - column) * kRigid;
  }
  int blocks_, reach_;
  std::vector<Lanes> lower_;  // by columns of blocks
  std::vector<Lanes> upper_;  // once factored, the transpose of each block of L
};

// Refers to `data`; holds scratch, so one thread at a time.
class CoarseSpace {
 public:
  // spacing >= 1, points.
  CoarseSpace(const EnergyData& data, int spacing);
  // Takes the matrix of the present unknowns: before the first Correct, and whenever it has changed much.
  void Factor(const NormalMatrix& matrix);
  // out += P (P^T H P)^-1 P^T r; returns r . what is added.
  double Correct(const Planes& r, Planes& out);

 private:
  // Nodes along one direction of the grid. They lie at points, so that no edge crosses one.
  struct Axis {
    Axis(int points, int spacing);
    int nodes() const { return static_cast<int>(place.size()); }
    std::vector<int> place;    // of each node
    std::vector<int> cell;     // each point lies between nodes cell and cell + 1, ...
    std::vector<float> share;  // ... at this share of the way
  };
  struct Cell;
  int nodes() const { return columns_.nodes() * rows_.nodes(); }
  int NodeAt(int column, int row) const {
    return columns_.nodes() <= rows_.nodes() ? row * columns_.nodes() + column : column * rows_.nodes() + row;
  }
  Lanes* Spread(int row, int k) {
    return &spread_[(static_cast<size_t>(row) * data_.rank() + k) * kRigid * data_.grid.blocks_per_row()];
  }
  void GatherPull(const NormalMatrix& matrix);
  Cell CellAt(int column, int row) const;
  void AddEdges(const Cell& cell);
  void AddPull(const Cell& cell, int k);
  void Restrict(const Planes& r);
  void Prolong(Planes& out);
  // From the coefficients of the grid to the turned ones; with -sine_ back.
  void Turn(float sine, std::vector<Lanes>& of) const;

  const EnergyData& data_;
  Axis columns_, rows_;
  Triple<float> origin_{};             // mean of the points
  std::vector<Triple<float>> centre_;  // of each node: mean of the points under its hat
  float cosine_ = 1, sine_ = 0;        // of the angle by which the two coefficients of a trajectory are turned
  Planes pull_;                        // matrix of the data of a point, for each turned coefficient: lower half
  BlockBand edges_;                    // of the edges, for any coefficient
  std::vector<BlockBand> matrices_;    // of all, for each turned coefficient
  std::vector<Lanes> spread_;          // [row of nodes][coefficient][kRigid][eight points]: between grid and nodes
  std::vector<Lanes> forces_, moves_;  // [coefficient][node]
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_COARSE_SPACE_H_
