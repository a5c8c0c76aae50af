#include "core/solve/level.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/flow/dense_flow.h"
#include "core/solve/occlusion.h"
#include "core/solve/topology.h"

namespace depthtween {
namespace {

// Neighbours belong together while the deviation from each other's plane is below 3 pixel footprints or 3 deviations.
constexpr float kPlaneSigmas = 3.0F;
// Difference of colours, [0, 1] over three channels, at which neighbours count 1/e; texture alone leaves a rest.
constexpr float kColorSigma = 0.1F, kLeastColorWeight = 0.1F;
// Weights of depth below this are a jump.
constexpr float kJump = 0.1F;
// Flow that is trusted less than this proves no tear.
constexpr float kProof = 0.5F;

bool Exists(const Triple<float>& point) { return point.z > 0; }

float ColorDistance2(Rgb8 a, Rgb8 b) {
  const float r = static_cast<float>(a.r - b.r), g = static_cast<float>(a.g - b.g), l = static_cast<float>(a.b - b.b);
  return (r * r + g * g + l * l) / (255.0F * 255.0F);
}

// exp(-(deviation from the plane / sigma)^2), the larger deviation of both planes.
float PlaneWeight(const Triple<float>& a, const Triple<float>& normal_a, const Triple<float>& b,
                  const Triple<float>& normal_b, float spacing_px, float focal_px, const DepthNoise& noise) {
  const Triple<float> edge = b - a;
  float deviation = std::max(std::abs(Dot(normal_a, edge)), std::abs(Dot(normal_b, edge)));
  if (Dot(normal_a, normal_a) == 0 || Dot(normal_b, normal_b) == 0) deviation = std::abs(edge.z);
  const float z = std::min(a.z, b.z);
  const float sigma = kPlaneSigmas * std::max(spacing_px * z / focal_px, noise.At(z));
  return std::exp(-(deviation * deviation) / (sigma * sigma));
}

// The paper's published w_d w_c, of a squared distance in metres and one of colours in [0, 1]: sigma_d = 0.015, and
// sigma_c = 1 on the scale on which brightness has sigma_2 = 20.
float PrintedCoherence(float length2, float color2) {
  return std::exp(-length2 / (0.015F * 0.015F) - 255.0F * 255.0F * color2);
}

float Focal(const SolveProblem& problem) { return static_cast<float>(0.5 * (problem.camera.fx + problem.camera.fy)); }

uint8_t Nearest(ImageView<const uint8_t> image, float x, float y) {
  return image.Clamped(static_cast<int>(x + 0.5F), static_cast<int>(y + 0.5F));
}
Flow2 Nearest(ImageView<const Flow2> image, float x, float y) {
  return image.Clamped(static_cast<int>(std::max(0.0F, x) + 0.5F), static_cast<int>(std::max(0.0F, y) + 0.5F));
}

// Value and central differences at a place between pixels, [0, 1].
struct Brightness {
  float value, slope_u, slope_v;
};
Brightness BrightnessBetween(ImageView<const uint8_t> luma, float x, float y) {
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const uint8_t* row[4];
  for (int k = 0; k < 4; ++k) row[k] = luma.row(y0 - 1 + k) + x0;
  const auto along = [&](const uint8_t* r, int dx) {
    return (1 - ax) * static_cast<float>(r[dx]) + ax * static_cast<float>(r[dx + 1]);
  };
  const float above = along(row[0], 0), top = along(row[1], 0), bottom = along(row[2], 0), below = along(row[3], 0);
  const float value = (1 - ay) * top + ay * bottom;
  const float left = (1 - ay) * along(row[1], -1) + ay * along(row[2], -1);
  const float right = (1 - ay) * along(row[1], 1) + ay * along(row[2], 1);
  const float up = (1 - ay) * above + ay * top, down = (1 - ay) * bottom + ay * below;
  // The mean of two neighbours half a pixel up and down stands one pixel apart from the other mean.
  constexpr float kScale = 1.0F / 255.0F;
  return {value * kScale, 0.5F * (right - left) * kScale, (down - up) * 0.5F * kScale};
}

}  // namespace

Evidence GatherEvidence(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels) {
  const ImageView<const float> depth = problem.key.depth_m;
  const int step = problem.step;
  const int width = problem.frames[0].track.width(), height = problem.frames[0].track.height();
  const float focal = Focal(problem);
  Evidence evidence{Image<Triple<float>>(width, height), Image<Triple<float>>(width, height),
                    Image<float>(width, height, 1.0F)};
  for (int j = 0; j < height; ++j)
    for (int i = 0; i < width; ++i) {
      const float z = depth(i * step, j * step);
      if (!(z > 0)) continue;
      evidence.point(i, j) = pixels.PointAt(static_cast<float>(i * step), static_cast<float>(j * step), z);
      evidence.normal(i, j) = NormalAt(depth, pixels, i * step, j * step, step, problem.noise);
    }
  if (options.occlusion && !options.printed.occlusion) {
    // Distance to a jump: half a step where an edge is cut, one and a half beside.
    const Image<float> far(width, height, 1.0F);
    for (int j = 0; j < height; ++j)
      for (int i = 0; i < width; ++i) {
        if (!Exists(evidence.point(i, j))) continue;
        for (const auto& d : kEdgeSteps) {
          const int ni = i + d[0], nj = j + d[1];
          if (!evidence.point.Contains(ni, nj)) continue;
          const bool joined =
              Exists(evidence.point(ni, nj)) &&
              PlaneWeight(evidence.point(i, j), evidence.normal(i, j), evidence.point(ni, nj), evidence.normal(ni, nj),
                          static_cast<float>(step), focal, problem.noise) > kJump;
          if (joined) continue;
          const float near = JumpWeight(0.5F * static_cast<float>(step));
          evidence.jump_weight(i, j) = evidence.jump_weight(ni, nj) = near;
        }
      }
    const float near = JumpWeight(0.5F * static_cast<float>(step)),
                beside = JumpWeight(1.5F * static_cast<float>(step));
    const Image<float> at_jump = evidence.jump_weight.Clone();
    for (int j = 0; j < height; ++j)
      for (int i = 0; i < width; ++i) {
        if (at_jump(i, j) <= near) continue;
        for (int dj = -1; dj <= 1; ++dj)
          for (int di = -1; di <= 1; ++di)
            if (at_jump.view().Clamped(i + di, j + dj) <= near) evidence.jump_weight(i, j) = beside;
      }
  }
  const int frames = static_cast<int>(problem.frames.size());
  for (int s = 0; s < frames; ++s) {
    const SolveFrame& frame = problem.frames[s];
    Image<PixelOf<float>>& track = evidence.track.emplace_back(width, height);
    Image<float>& visible = evidence.visible.emplace_back(width, height);
    const ImageView<const uint8_t> before = s == 0 ? problem.key.luma : problem.frames[s - 1].luma;
    const bool tested = options.occlusion && !frame.forward.empty() && !frame.back.empty() && !frame.luma.empty();
    for (int j = 0; j < height; ++j)
      for (int i = 0; i < width; ++i) {
        if (!Exists(evidence.point(i, j))) continue;
        const auto x = static_cast<float>(i * step), y = static_cast<float>(j * step);
        const Flow2 motion = frame.track(i, j);
        const float to_x = x + motion.u, to_y = y + motion.v;
        track(i, j) = pixels.Ideal(to_x, to_y);
        float weight = s == 0 ? 1.0F : evidence.visible[s - 1](i, j);
        if (!(to_x >= 0 && to_y >= 0 && to_x <= static_cast<float>(depth.width() - 1) &&
              to_y <= static_cast<float>(depth.height() - 1)))
          weight = 0;  // outside the image: flow there is invented
        if (weight > 0 && tested) {
          const Flow2 past = s == 0 ? Flow2{} : problem.frames[s - 1].track(i, j);
          const float from_x = x + past.u, from_y = y + past.v;
          const Flow2 flow = Nearest(frame.forward, from_x, from_y);
          // Over four pixels: flow is made of patches, and finer differences are their seams.
          const float divergence =
              0.25F * (Nearest(frame.forward, from_x + 2, from_y).u - Nearest(frame.forward, from_x - 2, from_y).u +
                       Nearest(frame.forward, from_x, from_y + 2).v - Nearest(frame.forward, from_x, from_y - 2).v);
          const float brightness = static_cast<float>(Nearest(frame.luma, to_x, to_y) -
                                                      Nearest(before, std::max(0.0F, from_x), std::max(0.0F, from_y))) /
                                   255.0F;
          weight = std::min(weight, options.printed.occlusion
                                        ? PrintedVisibleWeight(divergence, brightness)
                                        : VisibleWeight(flow, Nearest(frame.back, to_x, to_y), divergence, brightness));
        }
        visible(i, j) = weight;
      }
  }
  return evidence;
}

std::vector<Image<int32_t>> DecimatePoints(const Evidence& evidence, const DepthNoise& noise, int levels) {
  std::vector<Image<int32_t>> sources;
  const int width = evidence.point.width(), height = evidence.point.height();
  Image<int32_t>& finest = sources.emplace_back(width, height, -1);
  for (int j = 0; j < height; ++j)
    for (int i = 0; i < width; ++i)
      if (Exists(evidence.point(i, j))) finest(i, j) = j * width + i;
  const auto depth = [&](int32_t source) { return evidence.point.data()[source].z; };
  while (static_cast<int>(sources.size()) < levels && sources.back().width() >= 8 && sources.back().height() >= 8) {
    const Image<int32_t>& fine = sources.back();
    Image<int32_t> coarse((fine.width() + 1) / 2, (fine.height() + 1) / 2, -1);
    for (int j = 0; j < coarse.height(); ++j)
      for (int i = 0; i < coarse.width(); ++i) {
        // The median of the nearest layer.
        int32_t children[4];
        int count = 0;
        for (int child = 0; child < 4; ++child) {
          const int x = 2 * i + child % 2, y = 2 * j + child / 2;
          if (!fine.Contains(x, y) || fine(x, y) < 0) continue;
          int rank = count++;  // kept in order of depth
          for (; rank > 0 && depth(children[rank - 1]) > depth(fine(x, y)); --rank) children[rank] = children[rank - 1];
          children[rank] = fine(x, y);
        }
        if (count == 0) continue;
        int layer = 1;
        while (layer < count && SameLayer(depth(children[0]), depth(children[layer]), noise)) ++layer;
        coarse(i, j) = children[(layer - 1) / 2];
      }
    sources.push_back(std::move(coarse));
  }
  return sources;
}

Level MakeLevel(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels,
                const Evidence& evidence, Image<int32_t> source, int spacing) {
  Level level;
  level.spacing = spacing;
  EnergyData& data = level.data;
  data.grid = {source.width(), source.height()};
  const Grid& grid = data.grid;
  data.camera = pixels.pinhole();
  for (const SolveFrame& frame : problem.frames) data.times.push_back(frame.time);
  const int frames = static_cast<int>(problem.frames.size());
  data.basis =
      options.model == MotionModel::kPerFrame ? TimeBasis::PerFrame(frames) : TimeBasis::Trajectory(data.times);
  data.weights = options.weights;
  // Steps and tracks say the same twice; brightness is one number for each frame: together they weigh as the paper's
  // one residual for each frame.
  data.over_opti_sigma = 1.0F / options.brightness_sigma;
  data.over_acceleration_sigma = 1.0F / options.acceleration_sigma_px;
  if (options.printed.shortest) data.over_acceleration_sigma = 0, data.steps_share = 1;
  if (options.printed.kernels) data.outlier2 = std::numeric_limits<float>::infinity();
  data.in_metres = options.printed.rigid;
  data.point = Planes(grid, 3);
  data.exists = Planes(grid, 1);
  data.strain = Planes(grid, 4);
  data.footprint = Planes(grid, 1, 1.0F);
  std::fill_n(data.point[2], grid.size(), 1.0F);
  const float focal = Focal(problem);
  const auto spacing_px = static_cast<float>(spacing * problem.step);
  const float over_strain2 = 1.0F / (options.strain_sigma * options.strain_sigma);
  const int step = problem.step, finest_width = evidence.point.width();
  const auto color = [&](int32_t s) { return problem.key.color(s % finest_width * step, s / finest_width * step); };
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      const int32_t own = source(i, j);
      if (own < 0) continue;
      const Triple<float>& p = evidence.point.data()[own];
      const ptrdiff_t at = grid.at(i, j);
      data.point[0][at] = p.x, data.point[1][at] = p.y, data.point[2][at] = p.z;
      data.exists[0][at] = 1.0F;
      data.footprint[0][at] = focal / p.z;
      for (int d = 0; d < 4; ++d) {
        const int ni = i + kEdgeSteps[d][0], nj = j + kEdgeSteps[d][1];
        if (ni < 0 || ni >= grid.width || nj >= grid.height || source(ni, nj) < 0) continue;
        const int32_t other = source(ni, nj);
        const Triple<float>& q = evidence.point.data()[other];
        const Triple<float> edge = p - q;
        const float length2 = Dot(edge, edge), color2 = ColorDistance2(color(own), color(other));
        float weight = PrintedCoherence(length2, color2);
        if (!options.printed.coherence) {
          const float w_depth = PlaneWeight(p, evidence.normal.data()[own], q, evidence.normal.data()[other],
                                            spacing_px, focal, problem.noise);
          if (w_depth < kJump) continue;
          weight = w_depth * std::max(kLeastColorWeight, std::exp(-color2 / (kColorSigma * kColorSigma)));
        }
        data.strain[d][at] =
            weight * (data.in_metres ? 1.0F / (options.edge_sigma_m * options.edge_sigma_m) : over_strain2 / length2);
      }
    }
  data.frames.resize(frames);
  for (int s = 0; s < frames; ++s) {
    FrameData& frame = data.frames[s];
    frame.over_step_sigma = 1.0F / options.step_sigma_px;
    frame.over_track_sigma = 1.0F / (options.step_sigma_px * std::sqrt(static_cast<float>(s + 1)));
    if (options.printed.proj) continue;
    frame.track = Planes(grid, 3);
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i) {
        const int32_t own = source(i, j);
        if (own < 0) continue;
        const ptrdiff_t at = grid.at(i, j);
        const PixelOf<float>& track = evidence.track[s].data()[own];
        frame.track[0][at] = track.u, frame.track[1][at] = track.v;
        frame.track[2][at] = evidence.visible[s].data()[own] * evidence.jump_weight.data()[own];
      }
  }
  level.source = std::move(source);
  return level;
}

