#include "core/solve/energy.h"

#include <algorithm>

#include "core/solve/opti_term.h"
#include "core/solve/plane_term.h"
#include "core/solve/point_term.h"
#include "core/solve/proj_term.h"
#include "core/solve/reg_term.h"
#include "core/solve/rigid_term.h"
#include "core/solve/robust.h"
#include "core/solve/short_term.h"

namespace depthtween {
namespace {

// A step of the solver that would carry a point through the camera is looked at from here, share of its depth.
constexpr float kNearest = 0.2F;

using Point8 = Triple<Lanes>;

// The rows that one point's terms add to its block, eight points at a time.
class BlockSums {
 public:
  BlockSums(const EnergyData& data, PointBlocks* blocks, Planes* gradient)
      : data_(data), blocks_(blocks), gradient_(gradient), row_(3 * data.rank()), sum_(3 * data.rank()) {}

  void Start(int block) {
    block_ = blocks_->block(block);
    std::fill(block_, block_ + blocks_->per_block(), Lanes{});
    std::fill(sum_.begin(), sum_.end(), Lanes{});
  }

  // weight * row^T row and weight * row^T residual, for a residual with Jacobian `now` at `frame` and `before` at the
  // frame before it (if >= 0).
  void AddRow(int frame, const Point8& now, int frame_before, const Point8& before, Lanes weight, Lanes residual) {
    const TimeBasis& basis = data_.basis;
    int first = basis.First(frame);
    const int end = basis.End(frame);
    if (frame_before >= 0) first = std::min(first, basis.First(frame_before));
    for (int k = first; k < end; ++k) {
      const float b = basis(frame, k), c = frame_before >= 0 ? basis(frame_before, k) : 0.0F;
      row_[3 * k] = b * now.x + c * before.x;
      row_[3 * k + 1] = b * now.y + c * before.y;
      row_[3 * k + 2] = b * now.z + c * before.z;
    }
    for (int i = 3 * first; i < 3 * end; ++i) {
      const Lanes weighted = weight * row_[i];
      sum_[i] += weighted * residual;
      Lanes* entries = block_ + blocks_->at(i, 0);
      for (int j = 3 * first; j <= i; ++j) entries[j] += weighted * row_[j];
    }
  }
  // One frame's 3 x 3 block (xx, yx, yy, zx, zy, zz) and vector.
  void AddFrame(int frame, const Lanes (&a)[6], const Point8& g) {
    const TimeBasis& basis = data_.basis;
    for (int k = basis.First(frame); k < basis.End(frame); ++k) {
      const float b = basis(frame, k);
      sum_[3 * k] += b * g.x, sum_[3 * k + 1] += b * g.y, sum_[3 * k + 2] += b * g.z;
      for (int l = basis.First(frame); l <= k; ++l) {
        const float bb = b * basis(frame, l);
        Lanes* x = block_ + blocks_->at(3 * k, 3 * l);
        Lanes* y = block_ + blocks_->at(3 * k + 1, 3 * l);
        Lanes* z = block_ + blocks_->at(3 * k + 2, 3 * l);
        x[0] += bb * a[0];
        y[0] += bb * a[1], y[1] += bb * a[2];
        z[0] += bb * a[3], z[1] += bb * a[4], z[2] += bb * a[5];
        if (l == k) continue;  // only what lies below the diagonal is stored
        x[1] += bb * a[1], x[2] += bb * a[3];
        y[2] += bb * a[4];
      }
    }
  }
  // The same scalar on all three axes.
  void AddScalar(int k, int l, Lanes value) {
    for (int axis = 0; axis < 3; ++axis) block_[blocks_->at(3 * k + axis, 3 * l + axis)] += value;
  }
  void AddGradient(int k, const Point8& g) { sum_[3 * k] += g.x, sum_[3 * k + 1] += g.y, sum_[3 * k + 2] += g.z; }

  void Finish(ptrdiff_t at) {
    for (size_t i = 0; i < sum_.size(); ++i) StoreLanes((*gradient_)[static_cast<int>(i)] + at, sum_[i]);
  }

