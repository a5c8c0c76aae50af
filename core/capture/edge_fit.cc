#include "core/capture/edge_fit.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

#include "core/base/parallel.h"

namespace depthtween {
namespace {

// The normal equations of one step of mean shift: each edge is drawn to the changes of colour within `radius_px` of
// where `causes` puts it.
struct Sums {
  CauseMatrix normal = CauseMatrix::Zero();
  Causes right = Causes::Zero();
};
Sums Gather(const Comparisons& comparisons, const Causes& causes, float radius_px, int left_out_part) {
  Sums sums;
  for (const Comparison& comparison : comparisons) {
    if (comparison.part == left_out_part) continue;
    const auto expected = static_cast<float>(comparison.causes.dot(causes));
    float weight = 0, moment = 0;
    for (int i = 0; i < kSamples; ++i) {
      const float m = kSampleStepPx * static_cast<float>(i) - kReachPx, off = (m - expected) / radius_px;
      const float inside = std::max(0.0F, 1 - off * off), share = comparison.share[i] * inside * inside;
      weight += share, moment += share * m;
    }
    sums.normal += weight * comparison.causes * comparison.causes.transpose();
    sums.right += static_cast<double>(moment) * comparison.causes;
  }
  return sums;
}

// So little that it decides only what no edge tells: that stays near 0.
constexpr double kLeast = 1e-6;

// Neighbouring edges tell nearly the same: so many count as one against what was thought before.
constexpr double kEdgesThatCountAsOne = 100.0;

// Leaves the normal matrix of the last step in `normal`, if asked for. `left_out`: a part, or -1.
Causes Fit(const std::vector<Comparisons>& keys, Causes causes, const std::vector<float>& radii_px,
           const EdgeFitOptions& options, int left_out, CauseMatrix* normal = nullptr) {
  constexpr int kMaxSteps = 40;
  constexpr double kSettled = 1e-3;  // milliseconds and pixels
  const int of_image = options.parts == Parts::kOfTheImage ? left_out : -1;
  const int of_clip = options.parts == Parts::kOfTheClip ? left_out : -1;
  std::vector<Sums> sums(keys.size());
  for (const float radius : radii_px)
    for (int step = 0; step < kMaxSteps; ++step) {
      ParallelFor(static_cast<int>(keys.size()), options.threads,
                  [&](int k) { sums[k] = Gather(keys[k], causes, radius, of_image); });
      Sums all;
      for (size_t k = 0; k < keys.size(); ++k)
        if (static_cast<int>(k * kParts / keys.size()) != of_clip)
          all.normal += sums[k].normal, all.right += sums[k].right;
      for (int cause = 0; cause < kCauses; ++cause) {
        const double sigma = options.sigma(cause);
        if (sigma > 0) {
          all.normal(cause, cause) += std::max(kLeast, kEdgesThatCountAsOne / (sigma * sigma));
        } else {
          all.normal.row(cause).setZero(), all.normal.col(cause).setZero();
          all.normal(cause, cause) = 1, all.right(cause) = 0;
        }
      }
      const Causes before = causes;
      causes = all.normal.fullPivLu().solve(all.right);
      if (normal != nullptr) *normal = all.normal;
      if ((causes - before).cwiseAbs().maxCoeff() < kSettled) break;
    }
  return causes;
}

constexpr float kNarrowestPx = 2.5F;

// Wide at first, so that the search need not have been exact; then narrow, so that the edge itself counts and not the
// texture around it.
std::vector<float> Radii(float widest_px) {
  std::vector<float> radii;
  for (const float share : {1.0F, 2.0F / 3, 4.0F / 9})
    if (share * widest_px > kNarrowestPx) radii.push_back(share * widest_px);
  radii.push_back(kNarrowestPx);
  return radii;
}

}  // namespace

double Nearness(const DepthEdge& edge, double reference_m) { return std::min(100.0, reference_m / edge.near_m - 1); }

DepthEdge Registered(DepthEdge edge, const Registration& registration, int width, int height) {
  const Flow2 move = registration.Displacement(width, height, edge.x, edge.y, edge.near_m);
  edge.x += move.u, edge.y += move.v;
  return edge;
}

Comparisons CompareEdges(const MovingPicture& picture, const std::vector<DepthEdge>& edges, const EdgeLook& look) {
  constexpr size_t kMaxEdges = 1500;  // neighbours tell nearly the same
  constexpr int kColumns = 4, kRowsOfParts = kParts / kColumns;
  const double half_width = 0.5 * (look.width - 1), half_height = 0.5 * (look.height - 1);
  const size_t every = edges.size() / kMaxEdges + 1;
  Comparisons comparisons;
  for (size_t e = 0; e < edges.size(); e += every) {
    const DepthEdge edge = Registered(edges[e], look.registration, look.width, look.height);
    if (!picture.Contains(edge.x, edge.y, 0)) continue;
    const MovingPicture::Moved moved = picture.Move(edge, look.apart_ms);
    if (!picture.Contains(moved.x, moved.y, kReachPx + 1)) continue;
    const double nx = edge.normal_x, ny = edge.normal_y, speed = moved.velocity_x * nx + moved.velocity_y * ny;
    const double from_middle = (edge.x - half_width) * nx + (edge.y - half_height) * ny;
    const double nearness = Nearness(edge, look.registration.reference_m);
    Comparison comparison;
    comparison.causes << -speed, -speed * look.place, -speed * (moved.y - half_height) / half_height, -1, -nx, -ny,
        -from_middle / half_width, -nx * nearness, -ny * nearness;
    comparison.part =
        std::clamp(static_cast<int>(edge.x * kColumns / static_cast<float>(look.width)), 0, kColumns - 1) +
        kColumns *
            std::clamp(static_cast<int>(edge.y * kRowsOfParts / static_cast<float>(look.height)), 0, kRowsOfParts - 1);
    float sum = kSamples * kNoiseContrast2 / 4;
    for (int i = 0; i < kSamples; ++i) {
      const float m = kSampleStepPx * static_cast<float>(i) - kReachPx;
      comparison.share[i] =
          picture.Contrast2(moved.x + m * edge.normal_x, moved.y + m * edge.normal_y, edge.normal_x, edge.normal_y);
      sum += comparison.share[i];
    }
    for (float& share : comparison.share) share /= sum;
    comparisons.push_back(comparison);
  }
  return comparisons;
}

Causes FitCauses(const std::vector<Comparisons>& keys, const EdgeFitOptions& options) {
  return Fit(keys, Causes::Zero(), Radii(options.widest_px), options, -1);
}

EdgeFit FitWithCovariance(const std::vector<Comparisons>& keys, const EdgeFitOptions& options) {
  EdgeFit fitted;
  CauseMatrix normal;
  fitted.causes = Fit(keys, Causes::Zero(), Radii(options.widest_px), options, -1, &normal);
  std::array<Causes, kParts> without;
  Causes mean = Causes::Zero();
  for (int part = 0; part < kParts; ++part) {
    without[part] = Fit(keys, fitted.causes, {kNarrowestPx}, options, part);
    mean += without[part] / kParts;
  }
  for (const Causes& causes : without)
    fitted.covariance += (kParts - 1.0) / kParts * (causes - mean) * (causes - mean).transpose();
  // Where nothing moves, all parts may agree on nothing: one edge is told to about a pixel, and no estimate is better
  // than many of them together.
  constexpr double kVariancePerEdge = 1.0;
  fitted.covariance += kVariancePerEdge * normal.inverse();
  for (int cause = 0; cause < kCauses; ++cause)
    if (!(options.sigma(cause) > 0)) fitted.covariance.row(cause).setZero(), fitted.covariance.col(cause).setZero();
  return fitted;
}

Registration Corrected(Registration registration, const Causes& causes, int width) {
  registration.right_px -= causes(kRight), registration.down_px -= causes(kDown);
  registration.scale -= causes(kLarger) / (0.5 * (width - 1));
  registration.parallax_x_px_m -= causes(kNearX) * registration.reference_m;
  registration.parallax_y_px_m -= causes(kNearY) * registration.reference_m;
  return registration;
}

double MedianNearM(const std::vector<DepthEdge>& edges) {
  if (edges.empty()) return 1.0;
  std::vector<float> nears;
  nears.reserve(edges.size());
  for (const DepthEdge& edge : edges) nears.push_back(edge.near_m);
  const auto middle = nears.begin() + static_cast<ptrdiff_t>(nears.size() / 2);
  std::nth_element(nears.begin(), middle, nears.end());
  return *middle;
}

}  // namespace depthtween
