#include "core/sceneflow/flow_matches.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/flow/lost_motion.h"
#include "core/sceneflow/pyramid.h"
#include "core/sceneflow/range_flow.h"

namespace depthtween {
namespace {

using FlowBothWays = std::array<Image<Flow2>, 2>;  // forward, backward

// Flow that returns within this many pixels of its start is trusted.
constexpr float kRoundTripPx = 1.0F, kRoundTripPerPx = 0.02F;
// Flow smears over silhouettes: matches this near to one count less.
constexpr int kSmearPx = 3;
constexpr float kSmearWeight = 0.3F;
// At 30 frames a second, small things move farther than they are wide: motion that flow lost is searched for at full
// and at half resolution.
// In a repeating pattern, such as plaid, the best match may be the wrong repetition: ambiguous matches are
// rejected. 1.2 lets some through, 1.6 loses a spotted ball.
constexpr LostMotionOptions kLostMotion = {.scales = 2, .distinct = 1.3F};

// G / (G + noise) of the luma's gradients around each pixel: what noise could have made determines nothing.
Image<FlowInformation> Texture(ImageView<const uint8_t> luma, int threads) {
  const int width = luma.width(), height = luma.height();
  constexpr int kReach = 3;
  constexpr float kNoise = 8.0F;  // of a squared central difference, levels: a camera's noise of two
  Image<FlowInformation> products(width, height), across(width, height), out(width, height);
  const auto add = [](FlowInformation& sum, const FlowInformation& g) {
    sum.xx += g.xx, sum.xy += g.xy, sum.yy += g.yy;
  };
  ParallelRows(height, threads, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      for (int x = 0; x < width; ++x) {
        const float gx = 0.5F * static_cast<float>(luma.Clamped(x + 1, y) - luma.Clamped(x - 1, y));
        const float gy = 0.5F * static_cast<float>(luma.Clamped(x, y + 1) - luma.Clamped(x, y - 1));
        products(x, y) = {gx * gx, gx * gy, gy * gy};
      }
      for (int x = 0; x < width; ++x) {
        FlowInformation sum{0.0F, 0.0F, 0.0F};
        for (int i = -kReach; i <= kReach; ++i) add(sum, products(std::clamp(x + i, 0, width - 1), y));
        across(x, y) = sum;
      }
    }
  });
  ParallelRows(height, threads, [&](int first, int last) {
    constexpr float kCount = (2 * kReach + 1) * (2 * kReach + 1);
    for (int y = first; y < last; ++y)
      for (int x = 0; x < width; ++x) {
        FlowInformation g{0.0F, 0.0F, 0.0F};
        for (int i = -kReach; i <= kReach; ++i) add(g, across(x, std::clamp(y + i, 0, height - 1)));
        const float xx = g.xx / kCount, xy = g.xy / kCount, yy = g.yy / kCount;
        const float determinant = (xx + kNoise) * (yy + kNoise) - xy * xy;
        out(x, y) = {(xx * (yy + kNoise) - xy * xy) / determinant, xy * kNoise / determinant,
                     (yy * (xx + kNoise) - xy * xy) / determinant};
      }
  });
  return out;
}

// Within kSmearPx of another surface, along rows or columns.
Image<uint8_t> NearOtherSurfaces(ImageView<const int> labels) {
  const int width = labels.width(), height = labels.height();
  Image<uint8_t> near(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const bool right = x + 1 < width && labels(x, y) != labels(x + 1, y);
      const bool below = y + 1 < height && labels(x, y) != labels(x, y + 1);
      if (right)
        for (int i = std::max(x - kSmearPx + 1, 0); i <= std::min(x + kSmearPx, width - 1); ++i) near(i, y) = 1;
      if (below)
        for (int i = std::max(y - kSmearPx + 1, 0); i <= std::min(y + kSmearPx, height - 1); ++i) near(x, i) = 1;
    }
  return near;
}

// Keeps the flow of the first search where no motion was recovered.
void KeepUnlessRecovered(const Image<Flow2>& first, const Image<Flow2>& recovered, Image<Flow2>& flow) {
  for (size_t p = 0; p < flow.pixel_count(); ++p) {
    const Flow2 was = first.data()[p], is = recovered.data()[p];
    if (was.u == is.u && was.v == is.v) flow.data()[p] = was;
  }
}

}  // namespace