 private:
  const EnergyData& data_;
  PointBlocks* blocks_;
  Planes* gradient_;
  Lanes* block_ = nullptr;
  std::vector<Lanes> row_, sum_;
};

// The quadratic form of E_short in the coefficients of one axis, times footprint^2: symmetric, rank x rank.
std::vector<float> ShortForm(const EnergyData& data) {
  const int rank = data.rank();
  std::vector<float> form(static_cast<size_t>(rank) * rank);
  std::vector<double> row(rank);
  const auto add = [&](double weight) {
    for (int k = 0; k < rank; ++k)
      for (int l = 0; l < rank; ++l) form[k * rank + l] += static_cast<float>(weight * row[k] * row[l]);
  };
  const int frames = static_cast<int>(data.times.size());
  const auto basis = [&](int s, int k) { return s < 0 ? 0.0 : static_cast<double>(data.basis(s, k)); };
  const auto time = [&](int s) { return s < 0 ? 0.0 : static_cast<double>(data.times[s]); };
  const double over2 = static_cast<double>(data.over_acceleration_sigma) * data.over_acceleration_sigma;
  for (int s = 0; s < frames; ++s) {
    if (s + 1 < frames) {
      const ShortJacobian<double> f = AccelerationFactors(time(s - 1), time(s), time(s + 1));
      for (int k = 0; k < rank; ++k)
        row[k] = f.before * basis(s - 1, k) + f.now * basis(s, k) + f.after * basis(s + 1, k);
      add(data.weights.shortest * over2);
    }
    for (int k = 0; k < rank; ++k) row[k] = basis(s, k) - basis(s - 1, k);
    add(data.weights.shortest * data.steps_share);
  }
  return form;
}

// All terms of a point by itself.
double LinearisePoints(const EnergyData& data, const Planes& unknowns, PointBlocks& blocks, Planes& gradient) {
  const int frames = static_cast<int>(data.frames.size()), rank = data.rank();
  const std::vector<float> form = ShortForm(data);
  BlockSums sums(data, &blocks, &gradient);
  double cost = 0;
  data.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    sums.Start(block);
    Lanes block_cost{};
    const Point8 start = LoadPoint(data.point, 0, at);
    PixelOf<Lanes> seen_before = Project(data.camera, start);
    ProjectionRows<Lanes> rows_before{};
    for (int s = 0; s < frames; ++s) {
      Point8 p = start + MotionAt(data, unknowns, s, at);
      p.z = MaxLanes(p.z, kNearest * start.z);
      const PixelOf<Lanes> seen = Project(data.camera, p);
      const ProjectionRows<Lanes> rows = ProjectionJacobian(data.camera, p);
      const FrameData& frame = data.frames[s];
      // What concerns this frame alone is summed in three dimensions first.
      Lanes a[6] = {};
      Point8 g{};
      const auto add_row = [&](const Point8& j, Lanes weight, Lanes residual) {
        const Point8 wj = weight * j;
        a[0] += wj.x * j.x, a[1] += wj.y * j.x, a[2] += wj.y * j.y;
        a[3] += wj.z * j.x, a[4] += wj.z * j.y, a[5] += wj.z * j.z;
        g = g + residual * wj;
      };
      if (!frame.track.empty() && data.weights.proj > 0) {
        const PixelOf<Lanes> track{LoadLanes(frame.track[0] + at), LoadLanes(frame.track[1] + at)};
        const Lanes own = data.weights.proj * LoadLanes(frame.track[2] + at);
        const PixelOf<Lanes> r = TrackResidual(seen, track, frame.over_track_sigma);
        const Robust<Lanes> robust = GemanMcClure(r.u * r.u + r.v * r.v, data.outlier2);
        const ProjectionRows<Lanes> j = ProjJacobian(rows, frame.over_track_sigma);
        block_cost += own * robust.cost;
        add_row(j.u, own * robust.weight, r.u);
        add_row(j.v, own * robust.weight, r.v);
      }
      if (!frame.opti.empty() && data.weights.opti > 0) {
        const BrightnessAt<Lanes> image{{LoadLanes(frame.opti[3] + at), LoadLanes(frame.opti[4] + at)},
                                        LoadLanes(frame.opti[0] + at),
                                        LoadLanes(frame.opti[1] + at),
                                        LoadLanes(frame.opti[2] + at)};
        const Lanes own = data.weights.opti * LoadLanes(frame.opti[5] + at);
        const Lanes r = OptiResidual(image, seen, data.over_opti_sigma);
        const Robust<Lanes> robust = Charbonnier(r * r);
        block_cost += own * robust.cost;
        add_row(OptiJacobian(image, rows, data.over_opti_sigma), own * robust.weight, r);
      }
      if (s == frames - 1 && !data.partner.empty() && data.weights.point + data.weights.plane > 0) {
        const Point8 partner = LoadPoint(data.partner, 0, at), normal = LoadPoint(data.partner, 3, at);
        const Lanes over_point = LoadLanes(data.partner[6] + at), over_plane = LoadLanes(data.partner[7] + at);
        const Point8 r = PointResidual(p, partner, over_point);
        const Robust<Lanes> point = GemanMcClure(Dot(r, r), data.outlier2);
        const Lanes point_weight = data.weights.point * over_point * over_point * point.weight;
        block_cost += data.weights.point * point.cost;
        a[0] += point_weight, a[2] += point_weight, a[5] += point_weight;
        g = g + point_weight * (p - partner);
        const Lanes distance = PlaneResidual(p, partner, normal, over_plane);
        const Robust<Lanes> plane = GemanMcClure(distance * distance, data.outlier2);
        block_cost += data.weights.plane * plane.cost;
        add_row(PlaneJacobian(normal, over_plane), data.weights.plane * plane.weight, distance);
      }
      sums.AddFrame(s, a, g);
      if (!frame.step.empty() && data.weights.proj > 0) {
        const PixelOf<Lanes> flow{LoadLanes(frame.step[0] + at), LoadLanes(frame.step[1] + at)};
        const Lanes own = data.weights.proj * LoadLanes(frame.step[2] + at);
        const PixelOf<Lanes> r = StepResidual(seen_before, seen, flow, frame.over_step_sigma);
        const Robust<Lanes> robust = GemanMcClure(r.u * r.u + r.v * r.v, data.outlier2);
        const ProjectionRows<Lanes> now = ProjJacobian(rows, frame.over_step_sigma);
        const ProjectionRows<Lanes> before = ProjJacobian(rows_before, -frame.over_step_sigma);
        block_cost += own * robust.cost;
        sums.AddRow(s, now.u, s - 1, before.u, own * robust.weight, r.u);
        sums.AddRow(s, now.v, s - 1, before.v, own * robust.weight, r.v);
      }
      seen_before = seen, rows_before = rows;
    }
    const Lanes over = LoadLanes(data.footprint[0] + at), over2 = over * over * LoadLanes(data.exists[0] + at);
    for (int k = 0; k < rank; ++k) {
      const Point8 c = LoadPoint(unknowns, 3 * k, at);
      Point8 pull{};
      const int nearest = std::max(0, k - 2), end = std::min(rank, k + 3);  // beyond, the form is zero
      for (int l = nearest; l < end; ++l) pull = pull + form[k * rank + l] * LoadPoint(unknowns, 3 * l, at);
      pull = over2 * pull;
      sums.AddGradient(k, pull);
      block_cost += Dot(c, pull);
      for (int l = nearest; l <= k; ++l) sums.AddScalar(k, l, form[k * rank + l] * over2);
      sums.AddScalar(k, k, kDamping * over * over);
    }
    sums.Finish(at);
    cost += SumLanes<double>(block_cost);
  });
  return cost;
}

