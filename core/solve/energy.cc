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

// Residuals beyond this many deviations (squared) pull no more: outliers of flow and of association.
constexpr float kOutlier2 = 9.0F;
// A step of the solver that would carry a point through the camera is looked at from here, share of its depth.
constexpr float kNearest = 0.2F;
// Keeps the steps of points that nothing holds small: added to the matrix, not to the energy, per footprint and per
// radian.
constexpr float kDamping = 1e-4F;
// What E_reg adds to the matrix for an edge: once as (i, j), once as (j, i).
constexpr float kRegPair = 2 * kRegJacobian<float> * kRegJacobian<float>;

using Point8 = Triple<Lanes>;

Point8 Load(const Planes& planes, int first, ptrdiff_t at) {
  return {LoadLanes(planes[first] + at), LoadLanes(planes[first + 1] + at), LoadLanes(planes[first + 2] + at)};
}
void Store(Planes& planes, int first, ptrdiff_t at, const Point8& v) {
  StoreLanes(planes[first] + at, v.x);
  StoreLanes(planes[first + 1] + at, v.y);
  StoreLanes(planes[first + 2] + at, v.z);
}
double Sum(Lanes v) {
  double sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += v[i];
  return sum;
}
Lanes MaxLanes(Lanes a, Lanes b) { return a > b ? a : b; }

// The rows that one point's terms add to its block, eight points at a time.
class BlockSums {
 public:
  BlockSums(const EnergyData& data, MotionBlocks* blocks, Planes* gradient)
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
  MotionBlocks* blocks_;
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
    add(data.weights.shortest * kPrintedShortShare);
  }
  return form;
}