namespace {

// Where the track of a point of the finest grid leads in frame s, at depth z.
Triple<float> OnTrack(const Evidence& evidence, const Pinhole<float>& camera, int32_t source, int s, float z) {
  const PixelOf<float>& track = evidence.track[s].data()[source];
  return {(track.u - camera.cx) / camera.fx * z, (track.v - camera.cy) / camera.fy * z, z};
}

Triple<float> TripleAt(const Planes& planes, int first, ptrdiff_t at) {
  return {planes[first][at], planes[first + 1][at], planes[first + 2][at]};
}

Triple<float> MotionOfPoint(const EnergyData& data, const Planes& unknowns, int first, int frame, ptrdiff_t at) {
  Triple<float> motion{};
  for (int k = data.basis.First(frame); k < data.basis.End(frame); ++k)
    motion = motion + data.basis(frame, k) * TripleAt(unknowns, first + 3 * k, at);
  return motion;
}

// Sum over frames of basis(s, k) (R_s - 1), as rows, 9 planes for each coefficient: what the turning of a point adds to
// the motion of another that is fixed to it, for each metre between them.
Planes Levers(const EnergyData& data, const Planes& unknowns) {
  const int frames = static_cast<int>(data.times.size());
  Planes lever(data.grid, 9 * data.rank());
  data.grid.ForEachBlock([&](ptrdiff_t at, int) {
    for (int s = 0; s < frames; ++s) {
      Triple<Lanes> turn{};
      for (int k = data.basis.First(s); k < data.basis.End(s); ++k) {
        const int plane = data.first_turn() + 3 * k;
        turn = turn + data.basis(s, k) * Triple<Lanes>{LoadLanes(unknowns[plane] + at),
                                                       LoadLanes(unknowns[plane + 1] + at),
                                                       LoadLanes(unknowns[plane + 2] + at)};
      }
      Rotation<Lanes> r = RotationOf(turn);
      r.row[0].x -= 1.0F, r.row[1].y -= 1.0F, r.row[2].z -= 1.0F;
      for (int k = data.basis.First(s); k < data.basis.End(s); ++k) {
        const float b = data.basis(s, k);
        const Lanes* entries[9] = {&r.row[0].x, &r.row[0].y, &r.row[0].z, &r.row[1].x, &r.row[1].y,
                                   &r.row[1].z, &r.row[2].x, &r.row[2].y, &r.row[2].z};
        for (int e = 0; e < 9; ++e) {
          float* to = lever[9 * k + e] + at;
          StoreLanes(to, LoadLanes(to) + b * *entries[e]);
        }
      }
    }
  });
  return lever;
}

}  // namespace