// The eight neighbours: where they lie, and where the edge to them is stored.
struct Neighbour {
  ptrdiff_t offset, edge_offset;
  int direction;
};
struct Neighbourhood {
  explicit Neighbourhood(const Grid& grid) {
    const ptrdiff_t steps[4] = {1, grid.stride(), grid.stride() + 1, grid.stride() - 1};
    for (int d = 0; d < 4; ++d) {
      of[2 * d] = {steps[d], 0, d};
      of[2 * d + 1] = {-steps[d], -steps[d], d};
    }
  }
  Neighbour of[8];
};

// E_rigid over the frames one after another, and E_reg.
double LineariseEdges(const EnergyData& data, const Planes& unknowns, Planes& gradient) {
  const Grid& grid = data.grid;
  const Neighbourhood neighbours(grid);
  const int rank = data.rank(), turns = data.first_turn();
  const int frames = static_cast<int>(data.times.size());
  double cost = 0;
  for (int plane = turns; plane < 2 * turns; ++plane) std::fill_n(gradient[plane], grid.size(), 0.0F);
  if (data.weights.rigid > 0) {
    Planes motion(grid, 3), turn(grid, 9);
    for (int s = 0; s < frames; ++s) {
      const auto turn_at = [&](ptrdiff_t at) {
        Point8 w{};
        for (int k = data.basis.First(s); k < data.basis.End(s); ++k)
          w = w + data.basis(s, k) * LoadPoint(unknowns, turns + 3 * k, at);
        return w;
      };
      grid.ForEachBlock([&](ptrdiff_t at, int) {
        StorePoint(motion, 0, at, MotionAt(data, unknowns, s, at));
        const Rotation<Lanes> r = RotationOf(turn_at(at));
        for (int row = 0; row < 3; ++row) StorePoint(turn, 3 * row, at, r.row[row]);
      });
      const auto rotation = [&](ptrdiff_t at) {
        return Rotation<Lanes>{{LoadPoint(turn, 0, at), LoadPoint(turn, 3, at), LoadPoint(turn, 6, at)}};
      };
      grid.ForEachBlock([&](ptrdiff_t at, int) {
        const Point8 start = LoadPoint(data.point, 0, at), own_motion = LoadPoint(motion, 0, at);
        const Rotation<Lanes> own = rotation(at);
        Point8 force{}, torque{};
        Lanes block_cost{};
        for (const Neighbour& n : neighbours.of) {
          const Lanes weight = data.weights.rigid * LoadLanes(data.strain[n.direction] + at + n.edge_offset);
          const Point8 edge = start - LoadPoint(data.point, 0, at + n.offset);
          const Point8 moved = own_motion - LoadPoint(motion, 0, at + n.offset);
          const Point8 turned = own * edge;
          const Point8 mine = RigidResidual(moved, edge, turned);
          const Point8 theirs = RigidResidual(moved, edge, rotation(at + n.offset) * edge);
          force = force + weight * (mine + theirs);
          torque = torque + weight * RigidTorque(turned, mine);
          block_cost += weight * Dot(mine, mine);  // their half of the edge is counted there
        }
        torque = LeftJacobianTransposed(turn_at(at), torque);
        for (int k = data.basis.First(s); k < data.basis.End(s); ++k) {
          const float b = data.basis(s, k);
          StorePoint(gradient, 3 * k, at, LoadPoint(gradient, 3 * k, at) + b * force);
          StorePoint(gradient, turns + 3 * k, at, LoadPoint(gradient, turns + 3 * k, at) + b * torque);
        }
        cost += SumLanes<double>(block_cost);
      });
    }
  }
  grid.ForEachBlock([&](ptrdiff_t at, int) {
    const Point8 start = LoadPoint(data.point, 0, at);
    Lanes block_cost{};
    for (int k = 0; k < rank; ++k) {
      const Point8 own = LoadPoint(unknowns, turns + 3 * k, at);
      Point8 sum{};
      for (const Neighbour& n : neighbours.of) {
        const Point8 edge = start - LoadPoint(data.point, 0, at + n.offset);
        const Lanes weight =
            data.weights.reg * RegArea(data, edge) * LoadLanes(data.strain[n.direction] + at + n.edge_offset);
        const Point8 r = RegResidual(own, LoadPoint(unknowns, turns + 3 * k, at + n.offset));
        sum = sum + (2 * kRegJacobian<float> * weight) * r;  // once as (i, j), once as (j, i)
        block_cost += weight * Dot(r, r);
      }
      StorePoint(gradient, turns + 3 * k, at, LoadPoint(gradient, turns + 3 * k, at) + sum);
    }
    cost += SumLanes<double>(block_cost);
  });
  return cost;
}