// All terms of a point by itself.
double LinearisePoints(const EnergyData& data, const Planes& unknowns, MotionBlocks& blocks, Planes& gradient) {
  const int frames = static_cast<int>(data.frames.size()), rank = data.rank();
  const std::vector<float> form = ShortForm(data);
  BlockSums sums(data, &blocks, &gradient);
  double cost = 0;
  data.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    sums.Start(block);
    Lanes block_cost{};
    const Point8 start = Load(data.point, 0, at);
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
        const Robust<Lanes> robust = GemanMcClure(r.u * r.u + r.v * r.v, kOutlier2);
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
        const Point8 partner = Load(data.partner, 0, at), normal = Load(data.partner, 3, at);
        const Lanes over_point = LoadLanes(data.partner[6] + at), over_plane = LoadLanes(data.partner[7] + at);
        const Point8 r = PointResidual(p, partner, over_point);
        const Robust<Lanes> point = GemanMcClure(Dot(r, r), kOutlier2);
        const Lanes point_weight = data.weights.point * over_point * over_point * point.weight;
        block_cost += data.weights.point * point.cost;
        a[0] += point_weight, a[2] += point_weight, a[5] += point_weight;
        g = g + point_weight * (p - partner);
        const Lanes distance = PlaneResidual(p, partner, normal, over_plane);
        const Robust<Lanes> plane = GemanMcClure(distance * distance, kOutlier2);
        block_cost += data.weights.plane * plane.cost;
        add_row(PlaneJacobian(normal, over_plane), data.weights.plane * plane.weight, distance);
      }
      sums.AddFrame(s, a, g);
      if (!frame.step.empty() && data.weights.proj > 0) {
        const PixelOf<Lanes> flow{LoadLanes(frame.step[0] + at), LoadLanes(frame.step[1] + at)};
        const Lanes own = data.weights.proj * LoadLanes(frame.step[2] + at);
        const PixelOf<Lanes> r = StepResidual(seen_before, seen, flow, frame.over_step_sigma);
        const Robust<Lanes> robust = GemanMcClure(r.u * r.u + r.v * r.v, kOutlier2);
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
      const Point8 c = Load(unknowns, 3 * k, at);
      Point8 pull{};
      const int nearest = std::max(0, k - 2), end = std::min(rank, k + 3);  // beyond, the form is zero
      for (int l = nearest; l < end; ++l) pull = pull + form[k * rank + l] * Load(unknowns, 3 * l, at);
      pull = over2 * pull;
      sums.AddGradient(k, pull);
      block_cost += Dot(c, pull);
      for (int l = nearest; l <= k; ++l) sums.AddScalar(k, l, form[k * rank + l] * over2);
      sums.AddScalar(k, k, kDamping * over * over);
    }
    sums.Finish(at);
    cost += Sum(block_cost);
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
          w = w + data.basis(s, k) * Load(unknowns, turns + 3 * k, at);
        return w;
      };
      grid.ForEachBlock([&](ptrdiff_t at, int) {
        Store(motion, 0, at, MotionAt(data, unknowns, s, at));
        const Rotation<Lanes> r = RotationOf(turn_at(at));
        for (int row = 0; row < 3; ++row) Store(turn, 3 * row, at, r.row[row]);
      });
      const auto rotation = [&](ptrdiff_t at) {
        return Rotation<Lanes>{{Load(turn, 0, at), Load(turn, 3, at), Load(turn, 6, at)}};
      };
      grid.ForEachBlock([&](ptrdiff_t at, int) {
        const Point8 start = Load(data.point, 0, at), own_motion = Load(motion, 0, at);
        const Rotation<Lanes> own = rotation(at);
        Point8 force{}, torque{};
        Lanes block_cost{};
        for (const Neighbour& n : neighbours.of) {
          const Lanes weight = data.weights.rigid * LoadLanes(data.strain[n.direction] + at + n.edge_offset);
          const Point8 edge = start - Load(data.point, 0, at + n.offset);
          const Point8 moved = own_motion - Load(motion, 0, at + n.offset);
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
          Store(gradient, 3 * k, at, Load(gradient, 3 * k, at) + b * force);
          Store(gradient, turns + 3 * k, at, Load(gradient, turns + 3 * k, at) + b * torque);
        }
        cost += Sum(block_cost);
      });
    }
  }
  grid.ForEachBlock([&](ptrdiff_t at, int) {
    const Point8 start = Load(data.point, 0, at);
    Lanes block_cost{};
    for (int k = 0; k < rank; ++k) {
      const Point8 own = Load(unknowns, turns + 3 * k, at);
      Point8 sum{};
      for (const Neighbour& n : neighbours.of) {
        const Point8 edge = start - Load(data.point, 0, at + n.offset);
        const Lanes weight =
            data.weights.reg * Dot(edge, edge) * LoadLanes(data.strain[n.direction] + at + n.edge_offset);
        const Point8 r = RegResidual(own, Load(unknowns, turns + 3 * k, at + n.offset));
        sum = sum + (2 * kRegJacobian<float> * weight) * r;  // once as (i, j), once as (j, i)
        block_cost += weight * Dot(r, r);
      }
      Store(gradient, turns + 3 * k, at, Load(gradient, turns + 3 * k, at) + sum);
    }
    cost += Sum(block_cost);
  });
  return cost;
}