void StartFromTracks(const SolveProblem& problem, const Evidence& evidence, const PartnerSurface& other,
                     const Level& level, Planes& unknowns) {
  const EnergyData& data = level.data;
  const Grid& grid = data.grid;
  const int frames = static_cast<int>(data.times.size()), finest_width = evidence.point.width();
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      const int32_t source = level.source(i, j);
      if (source < 0) continue;
      const Triple<float>& p = evidence.point.data()[source];
      const Rgb8 color = problem.key.color(source % finest_width * problem.step, source / finest_width * problem.step);
      const std::optional<Partner> partner =
          FindPartner(other, OnTrack(evidence, data.camera, source, frames - 1, p.z), {}, color);
      const float z_end = partner ? partner->point.z : p.z;
      const ptrdiff_t at = grid.at(i, j);
      // The basis is orthonormal: a coefficient is the motion's product with it.
      for (int s = 0; s < frames; ++s) {
        const float z = p.z + data.times[s] * (z_end - p.z);
        const Triple<float> motion = OnTrack(evidence, data.camera, source, s, z) - p;
        for (int k = data.basis.First(s); k < data.basis.End(s); ++k) {
          const float b = data.basis(s, k);
          unknowns[3 * k][at] += b * motion.x;
          unknowns[3 * k + 1][at] += b * motion.y;
          unknowns[3 * k + 2][at] += b * motion.z;
        }
      }
    }
}