// The maps between the rotations of a point and its edges: 3 x 3 x 3 numbers for each pair of coefficients that share a
// frame.
constexpr int kLever = 27;
int Pairs(const TimeBasis& basis) { return basis.per_frame() ? basis.rank() : basis.rank() * (basis.rank() + 1) / 2; }
int PairOf(bool per_frame, int k, int l) {
  if (per_frame) return k;
  return k > l ? k * (k + 1) / 2 + l : l * (l + 1) / 2 + k;
}

// sum += block x own; kSize = 0 takes any size and band.
template <int kSize>
void AddBlock(const PointBlocks& blocks, int block, const Lanes* own, Lanes* sum) {
  const Lanes* entries = blocks.block(block);
  const int size = kSize > 0 ? kSize : blocks.size();
  for (int i = 0; i < size; ++i) {
    const Lanes* row = entries + (kSize > 0 ? i * (i + 1) / 2 : blocks.at(i, 0));
    for (int j = kSize > 0 ? 0 : std::max(0, i - blocks.band()); j < i; ++j)
      sum[i] += row[j] * own[j], sum[j] += row[j] * own[i];
    sum[i] += row[i] * own[i];
  }
}

// x becomes what the factored block turns into x; kSize = 0 takes any size and band.
template <int kSize>
void SolveBlock(const PointBlocks& blocks, int block, Lanes* x) {
  const Lanes* m = blocks.block(block);
  const int size = kSize > 0 ? kSize : blocks.size();
  const auto row_of = [&](int i) { return m + (kSize > 0 ? i * (i + 1) / 2 : blocks.at(i, 0)); };
  const auto first_of = [&](int i) { return kSize > 0 ? 0 : std::max(0, i - blocks.band()); };
  for (int i = 0; i < size; ++i) {
    const Lanes* row = row_of(i);
    for (int j = first_of(i); j < i; ++j) x[i] -= row[j] * x[j];
  }
  for (int i = 0; i < size; ++i) x[i] *= row_of(i)[i];
  for (int i = size - 1; i >= 0; --i) {
    const Lanes* row = row_of(i);
    for (int j = first_of(i); j < i; ++j) x[j] -= row[j] * x[i];
  }
}

}  // namespace