// H x of eight points; kRank = 0 takes any rank.
template <int kRank>
double ApplyRanked(const EnergyData& data, const MotionBlocks& blocks, const Planes& x, Planes& out) {
  const Grid& grid = data.grid;
  const Neighbourhood neighbours(grid);
  const int rank = kRank > 0 ? kRank : data.rank(), size = 3 * rank, turns = size;
  const int band = kRank > 0 ? 3 * kRank - 1 : blocks.band();
  std::vector<Lanes> own(6 * rank), sum(6 * rank);
  const auto three = [](const std::vector<Lanes>& of, int first) {
    return Point8{of[first], of[first + 1], of[first + 2]};
  };
  double product = 0;
  grid.ForEachBlock([&](ptrdiff_t at, int block) {
    const Point8 start = Load(data.point, 0, at);
    for (int i = 0; i < 2 * size; ++i) {
      own[i] = LoadLanes(x[i] + at);
      sum[i] = i < turns ? Lanes{} : kDamping * own[i];
    }
    for (const Neighbour& n : neighbours.of) {
      const Lanes strain = LoadLanes(data.strain[n.direction] + at + n.edge_offset);
      const Lanes rigid = data.weights.rigid * strain;
      const Point8 edge = start - Load(data.point, 0, at + n.offset);
      const Lanes reg = kRegPair * data.weights.reg * Dot(edge, edge) * strain;
      for (int k = 0; k < rank; ++k) {
        const int move = 3 * k, turn = turns + 3 * k;
        const Point8 moved = three(own, move) - Load(x, move, at + n.offset);
        const Point8 own_turn = three(own, turn), their_turn = Load(x, turn, at + n.offset);
        const Point8 mine = moved + Cross(edge, own_turn), theirs = moved + Cross(edge, their_turn);
        const Point8 force = rigid * (mine + theirs);
        const Point8 torque = rigid * RigidTorque(edge, mine) + reg * (own_turn - their_turn);
        sum[move] += force.x, sum[move + 1] += force.y, sum[move + 2] += force.z;
        sum[turn] += torque.x, sum[turn + 1] += torque.y, sum[turn + 2] += torque.z;
      }
    }
    const Lanes* entries = blocks.block(block);
    for (int i = 0; i < size; ++i) {
      const Lanes* row = entries + blocks.at(i, 0);
      for (int j = std::max(0, i - band); j < i; ++j) sum[i] += row[j] * own[j], sum[j] += row[j] * own[i];
      sum[i] += row[i] * own[i];
    }
    Lanes dot{};
    for (int i = 0; i < 2 * size; ++i) {
      StoreLanes(out[i] + at, sum[i]);
      dot += sum[i] * own[i];
    }
    product += Sum(dot);
  });
  return product;
}

}  // namespace

Triple<Lanes> MotionAt(const EnergyData& data, const Planes& unknowns, int frame, ptrdiff_t at) {
  Point8 motion{};
  for (int k = data.basis.First(frame); k < data.basis.End(frame); ++k)
    motion = motion + data.basis(frame, k) * Load(unknowns, 3 * k, at);
  return motion;
}

MotionBlocks::MotionBlocks(const Grid& grid, const TimeBasis& basis)
    : size_(3 * basis.rank()),
      // Frames by themselves: accelerations couple a frame with the second next, axis by axis.
      band_(basis.per_frame() ? std::min(size_ - 1, 8) : size_ - 1),
      per_block_(0),
      row_start_(size_) {
  for (int row = 0; row < size_; ++row) {
    const int first = std::max(0, row - band_);
    row_start_[row] = per_block_ - first;
    per_block_ += row - first + 1;
  }
  values_.resize(static_cast<size_t>(per_block_) * grid.blocks());
}