void Prolong(const Level& coarse, const Planes& coarse_unknowns, const Evidence& evidence, const DepthNoise& noise,
             const Level& fine, Planes& fine_unknowns) {
  const EnergyData& data = fine.data;
  const int rank = data.rank(), turns = data.first_turn(), finest_width = evidence.point.width();
  const float focal = 0.5F * (data.camera.fx + data.camera.fy);
  const Planes lever = Levers(coarse.data, coarse_unknowns);
  const int pixels_per_point = 2;  // of the finest grid; only the width of a soft gate
  for (int j = 0; j < data.grid.height; ++j)
    for (int i = 0; i < data.grid.width; ++i) {
      const int32_t own = fine.source(i, j);
      if (own < 0) continue;
      const Triple<float>& p = evidence.point.data()[own];
      const Triple<float>& normal = evidence.normal.data()[own];
      const ptrdiff_t at = data.grid.at(i, j);
      // Its cell and the neighbours on its side of it.
      float total = 0, weights[4];
      ptrdiff_t from[4];
      for (int n = 0; n < 4; ++n) {
        const int ci = i / 2 + (n % 2 == 0 ? 0 : (i % 2 == 0 ? -1 : 1));
        const int cj = j / 2 + (n / 2 == 0 ? 0 : (j % 2 == 0 ? -1 : 1));
        weights[n] = 0, from[n] = 0;
        if (!coarse.source.Contains(ci, cj) || coarse.source(ci, cj) < 0) continue;
        const int32_t parent = coarse.source(ci, cj);
        const float dx = static_cast<float>(parent % finest_width - own % finest_width);
        const float dy = static_cast<float>(parent / finest_width - own / finest_width);
        const auto pitch = static_cast<float>(coarse.spacing);
        const float near = std::exp(-(dx * dx + dy * dy) / (pitch * pitch));
        // Even the wrong surface is better than none.
        constexpr float kLeast = 1e-6F;
        weights[n] =
            near * (kLeast + PlaneWeight(p, normal, evidence.point.data()[parent], evidence.normal.data()[parent],
                                         pitch * pixels_per_point, focal, noise));
        from[n] = coarse.data.grid.at(ci, cj);
        total += weights[n];
      }
      if (!(total > 0)) continue;
      for (int n = 0; n < 4; ++n) {
        const float w = weights[n] / total;
        if (w == 0) continue;
        const Triple<float> arm = p - TripleAt(coarse.data.point, 0, from[n]);
        for (int k = 0; k < rank; ++k) {
          const Triple<float> turn = TripleAt(coarse_unknowns, turns + 3 * k, from[n]);
          const Triple<float> swing{Dot(TripleAt(lever, 9 * k, from[n]), arm),
                                    Dot(TripleAt(lever, 9 * k + 3, from[n]), arm),
                                    Dot(TripleAt(lever, 9 * k + 6, from[n]), arm)};
          const Triple<float> motion = TripleAt(coarse_unknowns, 3 * k, from[n]) + swing;
          fine_unknowns[3 * k][at] += w * motion.x;
          fine_unknowns[3 * k + 1][at] += w * motion.y;
          fine_unknowns[3 * k + 2][at] += w * motion.z;
          fine_unknowns[turns + 3 * k][at] += w * turn.x;
          fine_unknowns[turns + 3 * k + 1][at] += w * turn.y;
          fine_unknowns[turns + 3 * k + 2][at] += w * turn.z;
        }
      }
    }
}

