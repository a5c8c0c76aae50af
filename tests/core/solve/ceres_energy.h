// The solver's frozen energy handed to Ceres: an oracle of its minimum, and what its speed is measured beside.
//
// Residuals are those of core/solve/*_term.h, in double precision and differentiated automatically, with sizes known
// when compiled; how they are summed, weighted and minimised is Ceres'. Parameter blocks are as small as the couplings
// allow, which is fastest for Ceres: the motion of a point and its rotation (metres, radians), all coefficients of a
// trajectory together, frames by themselves each for itself.
#ifndef DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_
#define DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_

#include <algorithm>
#include <cmath>
#include <vector>

#include "ceres/ceres.h"
#include "core/solve/energy.h"
#include "core/solve/opti_term.h"
#include "core/solve/plane_term.h"
#include "core/solve/point_term.h"
#include "core/solve/proj_term.h"
#include "core/solve/reg_term.h"
#include "core/solve/rigid_term.h"
#include "core/solve/short_term.h"

namespace depthtween {

template <int kCount>
struct ScalarOf<ceres::Jet<double, kCount>> {
  using type = double;
};

class GemanMcClureLoss : public ceres::LossFunction {
 public:
  explicit GemanMcClureLoss(double c2) : c2_(c2) {}
  void Evaluate(double s, double rho[3]) const override {
    const double share = 1 / (1 + s / c2_);
    rho[0] = s * share, rho[1] = share * share, rho[2] = -2 / c2_ * share * share * share;
  }

 private:
  double c2_;
};
class CharbonnierLoss : public ceres::LossFunction {
 public:
  void Evaluate(double s, double rho[3]) const override {
    const double root = std::sqrt(1 + s);
    rho[0] = 2 * (root - 1), rho[1] = 1 / root, rho[2] = -0.5 / (root * root * root);
  }
};

// A residual written for any number, of one, two or three blocks, as Ceres calls it.
template <typename Body>
struct Generic {
  Body body;
  template <typename T>
  bool operator()(const T* a, T* out) const {
    const T* const blocks[] = {a, a, a};  // whoever has one block asks for no other
    return body(blocks, out), true;
  }
  template <typename T>
  bool operator()(const T* a, const T* b, T* out) const {
    const T* const blocks[] = {a, b, b};
    return body(blocks, out), true;
  }
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, T* out) const {
    const T* const blocks[] = {a, b, c};
    return body(blocks, out), true;
  }
};

class CeresEnergy {
 public:
  CeresEnergy(const EnergyData& data, const Planes& unknowns)
      : data_(data),
        rank_(data.rank()),
        size_(data.basis.per_frame() ? 3 : 3 * data.rank()),
        blocks_(static_cast<size_t>(data.grid.width) * data.grid.height) {
    ForEachPoint([&](int i, int j) {
      std::vector<double>& block = blocks_[Number(i, j)];
      for (int k = 0; k < data_.unknowns(); ++k) block.push_back(unknowns[k][data_.grid.at(i, j)]);
    });
    ForEachPoint([&](int i, int j) {
      AddPoint(i, j);
      for (int d = 0; d < 4; ++d) AddEdge(i, j, d);
    });
  }

  // |J x|^2, J the derivative of the residuals times the roots of their weights.
  double Curvature(const Planes& x) {
    ceres::Problem::EvaluateOptions options;
    std::vector<double> values;
    ForEachPoint([&](int i, int j) {
      for (int first = 0; first < data_.unknowns(); first += size_) {
        options.parameter_blocks.push_back(&blocks_[Number(i, j)][first]);
        for (int k = first; k < first + size_; ++k) values.push_back(x[k][data_.grid.at(i, j)]);
      }
    });
    ceres::CRSMatrix jacobian;
    problem_.Evaluate(options, nullptr, nullptr, nullptr, &jacobian);
    double sum = 0;
    for (int row = 0; row < jacobian.num_rows; ++row) {
      double product = 0;
      for (int n = jacobian.rows[row]; n < jacobian.rows[row + 1]; ++n)
        product += jacobian.values[n] * values[jacobian.cols[n]];
      sum += product * product;
    }
    return sum;
  }