void MotionBlocks::Factor() {
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

void MotionBlocks::Solve(int block_index, Lanes* x) const {
  const Lanes* m = block(block_index);
  for (int i = 0; i < size_; ++i) {
    const Lanes* row = m + at(i, 0);
    for (int j = std::max(0, i - band_); j < i; ++j) x[i] -= row[j] * x[j];
  }
  for (int i = 0; i < size_; ++i) x[i] *= m[at(i, i)];
  for (int i = size_ - 1; i >= 0; --i) {
    const Lanes* row = m + at(i, 0);
    for (int j = std::max(0, i - band_); j < i; ++j) x[j] -= row[j] * x[i];
  }
}

void Linearise(const EnergyData& data, const Planes& unknowns, Linearisation& out) {
  const double points = LinearisePoints(data, unknowns, out.blocks, out.gradient);
  out.cost = points + LineariseEdges(data, unknowns, out.gradient);
}

double CostOf(const EnergyData& data, const Planes& unknowns) {
  Linearisation scratch(data);
  Linearise(data, unknowns, scratch);
  return scratch.cost;
}

double ApplyNormalMatrix(const EnergyData& data, const MotionBlocks& blocks, const Planes& x, Planes& out) {
  if (data.rank() == 1) return ApplyRanked<1>(data, blocks, x, out);
  if (data.rank() == 2) return ApplyRanked<2>(data, blocks, x, out);
  return ApplyRanked<0>(data, blocks, x, out);
}

Preconditioner::Preconditioner(const EnergyData& data, const MotionBlocks& blocks)
    : motion_(blocks), turn_(static_cast<size_t>(data.grid.blocks()) * 6) {
  const Neighbourhood neighbours(data.grid);
  data.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    const Point8 start = Load(data.point, 0, at);
    Lanes stiffness{}, m[6] = {};  // xx, yx, yy, zx, zy, zz
    for (const Neighbour& n : neighbours.of) {
      const Lanes strain = LoadLanes(data.strain[n.direction] + at + n.edge_offset);
      const Lanes rigid = data.weights.rigid * strain;
      const Point8 e = start - Load(data.point, 0, at + n.offset);
      const Lanes length2 = Dot(e, e);
      const Lanes reg = kRegPair * data.weights.reg * length2 * strain;
      stiffness += 2 * rigid;
      // [e]^T [e] = |e|^2 - e e^T
      m[0] += rigid * (length2 - e.x * e.x) + reg;
      m[1] -= rigid * e.y * e.x;
      m[2] += rigid * (length2 - e.y * e.y) + reg;
      m[3] -= rigid * e.z * e.x;
      m[4] -= rigid * e.z * e.y;
      m[5] += rigid * (length2 - e.z * e.z) + reg;
    }
    Lanes* motion = motion_.block(block);
    for (int i = 0; i < motion_.size(); ++i) motion[motion_.at(i, i)] += stiffness;
    m[0] += kDamping, m[2] += kDamping, m[5] += kDamping;
    const Lanes c00 = m[2] * m[5] - m[4] * m[4], c10 = m[4] * m[3] - m[1] * m[5], c20 = m[1] * m[4] - m[2] * m[3];
    const Lanes over = 1.0F / (m[0] * c00 + m[1] * c10 + m[3] * c20);
    Lanes* inverse = &turn_[static_cast<size_t>(block) * 6];
    inverse[0] = c00 * over;
    inverse[1] = c10 * over;
    inverse[2] = (m[0] * m[5] - m[3] * m[3]) * over;
    inverse[3] = c20 * over;
    inverse[4] = (m[1] * m[3] - m[0] * m[4]) * over;
    inverse[5] = (m[0] * m[2] - m[1] * m[1]) * over;
  });
  motion_.Factor();
}

double Preconditioner::Apply(const EnergyData& data, const Planes& r, Planes& out) const {
  const int size = motion_.size(), rank = data.rank();
  std::vector<Lanes> x(size);
  double product = 0;
  data.grid.ForEachBlock([&](ptrdiff_t at, int block) {
    for (int i = 0; i < size; ++i) x[i] = LoadLanes(r[i] + at);
    motion_.Solve(block, x.data());
    Lanes dot{};
    for (int i = 0; i < size; ++i) {
      dot += x[i] * LoadLanes(r[i] + at);
      StoreLanes(out[i] + at, x[i]);
    }
    const Lanes* m = &turn_[static_cast<size_t>(block) * 6];
    for (int k = 0; k < rank; ++k) {
      const Point8 v = Load(r, size + 3 * k, at);
      const Point8 turned{m[0] * v.x + m[1] * v.y + m[3] * v.z, m[1] * v.x + m[2] * v.y + m[4] * v.z,
                          m[3] * v.x + m[4] * v.y + m[5] * v.z};
      Store(out, size + 3 * k, at, turned);
      dot += Dot(turned, v);
    }
    product += Sum(dot);
  });
  return product;
}

}  // namespace depthtween