Triple<Lanes> MotionAt(const EnergyData& data, const Planes& unknowns, int frame, ptrdiff_t at) {
  Point8 motion{};
  for (int k = data.basis.First(frame); k < data.basis.End(frame); ++k)
    motion = motion + data.basis(frame, k) * LoadPoint(unknowns, 3 * k, at);
  return motion;
}

PointBlocks::PointBlocks(const Grid& grid, int size, int band)
    : size_(size), band_(std::min(size - 1, band)), per_block_(0), row_start_(size) {
  for (int row = 0; row < size_; ++row) {
    const int first = std::max(0, row - band_);
    row_start_[row] = per_block_ - first;
    per_block_ += row - first + 1;
  }
  values_.resize(static_cast<size_t>(per_block_) * grid.blocks());
}

void PointBlocks::Factor() {
  const int count = static_cast<int>(values_.size()) / per_block_;
  std::vector<Lanes> scaled(size_);
  for (int b = 0; b < count; ++b) {
    Lanes* m = block(b);
    for (int i = 0; i < size_; ++i) {
      const int first = std::max(0, i - band_);
      Lanes* row = m + at(i, 0);
      // scaled[j] = L_ij D_j
      for (int j = first; j < i; ++j) {
        const Lanes* other = m + at(j, 0);
        Lanes value = row[j];
        for (int k = std::max(first, std::max(0, j - band_)); k < j; ++k) value -= scaled[k] * other[k];
        scaled[j] = value;
      }
      Lanes diagonal = row[i];
      for (int j = first; j < i; ++j) {
        row[j] = scaled[j] * m[at(j, j)];
        diagonal -= row[j] * scaled[j];
      }
      // Rounding of single precision can eat a diagonal that has almost no information of its own.
      row[i] = 1.0F / MaxLanes(diagonal, 1e-6F * MaxLanes(m[at(i, i)], AllLanes(1e-20F)));
    }
  }
}

// Frames by themselves: accelerations couple a frame's motion with the second next, axis by axis.
Linearisation::Linearisation(const EnergyData& data)
    : gradient(data.grid, data.unknowns()),
      motion(data.grid, 3 * data.rank(), data.basis.per_frame() ? 8 : 3 * data.rank() - 1) {}

void Linearise(const EnergyData& data, const Planes& unknowns, Linearisation& out) {
  const double points = LinearisePoints(data, unknowns, out.motion, out.gradient);
  out.cost = points + LineariseEdges(data, unknowns, out.gradient);
}

double CostOf(const EnergyData& data, const Planes& unknowns) {
  Linearisation scratch(data);
  Linearise(data, unknowns, scratch);
  return scratch.cost;
}