absl::StatusOr<FlowMatches> FindFlowMatches(const FramePair& pair, ImageView<const int> labels,
                                            std::array<Image<Flow2>, 2>& start) {
  const int width = pair.rays.width(), height = pair.rays.height();
  FlowMatches out;
  constexpr DenseFlowOptions kFlow = {.finest_scale = 0};
  const auto search = [&](const FlowBothWays& from) -> absl::StatusOr<FlowBothWays> {
    std::array<absl::StatusOr<Image<Flow2>>, 2> flows;
    ParallelFor(2, pair.threads, [&](int i) {
      flows[i] = DenseFlow(i == 0 ? pair.from.luma : pair.to.luma, i == 0 ? pair.to.luma : pair.from.luma, kFlow,
                           from[i].empty() ? nullptr : &from[i]);
    });
    for (const auto& flow : flows) RETURN_IF_ERROR(flow.status());
    return FlowBothWays{std::move(*flows[0]), std::move(*flows[1])};
  };
  const Image<FlowInformation> information = Texture(pair.from.luma, pair.threads);
  out.smeared = NearOtherSurfaces(labels);
  // Of the pixels whose flow is not that of `known`, if given.
  const auto matches_of = [&](const FlowBothWays& flow, const Image<Flow2>* known) {
    Image<PointMatch> matches(width, height);
    ParallelRows(height, pair.threads, [&](int first, int last) {
      for (int y = first; y < last; ++y)
        for (int x = 0; x < width; ++x) {
          const float z = pair.from.depth_m(x, y);
          const Flow2 there = flow[0](x, y);
          PointMatch& match = matches(x, y);
          match.point = pair.rays.Point(x, y, z);
          match.place = {static_cast<float>(x) + there.u, static_cast<float>(y) + there.v};
          match.depth_m = SampleSurface(pair.to.depth_m, match.place.u, match.place.v, pair.noise);
          match.depth_sigma_m = pair.noise.At(match.depth_m) + kModelShare * match.depth_m;
          match.information = information(x, y);
          match.flow_weight = match.depth_weight = 0.0F;
          if (!pair.to_rays.Inside(match.place)) continue;
          if (known != nullptr && there.u == (*known)(x, y).u && there.v == (*known)(x, y).v) continue;
          const Flow2 back = SampleFlow(flow[1], match.place.u, match.place.v);
          const float error = std::hypot(there.u + back.u, there.v + back.v) /
                              (kRoundTripPx + kRoundTripPerPx * std::hypot(there.u, there.v));
          match.flow_weight = std::exp(-error * error) / (1.0F + pair.from.distance(x, y));
          if (out.smeared(x, y) != 0) match.flow_weight *= kSmearWeight;
          if (std::abs(match.depth_m - z) > kMostDepthChange * z) match.flow_weight = 0.0F;  // met another surface
          if (match.flow_weight < 0.01F) match.flow_weight = 0.0F;
          const int nx = std::clamp(static_cast<int>(std::lround(match.place.u)), 0, width - 1);
          const int ny = std::clamp(static_cast<int>(std::lround(match.place.v)), 0, height - 1);
          match.depth_weight = match.flow_weight / (1.0F + pair.to.distance(nx, ny));
        }
    });
    return matches;
  };
  ASSIGN_OR_RETURN(FlowBothWays flow, search(start));
  out.matches = matches_of(flow, nullptr);
  FlowBothWays recovered = {flow[0].Clone(), flow[1].Clone()};
  if (RecoverLostMotion(pair.from.luma, pair.to.luma, recovered[0], recovered[1], kLostMotion)) {
    ASSIGN_OR_RETURN(FlowBothWays again, search(recovered));
    for (int i = 0; i < 2; ++i) KeepUnlessRecovered(flow[i], recovered[i], again[i]);
    out.found_again = matches_of(again, &flow[0]);
  }
  start[1] = std::move(flow[1]);  // what RestartFlow does not replace
  return out;
}

absl::StatusOr<Image<PointMatch>> FindRangeMatches(const FramePair& pair) {
  constexpr int kFinestLevel = 1;
  constexpr float kDepthSigmas = 3.0F;  // of depth's noise: half resolution knows no better
  const int width = pair.rays.width(), height = pair.rays.height();
  ASSIGN_OR_RETURN(const RangeField field, RangeFlowCoarseToFine(pair, BuildPyramid(pair), kFinestLevel));
  Image<PointMatch> matches(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      PointMatch& match = matches(x, y);
      const float z = pair.from.depth_m(x, y);
      match.point = pair.rays.Point(x, y, z);
      match.place = {static_cast<float>(x) + field.u(x, y), static_cast<float>(y) + field.v(x, y)};
      match.depth_m = std::max(z + field.w(x, y) * z / pair.rays.focal_px(), kNearestMovedShare * z);
      match.depth_sigma_m = kDepthSigmas * (pair.noise.At(match.depth_m) + kModelShare * match.depth_m);
      match.flow_weight = pair.to_rays.Inside(match.place) ? 1.0F / (1.0F + pair.from.distance(x, y)) : 0.0F;
      match.depth_weight = match.flow_weight;
    }
  return matches;
}

}  // namespace depthtween