int Associate(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels,
              const Evidence& evidence, const PartnerSurface& other, const Planes& unknowns, Level& level) {
  EnergyData& data = level.data;
  const Grid& grid = data.grid;
  const int frames = static_cast<int>(data.times.size()), finest_width = evidence.point.width();
  const float focal = Focal(problem);
  data.partner = Planes(grid, 8);
  for (int s = 0; s < frames; ++s) {
    const SolveFrame& frame = problem.frames[s];
    const bool steps = !frame.forward.empty() && data.weights.proj > 0 && !(options.printed.proj && s == 0);
    data.frames[s].step = steps ? Planes(grid, 3) : Planes();
    data.frames[s].opti = frame.luma.empty() || data.weights.opti == 0 ? Planes() : Planes(grid, 6);
  }
  int partners = 0;
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      const int32_t source = level.source(i, j);
      if (source < 0) continue;
      const ptrdiff_t at = grid.at(i, j);
      const Triple<float>& start = evidence.point.data()[source];
      const int x = source % finest_width * problem.step, y = source / finest_width * problem.step;
      const float trust = evidence.jump_weight.data()[source];
      const float own_brightness = static_cast<float>(problem.key.luma.empty() ? 0 : problem.key.luma(x, y)) / 255.0F;
      PixelOf<float> ideal_before = Project(data.camera, start);
      PixelOf<float> before{static_cast<float>(x), static_cast<float>(y)};
      Triple<float> end = start;
      for (int s = 0; s < frames; ++s) {
        end = start + MotionOfPoint(data, unknowns, 0, s, at);
        if (!(end.z > 0)) break;
        FrameData& to = data.frames[s];
        const PixelOf<float> ideal = Project(data.camera, end);
        const PixelOf<float> seen = pixels.Seen(ideal.u, ideal.v);
        const float weight = trust * evidence.visible[s].data()[source];
        const int width = problem.key.depth_m.width(), height = problem.key.depth_m.height();
        if (!to.step.empty() && before.u >= 0 && before.v >= 0 && before.u <= static_cast<float>(width - 1) &&
            before.v <= static_cast<float>(height - 1)) {
          const Flow2 flow = SampleFlow(problem.frames[s].forward, before.u, before.v);
          const PixelOf<float> there = pixels.Ideal(before.u + flow.u, before.v + flow.v);
          to.step[0][at] = there.u - ideal_before.u;
          to.step[1][at] = there.v - ideal_before.v;
          to.step[2][at] = weight;
        }
        // Brightness is read with a margin of one pixel for its slope.
        if (!to.opti.empty() && seen.u >= 1 && seen.v >= 1 && seen.u < static_cast<float>(width - 2) &&
            seen.v < static_cast<float>(height - 2)) {
          const Brightness b = BrightnessBetween(problem.frames[s].luma, seen.u, seen.v);
          to.opti[0][at] = b.value - own_brightness;
          to.opti[1][at] = b.slope_u, to.opti[2][at] = b.slope_v;
          to.opti[3][at] = ideal.u, to.opti[4][at] = ideal.v;
          to.opti[5][at] = weight;
        }
        before = seen, ideal_before = ideal;
      }
      const Triple<float> turn = MotionOfPoint(data, unknowns, data.first_turn(), frames - 1, at);
      const Triple<float> normal = RotationOf(turn) * evidence.normal.data()[source];
      const std::optional<Partner> partner = options.printed.closest
                                                 ? ClosestPartner(other, start)
                                                 : FindPartner(other, end, normal, problem.key.color(x, y));
      if (!partner) continue;
      ++partners;
      const Triple<float>&q = partner->point, &n = partner->normal;
      data.partner[0][at] = q.x, data.partner[1][at] = q.y, data.partner[2][at] = q.z;
      data.partner[3][at] = n.x, data.partner[4][at] = n.y, data.partner[5][at] = n.z;
      // Weights enter squared. Both depths are noisy.
      const float root = std::sqrt(trust), sigma = std::sqrt(2.0F) * problem.noise.At(q.z);
      data.partner[6][at] = root * focal / (options.point_sigma_footprints * q.z);
      data.partner[7][at] = root / sigma;
      if (options.printed.point) data.partner[6][at] = data.partner[7][at];
    }
  return partners;
}

