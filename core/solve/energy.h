// The energy of one level: what its terms look at, its value, and its normal equations.
//
//   E(c, w) = sum over points and frames of
//       opti rho_c(opti)  +  proj O rho(step)  +  proj O rho(track)                  (frames 1..g)
//     + point rho(point)  +  plane rho(plane)                                        (frame g)
//     + rigid sum_j strain_ij |rigid_ij|^2  +  reg sum_j strain_ij |e_ij|^2 |reg_ij|^2   (8 neighbours j)
//     + short (|acceleration|^2 + 1e-3 |step|^2)
//
// rho, the strain in place of metres, and what E_short penalises can take the paper's published form: PrintedChoices.
//
// Each residual has a header of its own (*_term.h). Unknowns: for each point `rank` coefficients of its motion c
// (metres) and of its rotation vector w (radians); see time_basis.h. Everything that is looked up in images is frozen
// in an EnergyData between two associations, so that this is a closed function which tests can hand to another solver.
#ifndef DEPTHTWEEN_CORE_SOLVE_ENERGY_H_
#define DEPTHTWEEN_CORE_SOLVE_ENERGY_H_

#include <vector>

#include "core/solve/planes.h"
#include "core/solve/short_term.h"
#include "core/solve/time_basis.h"
#include "core/solve/triple.h"

namespace depthtween {

// The edges that a point has: to the right, below, below right, below left.
constexpr int kEdgeSteps[4][2] = {{1, 0}, {0, 1}, {1, 1}, {-1, 1}};

// Keeps the steps of points that nothing holds small: added to the matrix, not to the energy, per footprint and per
// radian.
constexpr float kDamping = 1e-4F;

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
  float outlier2 = 9;                 // of E_point, E_plane, E_proj: squared deviations from where on residuals pull no
                                      // more; infinite: squares without a kernel
  float steps_share = kPrintedShortShare;  // of |step|^2 in E_short
  bool in_metres = false;                  // `strain` is 1/m^2 for edges of any length, and counts in E_reg as it is
  // Planes.
  Planes point;      // x, y, z in the key, metres; (0, 0, 1) where there is none
  Planes exists;     // 1 or 0
  Planes strain;     // of the edges along kEdgeSteps: w_ij/(|e|^2 sigma_strain^2), 1/m^2; 0 = cut
  Planes footprint;  // 1: over the size of a pixel at the point, 1/m
  Planes partner;    // x, y, z, normal x, y, z in the other key; 1/sigma of point, of plane, 1/m; 0 = none
  std::vector<FrameData> frames;

  int rank() const { return basis.rank(); }
  // Planes of unknowns: motion coefficient k, axis a at 3 k + a; then rotations in the same order.
  int unknowns() const { return 6 * rank(); }
  int first_turn() const { return 3 * rank(); }
};

// What the strain of an edge is multiplied by in E_reg, m^2.
template <typename T>
T RegArea(const EnergyData& data, const Triple<T>& edge) {
  return data.in_metres ? T{} + Scalar<T>(1) : Dot(edge, edge);
}

// Symmetric positive definite blocks, one for each point, of which a band is stored.
class PointBlocks {
 public:
  PointBlocks(const Grid& grid, int size, int band);
  int size() const { return size_; }
  int band() const { return band_; }
  int per_block() const { return per_block_; }
  // Entry (row, column), column <= row <= column + band, of eight points.
  int at(int row, int column) const { return row_start_[row] + column; }
  Lanes* block(int block) { return values_.data() + static_cast<size_t>(block) * per_block_; }
  const Lanes* block(int block) const { return values_.data() + static_cast<size_t>(block) * per_block_; }
  // L D L^T in place, D inverted.
  void Factor();

 private:
  int size_, band_, per_block_;
  std::vector<int> row_start_;
  std::vector<Lanes> values_;
};

struct Linearisation {
  explicit Linearisation(const EnergyData& data);
  double cost = 0;
  Planes gradient;     // half the derivative of E
  PointBlocks motion;  // Gauss-Newton matrix of the motions of a point, of all terms but rigid and reg
};

// The unknowns' energy; fills `out`.
void Linearise(const EnergyData& data, const Planes& unknowns, Linearisation& out);
// Its value alone.
double CostOf(const EnergyData& data, const Planes& unknowns);

// H, the Gauss-Newton matrix at some unknowns. Terms of edges are not multiplied out: what a point's rotation does to
// an edge is a linear map of the edge, so that a product with H costs each edge a few products of 3 x 3 with 3,
// whatever the number of frames. Refers to `data` and to the linearisation; holds scratch, so one thread at a time.
class NormalMatrix {
 public:
  // `at` belongs to `unknowns`.
  NormalMatrix(const EnergyData& data, const Planes& unknowns, const Linearisation& at);
  // x = next + carry x, then out = H x; returns x . H x.
  double Apply(const Planes& next, float carry, Planes& x, Planes& out);

  const EnergyData& data() const { return data_; }
  const PointBlocks& motion() const { return motion_; }
  const PointBlocks& turn() const { return turn_; }
  // Sum over a point's edges of their weights in E_rigid.
  const std::vector<Lanes>& stiffness() const { return stiffness_; }

 private:
  // kRank = 0: frames by themselves, any number of them.
  template <int kRank>
  double ApplyRanked(const Planes& next, float carry, Planes& x, Planes& out);

  const EnergyData& data_;
  const PointBlocks& motion_;
  PointBlocks turn_;              // of the rotations of a point: E_rigid, what E_reg has on its diagonal
  std::vector<Lanes> levers_;     // d(sum over frames of basis_k R e)/d(turn coefficient l): 27 for each pair l <= k
  std::vector<Lanes> stiffness_;  // 1 for each block
  Planes swing_;                  // what x's rotations do to edges: 3 x 3 for each coefficient
};

// Block-Jacobi: the motions of a point with all their couplings in time, its rotations likewise.
class Preconditioner {
 public:
  explicit Preconditioner(const NormalMatrix& matrix);
  // step += alpha x, r -= alpha image, out = M^-1 r; returns r . out.
  double Apply(float alpha, const Planes& x, const Planes& image, Planes& step, Planes& r, Planes& out) const;

 private:
  // kSize = 0: of any size.
  template <int kSize>
  double ApplySized(float alpha, const Planes& x, const Planes& image, Planes& step, Planes& r, Planes& out) const;

  const EnergyData& data_;
  PointBlocks motion_, turn_;
};

// Where a point is at a frame (0 = the first after the key) and how it has turned; of eight points from index `at` on.
Triple<Lanes> MotionAt(const EnergyData& data, const Planes& unknowns, int frame, ptrdiff_t at);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_ENERGY_H_