NormalMatrix::NormalMatrix(const EnergyData& data, const Planes& unknowns, const Linearisation& at)
    : data_(data),
      motion_(at.motion),
      turn_(data.grid, 3 * data.rank(), data.basis.per_frame() ? 2 : 3 * data.rank() - 1),
      levers_(static_cast<size_t>(data.grid.blocks()) * kLever * Pairs(data.basis)),
      stiffness_(data.grid.blocks()),
      swing_(data.grid, 9 * data.rank()) {
  const Neighbourhood neighbours(data.grid);
  const int turns = data.first_turn(), pairs = Pairs(data.basis);
  const bool per_frame = data.basis.per_frame();
  data.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    const Point8 start = LoadPoint(data.point, 0, at);
    Lanes stiffness{}, reg{}, spread[6] = {};  // sum of weight e e^T: xx, yx, yy, zx, zy, zz
    for (const Neighbour& n : neighbours.of) {
      const Lanes strain = LoadLanes(data.strain[n.direction] + at + n.edge_offset);
      const Lanes rigid = data.weights.rigid * strain;
      const Point8 e = start - LoadPoint(data.point, 0, at + n.offset), we = rigid * e;
      stiffness += rigid;
      reg += kRegPair * data.weights.reg * RegArea(data, e) * strain;
      spread[0] += we.x * e.x, spread[1] += we.y * e.x, spread[2] += we.y * e.y;
      spread[3] += we.z * e.x, spread[4] += we.z * e.y, spread[5] += we.z * e.z;
    }
    stiffness_[block] = stiffness;
    Lanes* turn = turn_.block(block);
    std::fill(turn, turn + turn_.per_block(), Lanes{});
    for (int i = 0; i < turn_.size(); ++i) turn[turn_.at(i, i)] = reg + kDamping;
    Lanes* levers = &levers_[static_cast<size_t>(block) * kLever * pairs];
    const Point8 spread_of[3] = {
        {spread[0], spread[1], spread[3]}, {spread[1], spread[2], spread[4]}, {spread[3], spread[4], spread[5]}};
    for (int s = 0; s < static_cast<int>(data.times.size()); ++s) {
      Point8 w{};
      for (int k = data.basis.First(s); k < data.basis.End(s); ++k)
        w = w + data.basis(s, k) * LoadPoint(unknowns, turns + 3 * k, at);
      const Rotation<Lanes> r = RotationOf(w), j = LeftJacobianOf(w);
      const Point8 columns[3] = {{j.row[0].x, j.row[1].x, j.row[2].x},
                                 {j.row[0].y, j.row[1].y, j.row[2].y},
                                 {j.row[0].z, j.row[1].z, j.row[2].z}};
      const Point8 axes[3] = {{r.row[0].x, r.row[1].x, r.row[2].x},
                              {r.row[0].y, r.row[1].y, r.row[2].y},
                              {r.row[0].z, r.row[1].z, r.row[2].z}};
      // d(R e)/dw is `lever` times e, and sum of weight lever^T lever is J^T (tr(C) 1 - C) J with C the turned spread.
      Lanes lever[kLever];
      for (int c = 0; c < 3; ++c)
        for (int a = 0; a < 3; ++a) {
          const Point8 v = Cross(columns[a], axes[c]);
          lever[3 * c + a] = v.x, lever[9 + 3 * c + a] = v.y, lever[18 + 3 * c + a] = v.z;
        }
      const Point8 half[3] = {{Dot(r.row[0], spread_of[0]), Dot(r.row[0], spread_of[1]), Dot(r.row[0], spread_of[2])},
                              {Dot(r.row[1], spread_of[0]), Dot(r.row[1], spread_of[1]), Dot(r.row[1], spread_of[2])},
                              {Dot(r.row[2], spread_of[0]), Dot(r.row[2], spread_of[1]), Dot(r.row[2], spread_of[2])}};
      const Lanes xx = Dot(half[0], r.row[0]), yx = Dot(half[1], r.row[0]), yy = Dot(half[1], r.row[1]);
      const Lanes zx = Dot(half[2], r.row[0]), zy = Dot(half[2], r.row[1]), zz = Dot(half[2], r.row[2]);
      const Rotation<Lanes> inertia{{{yy + zz, -yx, -zx}, {-yx, xx + zz, -zy}, {-zx, -zy, xx + yy}}};
      Lanes own[3][3];
      for (int a = 0; a < 3; ++a) {
        const Point8 v = inertia * columns[a];
        for (int b = 0; b < 3; ++b) own[b][a] = Dot(columns[b], v);
      }
      for (int k = data.basis.First(s); k < data.basis.End(s); ++k)
        for (int l = data.basis.First(s); l <= k; ++l) {
          const float bb = data.basis(s, k) * data.basis(s, l);
          Lanes* to = levers + kLever * PairOf(per_frame, k, l);
          for (int i = 0; i < kLever; ++i) to[i] += bb * lever[i];
          for (int a = 0; a < 3; ++a) {
            Lanes* row = turn + turn_.at(3 * k + a, 3 * l);
            for (int b = 0; b <= (k == l ? a : 2); ++b) row[b] += bb * own[a][b];
          }
        }
    }
  });
}

