// The solver's frozen energy handed to Ceres: an oracle of its minimum, and what its speed is measured beside.
//
// Residuals are those of core/solve/*_term.h, in double precision and differentiated automatically; how they are
// summed, weighted and minimised is Ceres'. One parameter block a point: 3 rank coefficients of motion (metres), then
// of rotation.
#ifndef DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_
#define DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_

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

// A residual written for any number, as Ceres calls it.
template <typename Body>
struct Generic {
  Body body;
  template <typename T>
  bool operator()(const T* const* parameters, T* out) const {
    body(parameters, out);
    return true;
  }
};

class CeresEnergy {
 public:
  CeresEnergy(const EnergyData& data, const Planes& unknowns)
      : data_(data), rank_(data.rank()), blocks_(static_cast<size_t>(data.grid.width) * data.grid.height) {
    ForEachPoint([&](int i, int j) {
      std::vector<double>& block = blocks_[Number(i, j)];
      for (int k = 0; k < data_.unknowns(); ++k) block.push_back(unknowns[k][data_.grid.at(i, j)]);
    });
    ForEachPoint([&](int i, int j) {
      AddPoint(i, j);
      for (int d = 0; d < 4; ++d) AddEdge(i, j, d);
    });
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

  // Of the motion (first = 0) or the rotation (first = 3 rank) at a frame; frame -1 is the key.
  template <typename T>
  Triple<T> At(const T* block, int first, int frame) const {
    Triple<T> sum{T(0), T(0), T(0)};
    for (int k = 0; frame >= 0 && k < rank_; ++k) {
      const double b = data_.basis(frame, k);
      if (b != 0) sum = sum + b * Triple<T>{block[first + 3 * k], block[first + 3 * k + 1], block[first + 3 * k + 2]};
    }
    return sum;
  }
  template <typename T>
  PixelOf<T> SeenAt(const T* block, const Triple<double>& start, int frame) const {
    const Triple<T> motion = At(block, 0, frame);
    const Pinhole<double> camera{data_.camera.fx, data_.camera.fy, data_.camera.cx, data_.camera.cy};
    return Project<T>(camera, Triple<T>{motion.x + start.x, motion.y + start.y, motion.z + start.z});
  }
  template <typename T>
  static Triple<T> Lift(const Triple<double>& v) {
    return {T(v.x), T(v.y), T(v.z)};
  }

  // `body(row of parameter blocks, residuals)`, generic in the number. E counts weight * kernel(|residuals|^2).
  template <typename Body>
  void Add(const Body& body, int residuals, const std::vector<double*>& blocks, ceres::LossFunction* kernel,
           double weight) {
    auto* const cost = new ceres::DynamicAutoDiffCostFunction<Generic<Body>, 12>(new Generic<Body>{body});
    for (size_t i = 0; i < blocks.size(); ++i) cost->AddParameterBlock(data_.unknowns());
    cost->SetNumResiduals(residuals);
    problem_.AddResidualBlock(cost, new ceres::ScaledLoss(kernel, weight, ceres::TAKE_OWNERSHIP), blocks);
  }

  void AddPoint(int i, int j) {
    const ptrdiff_t at = data_.grid.at(i, j);
    const TermWeights& weights = data_.weights;
    const Triple<double> start = Read(data_.point, 0, at);
    const std::vector<double*> own = {blocks_[Number(i, j)].data()};
    const int frames = static_cast<int>(data_.frames.size());
    constexpr double kOutlier2 = 9;
    for (int s = 0; s < frames; ++s) {
      const FrameData& frame = data_.frames[s];
      if (!frame.track.empty() && weights.proj > 0)
        Add(
            [this, start, s, track = PixelOf<double>{frame.track[0][at], frame.track[1][at]},
             over = static_cast<double>(frame.over_track_sigma)](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto r = TrackResidual<T>(SeenAt(block[0], start, s), {T(track.u), T(track.v)}, over);
              out[0] = r.u, out[1] = r.v;
            },
            2, own, new GemanMcClureLoss(kOutlier2), weights.proj * frame.track[2][at]);
      if (!frame.step.empty() && weights.proj > 0)
        Add(
            [this, start, s, flow = PixelOf<double>{frame.step[0][at], frame.step[1][at]},
             over = static_cast<double>(frame.over_step_sigma)](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto r = StepResidual<T>(SeenAt(block[0], start, s - 1), SeenAt(block[0], start, s),
                                             {T(flow.u), T(flow.v)}, over);
              out[0] = r.u, out[1] = r.v;
            },
            2, own, new GemanMcClureLoss(kOutlier2), weights.proj * frame.step[2][at]);
      if (!frame.opti.empty() && weights.opti > 0) {
        const BrightnessAt<double> image{
            {frame.opti[3][at], frame.opti[4][at]}, frame.opti[0][at], frame.opti[1][at], frame.opti[2][at]};
        Add(
            [this, start, s, image](auto block, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const BrightnessAt<T> lifted{
                  {T(image.at.u), T(image.at.v)}, T(image.difference), T(image.slope_u), T(image.slope_v)};
              out[0] = OptiResidual<T>(lifted, SeenAt(block[0], start, s), static_cast<double>(data_.over_opti_sigma));
            },
            1, own, new CharbonnierLoss(), weights.opti * frame.opti[5][at]);
      }
    }
    if (!data_.partner.empty()) {
      const Triple<double> partner = Read(data_.partner, 0, at), normal = Read(data_.partner, 3, at);
      Add(
          [this, start, partner, s = frames - 1, over = static_cast<double>(data_.partner[6][at])](auto block,
                                                                                                   auto* out) {
            using T = std::remove_pointer_t<decltype(out)>;
            const Triple<T> end = Lift<T>(start) + At(block[0], 0, s);
            const Triple<T> r = PointResidual<T>(end, Lift<T>(partner), T(over));
            out[0] = r.x, out[1] = r.y, out[2] = r.z;
          },
          3, own, new GemanMcClureLoss(kOutlier2), weights.point);
      Add(
          [this, start, partner, normal, s = frames - 1, over = static_cast<double>(data_.partner[7][at])](auto block,
                                                                                                           auto* out) {
            using T = std::remove_pointer_t<decltype(out)>;
            const Triple<T> end = Lift<T>(start) + At(block[0], 0, s);
            out[0] = PlaneResidual<T>(end, Lift<T>(partner), Lift<T>(normal), T(over));
          },
          1, own, new GemanMcClureLoss(kOutlier2), weights.plane);
    }
    const double footprint2 = std::pow(static_cast<double>(data_.footprint[0][at]), 2);
    const auto time = [&](int s) { return s < 0 ? 0.0 : static_cast<double>(data_.times[s]); };
    for (int s = 0; s < frames; ++s) {
      if (s + 1 < frames) {
        const ShortJacobian<double> f = AccelerationFactors(time(s - 1), time(s), time(s + 1));
        Add(
            [this, s, f](auto block, auto* out) {
              const auto r =
                  f.before * At(block[0], 0, s - 1) + f.now * At(block[0], 0, s) + f.after * At(block[0], 0, s + 1);
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            3, own, nullptr, weights.shortest * std::pow(data_.over_acceleration_sigma, 2) * footprint2);
      }
      Add(
          [this, s](auto block, auto* out) {
            const auto r = At(block[0], 0, s) - At(block[0], 0, s - 1);
            out[0] = r.x, out[1] = r.y, out[2] = r.z;
          },
          3, own, nullptr, weights.shortest * kPrintedShortShare * footprint2);
    }
  }

  // The edge from (i, j) in one of the four stored directions, as seen from either end.
  void AddEdge(int i, int j, int direction) {
    constexpr int kSteps[4][2] = {{1, 0}, {0, 1}, {1, 1}, {-1, 1}};
    const int oi = i + kSteps[direction][0], oj = j + kSteps[direction][1];
    const double strain = data_.strain[direction][data_.grid.at(i, j)];
    if (!Exists(oi, oj) || strain <= 0) return;
    const ptrdiff_t at[2] = {data_.grid.at(i, j), data_.grid.at(oi, oj)};
    double* const block[2] = {blocks_[Number(i, j)].data(), blocks_[Number(oi, oj)].data()};
    const int turns = data_.first_turn();
    for (int end = 0; end < 2; ++end) {
      const Triple<double> edge = Read(data_.point, 0, at[end]) - Read(data_.point, 0, at[1 - end]);
      const std::vector<double*> both = {block[end], block[1 - end]};
      for (int s = 0; data_.weights.rigid > 0 && s < static_cast<int>(data_.frames.size()); ++s)
        Add(
            [this, s, edge, turns](auto blocks, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const Triple<T> moved = At(blocks[0], 0, s) - At(blocks[1], 0, s);
              const Triple<T> turned = RotationOf<T>(At(blocks[0], turns, s)) * Lift<T>(edge);
              const Triple<T> r = RigidResidual<T>(moved, Lift<T>(edge), turned);
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            3, both, nullptr, data_.weights.rigid * strain);
      for (int k = 0; data_.weights.reg > 0 && k < rank_; ++k)
        Add(
            [first = turns + 3 * k](auto blocks, auto* out) {
              using T = std::remove_pointer_t<decltype(out)>;
              const auto turn = [&](const T* of) { return Triple<T>{of[first], of[first + 1], of[first + 2]}; };
              const Triple<T> r = RegResidual<T>(turn(blocks[0]), turn(blocks[1]));
              out[0] = r.x, out[1] = r.y, out[2] = r.z;
            },
            3, both, nullptr, data_.weights.reg * Dot(edge, edge) * strain);
    }
  }

  const EnergyData& data_;
  const int rank_;
  std::vector<std::vector<double>> blocks_;
  ceres::Problem problem_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_SOLVE_CERES_ENERGY_H_