int CutTorn(const SolveProblem& problem, const IdealPixels& pixels, const Evidence& evidence, Level& level) {
  EnergyData& data = level.data;
  const Grid& grid = data.grid;
  const int last = static_cast<int>(data.times.size()) - 1;
  int cut = 0;
  // The tracks in space, at the middle and at the end. Without a partner nothing is proven.
  for (const int s : {last / 2, last}) {
    Image<Triple<float>> moved(grid.width, grid.height);
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i) {
        const int32_t source = level.source(i, j);
        const ptrdiff_t at = grid.at(i, j);
        if (source < 0 || data.partner[7][at] == 0 || evidence.visible[last].data()[source] < kProof) continue;
        const float z = evidence.point.data()[source].z;
        moved(i, j) = OnTrack(evidence, data.camera, source, s, z + data.times[s] * (data.partner[2][at] - z));
      }
    for (int j = 0; j < grid.height; ++j)
      for (int i = 0; i < grid.width; ++i)
        for (int d = 0; d < 4; ++d) {
          float& strain = data.strain[d][grid.at(i, j)];
          if (strain == 0) continue;
          const int ni = i + kEdgeSteps[d][0], nj = j + kEdgeSteps[d][1];
          if (!Exists(moved(i, j)) || !Exists(moved(ni, nj))) continue;
          const Triple<float> edge = TripleAt(data.point, 0, grid.at(i, j)) - TripleAt(data.point, 0, grid.at(ni, nj));
          const Triple<float> now = moved(i, j) - moved(ni, nj);
          if (!Torn(std::sqrt(Dot(edge, edge)), std::sqrt(Dot(now, now)), problem.noise.At(moved(i, j).z))) continue;
          strain = 0;
          ++cut;
        }
    if (last == 0) break;  // the middle is the end
  }
  return cut;
}