  // The energy, counted as CostOf does: Ceres' has a half before it.
  double Cost() {
    double cost = 0;
    problem_.Evaluate({}, &cost, nullptr, nullptr, nullptr);
    return 2 * cost;
  }
  ceres::Solver::Summary Minimise(const ceres::Solver::Options& options) {
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }
  void Unknowns(Planes& out) const {
    ForEachPoint([&](int i, int j) {
      for (int k = 0; k < data_.unknowns(); ++k)
        out[k][data_.grid.at(i, j)] = static_cast<float>(blocks_[Number(i, j)][k]);
    });
  }

 private:
  size_t Number(int i, int j) const { return static_cast<size_t>(j) * data_.grid.width + i; }
  bool Exists(int i, int j) const {
    return i >= 0 && j >= 0 && i < data_.grid.width && j < data_.grid.height &&
           data_.exists[0][data_.grid.at(i, j)] > 0;
  }
  template <typename Body>
  void ForEachPoint(const Body& body) const {
    for (int j = 0; j < data_.grid.height; ++j)
      for (int i = 0; i < data_.grid.width; ++i)
        if (Exists(i, j)) body(i, j);
  }
  Triple<double> Read(const Planes& planes, int first, ptrdiff_t at) const {
    return {planes[first][at], planes[first + 1][at], planes[first + 2][at]};
  }

  // Of the motion or the rotation at a frame, from its block; frame -1 is the key.
  template <typename T>
  Triple<T> At(const T* block, int frame) const {
    Triple<T> sum{T(0), T(0), T(0)};
    if (frame < 0) return sum;
    for (int k = data_.basis.First(frame); k < data_.basis.End(frame); ++k) {
      const T* own = block + 3 * (k - data_.basis.First(frame));
      sum = sum + static_cast<double>(data_.basis(frame, k)) * Triple<T>{own[0], own[1], own[2]};
    }
    return sum;
  }
  template <typename T>
  PixelOf<T> SeenAt(const T* block, const Triple<double>& start, int frame) const {
    const Triple<T> motion = At(block, frame);
    const Pinhole<double> camera{data_.camera.fx, data_.camera.fy, data_.camera.cx, data_.camera.cy};
    return Project<T>(camera, Triple<T>{motion.x + start.x, motion.y + start.y, motion.z + start.z});
  }
  // The block that holds the motion (`first` = 0) or the rotation (first_turn) of a point at a frame.
  double* Block(size_t number, int first, int frame) {
    return &blocks_[number][first + 3 * data_.basis.First(std::max(0, frame))];
  }
  // Those of some frames, each once, and where in the list that of a frame is.
  struct Motions {
    std::vector<double*> blocks;
    int at[3];
  };
  Motions MotionsOf(size_t number, const std::vector<int>& frames) {
    Motions motions{};
    for (size_t i = 0; i < frames.size(); ++i) {
      double* const block = Block(number, 0, frames[i]);
      const auto found = std::find(motions.blocks.begin(), motions.blocks.end(), block);
      motions.at[i] = static_cast<int>(found - motions.blocks.begin());
      if (found == motions.blocks.end()) motions.blocks.push_back(block);
    }
    return motions;
  }
  template <typename T>
  static Triple<T> Lift(const Triple<double>& v) {
    return {T(v.x), T(v.y), T(v.z)};
  }

