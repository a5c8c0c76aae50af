// The energy of one level: what its terms look at, its value, and its normal equations.
//
//   E(c, w) = sum over points and frames of
//       opti rho_c(opti)  +  proj O rho(step)  +  proj O rho(track)                  (frames 1..g)
//     + point rho(point)  +  plane rho(plane)                                        (frame g)
//     + rigid sum_j strain_ij |rigid_ij|^2  +  reg sum_j strain_ij |e_ij|^2 |reg_ij|^2   (8 neighbours j)
//     + short (|acceleration|^2 + 1e-3 |step|^2)
//
// Each residual has a header of its own (*_term.h). Unknowns: for each point `rank` coefficients of its motion c
// (metres) and of its rotation vector w (radians); see time_basis.h. Everything that is looked up in images is frozen
// in an EnergyData between two associations, so that this is a closed function which tests can hand to another solver.
#ifndef DEPTHTWEEN_CORE_SOLVE_ENERGY_H_
#define DEPTHTWEEN_CORE_SOLVE_ENERGY_H_

#include <vector>

#include "core/solve/planes.h"
#include "core/solve/time_basis.h"
#include "core/solve/triple.h"

namespace depthtween {

// Weights of the terms: pure numbers, since every residual is in units of its own deviation. 0 switches a term off.
struct TermWeights {
  float opti = 0, point = 0, plane = 0, proj = 0, rigid = 0, reg = 0, shortest = 0;
};

// What one frame's images say about each point.
struct FrameData {
  // Planes, each empty or as many as named.
  Planes track;  // u, v: pixel by composed flow; O: its weight
  Planes step;   // u, v: motion from the frame before, pixels; O: its weight
  Planes opti;   // difference, slope u, slope v, at u, at v (opti_term.h); O: its weight
  float over_track_sigma = 0, over_step_sigma = 0;  // 1/pixels
};

struct EnergyData {
  Grid grid;
  Pinhole<float> camera{};
  TimeBasis basis = TimeBasis::PerFrame(1);
  std::vector<float> times;  // of the frames, intervals from the key
  TermWeights weights;
  float over_opti_sigma = 0;          // 1/colour
  float over_acceleration_sigma = 0;  // interval^2/pixels
  // Planes.
  Planes point;   // x, y, z in the key, metres; (0, 0, 1) where there is none
  Planes exists;  // 1 or 0
  Planes strain;  // of the edges to right, below, below right, below left: w_ij/(|e|^2 sigma_strain^2), 1/m^2; 0 = cut
  Planes footprint;  // 1: over the size of a pixel at the point, 1/m
  Planes partner;    // x, y, z, normal x, y, z in the other key; 1/sigma of point, of plane, 1/m; 0 = none
  std::vector<FrameData> frames;

  int rank() const { return basis.rank(); }
  // Planes of unknowns: motion coefficient k, axis a at 3 k + a; then rotations in the same order.
  int unknowns() const { return 6 * rank(); }
  int first_turn() const { return 3 * rank(); }
};

// Symmetric positive definite blocks of the motions of each point, 3 rank x 3 rank, of which a band is stored: all of
// it for trajectories, two frames to either side for frames by themselves.
class MotionBlocks {
 public:
  MotionBlocks(const Grid& grid, const TimeBasis& basis);
  int size() const { return size_; }
  int band() const { return band_; }
  int per_block() const { return per_block_; }
  // Entry (row, column), column <= row <= column + band, of eight points.
  int at(int row, int column) const { return row_start_[row] + column; }
  Lanes* block(int block) { return values_.data() + static_cast<size_t>(block) * per_block_; }
  const Lanes* block(int block) const { return values_.data() + static_cast<size_t>(block) * per_block_; }
  // L D L^T in place, D inverted.
  void Factor();
  // In place: x becomes what the factored block turns into x. `x` has `size` entries.
  void Solve(int block, Lanes* x) const;

 private:
  int size_, band_, per_block_;
  std::vector<int> row_start_;
  std::vector<Lanes> values_;
};

// Value, gradient and data blocks at some unknowns.
struct Linearisation {
  explicit Linearisation(const EnergyData& data)
      : gradient(data.grid, data.unknowns()), blocks(data.grid, data.basis) {}
  double cost = 0;
  Planes gradient;      // half the derivative of E
  MotionBlocks blocks;  // Gauss-Newton matrix of all terms but rigid and reg: those are applied from `strain`
};

// The unknowns' energy; fills `out`.
void Linearise(const EnergyData& data, const Planes& unknowns, Linearisation& out);
// Its value alone.
double CostOf(const EnergyData& data, const Planes& unknowns);

// out = H x, the Gauss-Newton matrix with the rotations of edges taken at rest; returns x . H x.
double ApplyNormalMatrix(const EnergyData& data, const MotionBlocks& blocks, const Planes& x, Planes& out);

// Block-Jacobi: the motions of a point with all their couplings in time, its rotations.
class Preconditioner {
 public:
  // Takes the data blocks over.
  Preconditioner(const EnergyData& data, const MotionBlocks& blocks);
  // out = M^-1 r; returns r . out.
  double Apply(const EnergyData& data, const Planes& r, Planes& out) const;

 private:
  MotionBlocks motion_;
  std::vector<Lanes> turn_;  // six entries of the inverse of the rotation block, the same for every coefficient
};

// Where a point is at a frame (0 = the first after the key) and how it has turned; of eight points from index `at` on.
Triple<Lanes> MotionAt(const EnergyData& data, const Planes& unknowns, int frame, ptrdiff_t at);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_ENERGY_H_