int WeighTopologyAsPrinted(const Evidence& evidence, Level& level) {
  EnergyData& data = level.data;
  const Grid& grid = data.grid;
  const int s = static_cast<int>(data.times.size()) - 2;
  int lost = 0;
  if (s < 0) return lost;
  // Points without a counterpart in the other key keep their edges.
  const auto tracked = [&](int i, int j) {
    const int32_t source = level.source(i, j);
    if (source < 0 || data.partner[7][grid.at(i, j)] == 0) return Triple<float>{};
    return OnTrack(evidence, data.camera, source, s, evidence.point.data()[source].z);
  };
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i)
      for (int d = 0; d < 4; ++d) {
        float& strain = data.strain[d][grid.at(i, j)];
        if (strain == 0) continue;
        const int ni = i + kEdgeSteps[d][0], nj = j + kEdgeSteps[d][1];
        const Triple<float> own = tracked(i, j), other = tracked(ni, nj), now = own - other;
        if (!Exists(own) || !Exists(other)) continue;
        const Triple<float> edge = TripleAt(data.point, 0, grid.at(i, j)) - TripleAt(data.point, 0, grid.at(ni, nj));
        const float weight = PrintedTopologyWeight(std::sqrt(Dot(edge, edge)), std::sqrt(Dot(now, now)));
        strain *= weight;
        lost += weight < 0.5F;
      }
  return lost;
}

}  // namespace depthtween