  // `body(row of parameter blocks, residuals)`, generic in the number. E counts weight * kernel(|residuals|^2).
  template <int kResiduals, typename Body>
  void Add(const Body& body, const std::vector<double*>& blocks, ceres::LossFunction* kernel, double weight) {
    ceres::CostFunction* const cost = size_ == 6   ? Sized<kResiduals, 6>(body, blocks.size())
                                      : size_ == 3 ? Sized<kResiduals, 3>(body, blocks.size())
                                                   : nullptr;
    problem_.AddResidualBlock(cost, new ceres::ScaledLoss(kernel, weight, ceres::TAKE_OWNERSHIP), blocks);
  }
  template <int kResiduals, int kSize, typename Body>
  static ceres::CostFunction* Sized(const Body& body, size_t blocks) {
    auto* const generic = new Generic<Body>{body};
    if (blocks == 1) return new ceres::AutoDiffCostFunction<Generic<Body>, kResiduals, kSize>(generic);
    if (blocks == 2) return new ceres::AutoDiffCostFunction<Generic<Body>, kResiduals, kSize, kSize>(generic);
    return new ceres::AutoDiffCostFunction<Generic<Body>, kResiduals, kSize, kSize, kSize>(generic);
  }

  void AddPoint(int i, int j) {
    const ptrdiff_t at = data_.grid.at(i, j);
    const TermWeights& weights = data_.weights;
    const Triple<double> start = Read(data_.point, 0, at);
    const size_t number = Number(i, j);
    const int frames = static_cast<int>(data_.frames.size());
    for (int s = 0; s < frames; ++s) {
      const FrameData& frame = data_.frames[s];
      const std::vector<double*> own = {Block(number, 0, s)};
      if (!frame.track.empty() && weights.proj > 0)
        Add<2>(
            [this, start, s, track = PixelOf<double>{frame.track[0][at], frame.track[1][at]},
             over = static_cast<double>(frame.over_track_sigma)](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto r = TrackResidual<T>(SeenAt(block[0], start, s), {T(track.u), T(track.v)}, over);
              out[0] = r.u, out[1] = r.v;
            },
            own, new GemanMcClureLoss(data_.outlier2), weights.proj * frame.track[2][at]);
      if (!frame.step.empty() && weights.proj > 0) {
        const Motions motions = s == 0 ? MotionsOf(number, {0}) : MotionsOf(number, {s - 1, s});
        Add<2>(
            [this, start, s, before = motions.at[0], now = motions.at[s == 0 ? 0 : 1],
             flow = PixelOf<double>{frame.step[0][at], frame.step[1][at]},
             over = static_cast<double>(frame.over_step_sigma)](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto r = StepResidual<T>(SeenAt(block[before], start, s - 1), SeenAt(block[now], start, s),
                                             {T(flow.u), T(flow.v)}, over);
              out[0] = r.u, out[1] = r.v;
            },
            motions.blocks, new GemanMcClureLoss(data_.outlier2), weights.proj * frame.step[2][at]);
      }
      if (!frame.opti.empty() && weights.opti > 0) {
        const BrightnessAt<double> image{
            {frame.opti[3][at], frame.opti[4][at]}, frame.opti[0][at], frame.opti[1][at], frame.opti[2][at]};
        Add<1>(
            [this, start, s, image](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const BrightnessAt<T> lifted{
                  {T(image.at.u), T(image.at.v)}, T(image.difference), T(image.slope_u), T(image.slope_v)};
              out[0] = OptiResidual<T>(lifted, SeenAt(block[0], start, s), static_cast<double>(data_.over_opti_sigma));
            },
            own, new CharbonnierLoss(), weights.opti * frame.opti[5][at]);
      }
    }
    const std::vector<double*> last = {Block(number, 0, frames - 1)};
    // Points without a partner have weight zero there.
    if (!data_.partner.empty() && data_.partner[6][at] > 0) {
      const Triple<double> partner = Read(data_.partner, 0, at), normal = Read(data_.partner, 3, at);
      Add<3>(
          [this, start, partner, s = frames - 1, over = static_cast<double>(data_.partner[6][at])](auto block,
                                                                                                   auto* out) {
            using T = std::remove_pointer_t<decltype(out)>;
            const Triple<T> end = Lift<T>(start) + At(block[0], s);
            const Triple<T> r = PointResidual<T>(end, Lift<T>(partner), T(over));
            out[0] = r.x, out[1] = r.y, out[2] = r.z;
          },
          last, new GemanMcClureLoss(data_.outlier2), weights.point);
      Add<1>(
          [this, start, partner, normal, s = frames - 1, over = static_cast<double>(data_.partner[7][at])](auto block,
                                                                                                           auto* out) {
            using T = std::remove_pointer_t<decltype(out)>;
            const Triple<T> end = Lift<T>(start) + At(block[0], s);
            out[0] = PlaneResidual<T>(end, Lift<T>(partner), Lift<T>(normal), T(over));
          },
          last, new GemanMcClureLoss(data_.outlier2), weights.plane);
    }
    const double footprint2 = std::pow(static_cast<double>(data_.footprint[0][at]), 2);
    const auto time = [&](int s) { return s < 0 ? 0.0 : static_cast<double>(data_.times[s]); };
    for (int s = 0; s < frames; ++s) {
      const int first = std::max(0, s - 1);  // where the key's is asked for, any block will do
      if (s + 1 < frames) {
        const ShortJacobian<double> f = AccelerationFactors(time(s - 1), time(s), time(s + 1));
        const Motions motions = MotionsOf(number, {first, s, s + 1});
        Add<3>(
            [this, s, f, motions](auto block, auto* out) {
              const auto r = f.before * At(block[motions.at[0]], s - 1) + f.now * At(block[motions.at[1]], s) +
                             f.after * At(block[motions.at[2]], s + 1);
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            motions.blocks, nullptr, weights.shortest * std::pow(data_.over_acceleration_sigma, 2) * footprint2);
      }
      const Motions motions = MotionsOf(number, {first, s});
      Add<3>(
          [this, s, motions](auto block, auto* out) {
            const auto r = At(block[motions.at[1]], s) - At(block[motions.at[0]], s - 1);
            out[0] = r.x, out[1] = r.y, out[2] = r.z;
          },
          motions.blocks, nullptr, weights.shortest * data_.steps_share * footprint2);
    }
  }

  // The edge from (i, j) in one of the four stored directions, as seen from either end.
  void AddEdge(int i, int j, int direction) {
    constexpr int kSteps[4][2] = {{1, 0}, {0, 1}, {1, 1}, {-1, 1}};
    const int oi = i + kSteps[direction][0], oj = j + kSteps[direction][1];
    const double strain = data_.strain[direction][data_.grid.at(i, j)];
    if (!Exists(oi, oj) || strain <= 0) return;
    const ptrdiff_t at[2] = {data_.grid.at(i, j), data_.grid.at(oi, oj)};
    const size_t number[2] = {Number(i, j), Number(oi, oj)};
    const int turns = data_.first_turn();
    for (int end = 0; end < 2; ++end) {
      const size_t own = number[end], other = number[1 - end];
      const Triple<double> edge = Read(data_.point, 0, at[end]) - Read(data_.point, 0, at[1 - end]);
      for (int s = 0; data_.weights.rigid > 0 && s < static_cast<int>(data_.frames.size()); ++s)
        Add<3>(
            [this, s, edge](auto blocks, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const Triple<T> moved = At(blocks[0], s) - At(blocks[1], s);
              const Triple<T> turned = RotationOf<T>(At(blocks[2], s)) * Lift<T>(edge);
              const Triple<T> r = RigidResidual<T>(moved, Lift<T>(edge), turned);
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            {Block(own, 0, s), Block(other, 0, s), Block(own, turns, s)}, nullptr, data_.weights.rigid * strain);
      for (int k = 0; data_.weights.reg > 0 && k < rank_; ++k)
        Add<3>(
            [first = 3 * (k % (size_ / 3))](auto blocks, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto turn = [&](const T* of) { return Triple<T>{of[first], of[first + 1], of[first + 2]}; };
              const Triple<T> r = RegResidual<T>(turn(blocks[0]), turn(blocks[1]));
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            {Block(own, turns, data_.basis.per_frame() ? k : 0), Block(other, turns, data_.basis.per_frame() ? k : 0)},
            nullptr, data_.weights.reg * RegArea(data_, edge) * strain);
    }
  }

  const EnergyData& data_;
  const int rank_;
  const int size_;  // of a parameter block
  std::vector<std::vector<double>> blocks_;
  ceres::Problem problem_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_