template <int kRank>
double NormalMatrix::ApplyRanked(const Planes& next, float carry, Planes& x, Planes& out) {
  const Grid& grid = data_.grid;
  const Neighbourhood neighbours(grid);
  constexpr bool kPerFrame = kRank == 0;
  const int rank = kPerFrame ? data_.rank() : kRank, turns = 3 * rank;
  const int pairs = kPerFrame ? rank : kRank * (kRank + 1) / 2, blocks_per_row = grid.blocks_per_row();
  const auto levers_of = [&](int block) { return &levers_[static_cast<size_t>(block) * kLever * pairs]; };
  const auto advance_row = [&](int y) {
    for (int b = 0; b < blocks_per_row; ++b) {
      const ptrdiff_t at = grid.at(b * kLanes, y);
      const Lanes* levers = levers_of(y * blocks_per_row + b);
      for (int i = 0; i < 2 * turns; ++i) StoreLanes(x[i] + at, LoadLanes(next[i] + at) + carry * LoadLanes(x[i] + at));
      for (int k = 0; k < rank; ++k) {
        Lanes swing[9] = {};
        for (int l = kPerFrame ? k : 0; l < (kPerFrame ? k + 1 : rank); ++l) {
          const Lanes* lever = levers + kLever * PairOf(kPerFrame, k, l);
          const Point8 w = LoadPoint(x, turns + 3 * l, at);
          for (int i = 0; i < 9; ++i) swing[i] += lever[3 * i] * w.x + lever[3 * i + 1] * w.y + lever[3 * i + 2] * w.z;
        }
        for (int i = 0; i < 9; ++i) StoreLanes(swing_[9 * k + i] + at, swing[i]);
      }
    }
  };
  std::vector<Lanes> own(2 * turns), sum(2 * turns), bent(9 * rank);
  double product = 0;
  advance_row(0);
  for (int y = 0; y < grid.height; ++y) {
    if (y + 1 < grid.height) advance_row(y + 1);
    for (int b = 0; b < blocks_per_row; ++b) {
      const int block = y * blocks_per_row + b;
      const ptrdiff_t at = grid.at(b * kLanes, y);
      const Point8 start = LoadPoint(data_.point, 0, at);
      Lanes rigid[8], reg[8];
      Point8 edges[8], edge_sum{};
      for (int i = 0; i < 8; ++i) {
        const Neighbour& n = neighbours.of[i];
        const Lanes strain = LoadLanes(data_.strain[n.direction] + at + n.edge_offset);
        rigid[i] = data_.weights.rigid * strain;
        const Point8 e = start - LoadPoint(data_.point, 0, at + n.offset);
        reg[i] = kRegPair * data_.weights.reg * RegArea(data_, e) * strain;
        edges[i] = rigid[i] * e;
        edge_sum = edge_sum + edges[i];
      }
      for (int i = 0; i < 2 * turns; ++i) own[i] = LoadLanes(x[i] + at);
      for (int k = 0; k < rank; ++k) {
        const int move = 3 * k, turn = turns + 3 * k;
        const Point8 own_move{own[move], own[move + 1], own[move + 2]};
        Point8 force{}, turn_pull{}, bent_x{}, bent_y{}, bent_z{};
        for (int i = 0; i < 8; ++i) {
          const ptrdiff_t there = at + neighbours.of[i].offset;
          const Point8 moved = own_move - LoadPoint(x, move, there);
          const Rotation<Lanes> swing{{LoadPoint(swing_, 9 * k, there), LoadPoint(swing_, 9 * k + 3, there),
                                       LoadPoint(swing_, 9 * k + 6, there)}};
          force = force + (2.0F * rigid[i]) * moved - swing * edges[i];
          bent_x = bent_x + moved.x * edges[i], bent_y = bent_y + moved.y * edges[i];
          bent_z = bent_z + moved.z * edges[i];
          turn_pull = turn_pull + reg[i] * LoadPoint(x, turn, there);
        }
        const Rotation<Lanes> swing{
            {LoadPoint(swing_, 9 * k, at), LoadPoint(swing_, 9 * k + 3, at), LoadPoint(swing_, 9 * k + 6, at)}};
        force = force - swing * edge_sum;
        sum[move] = force.x, sum[move + 1] = force.y, sum[move + 2] = force.z;
        sum[turn] = -turn_pull.x, sum[turn + 1] = -turn_pull.y, sum[turn + 2] = -turn_pull.z;
        const Point8 rows[3] = {bent_x, bent_y, bent_z};
        for (int r = 0; r < 3; ++r)
          bent[9 * k + 3 * r] = rows[r].x, bent[9 * k + 3 * r + 1] = rows[r].y, bent[9 * k + 3 * r + 2] = rows[r].z;
      }
      const Lanes* levers = levers_of(block);
      for (int l = 0; l < rank; ++l) {
        Point8 torque{};
        for (int k = kPerFrame ? l : 0; k < (kPerFrame ? l + 1 : rank); ++k) {
          const Lanes* lever = levers + kLever * PairOf(kPerFrame, k, l);
          for (int i = 0; i < 9; ++i)
            torque = torque + bent[9 * k + i] * Point8{lever[3 * i], lever[3 * i + 1], lever[3 * i + 2]};
        }
        for (int axis = 0; axis < 3; ++axis)
          sum[turns + 3 * l + axis] -= axis == 0 ? torque.x : axis == 1 ? torque.y : torque.z;
      }
      AddBlock<3 * kRank>(motion_, block, own.data(), sum.data());
      AddBlock<3 * kRank>(turn_, block, own.data() + turns, sum.data() + turns);
      Lanes dot{};
      for (int i = 0; i < 2 * turns; ++i) {
        StoreLanes(out[i] + at, sum[i]);
        dot += sum[i] * own[i];
      }
      product += SumLanes<double>(dot);
    }
  }
  return product;
}

double NormalMatrix::Apply(const Planes& next, float carry, Planes& x, Planes& out) {
  if (data_.basis.per_frame()) return ApplyRanked<0>(next, carry, x, out);
  if (data_.rank() == 1) return ApplyRanked<1>(next, carry, x, out);
  return ApplyRanked<2>(next, carry, x, out);
}

Preconditioner::Preconditioner(const NormalMatrix& matrix)
    : data_(matrix.data()), motion_(matrix.motion()), turn_(matrix.turn()) {
  for (int block = 0; block < data_.grid.blocks(); ++block) {
    Lanes* motion = motion_.block(block);
    for (int i = 0; i < motion_.size(); ++i) motion[motion_.at(i, i)] += 2 * matrix.stiffness()[block];
  }
  motion_.Factor();
  turn_.Factor();
}

template <int kSize>
double Preconditioner::ApplySized(float alpha, const Planes& x, const Planes& image, Planes& step, Planes& r,
                                  Planes& out) const {
  const int size = kSize > 0 ? kSize : motion_.size();
  std::vector<Lanes> better(2 * size), rest(2 * size);
  double product = 0;
  data_.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    for (int i = 0; i < 2 * size; ++i) {
      StoreLanes(step[i] + at, LoadLanes(step[i] + at) + alpha * LoadLanes(x[i] + at));
      rest[i] = better[i] = LoadLanes(r[i] + at) - alpha * LoadLanes(image[i] + at);
      StoreLanes(r[i] + at, rest[i]);
    }
    SolveBlock<kSize>(motion_, block, better.data());
    SolveBlock<kSize>(turn_, block, better.data() + size);
    Lanes dot{};
    for (int i = 0; i < 2 * size; ++i) {
      dot += better[i] * rest[i];
      StoreLanes(out[i] + at, better[i]);
    }
    product += SumLanes<double>(dot);
  });
  return product;
}

double Preconditioner::Apply(float alpha, const Planes& x, const Planes& image, Planes& step, Planes& r,
                             Planes& out) const {
  if (data_.basis.per_frame()) return ApplySized<0>(alpha, x, image, step, r, out);
  if (data_.rank() == 1) return ApplySized<3>(alpha, x, image, step, r, out);
  return ApplySized<6>(alpha, x, image, step, r, out);
}

}  // namespace depthtween
