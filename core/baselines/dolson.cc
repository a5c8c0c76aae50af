#include "core/baselines/dolson.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "core/baselines/frame_steps.h"
#include "core/baselines/permutohedral_lattice.h"

namespace depthtween {
namespace {

// A frame is filtered tile by tile, so that memory is that of a tile's lattice and its table stays in the cache. A tile
// sees the keys within this many sigmas; half a per cent of the weight lies beyond.
constexpr int kTilePx = 128;
constexpr float kMarginSigmas = 3.0F;
// A mean with less weight than this share of a single pixel's comes from the lattice's far tails and is not trusted.
constexpr float kLeastWeight = 1e-4F;
// Depths whose spread around their mean is below this many depth sigmas are one layer: the mean is its mode.
constexpr float kOneLayer = 0.5F;
constexpr int kMeanShifts = 3;
constexpr int kMaxStarts = 6;

struct ColorDepth {
  Image<Rgb8> color;
  Image<float> depth_m;
  float time = 0.0F;  // in intervals
};

struct Rect {
  int x0, y0, x1, y1;  // the last ones exclusive
};

// The points of one tile in sigmas; z only in a lattice of depth.
class TileSpace {
 public:
  TileSpace(const DolsonOptions& options, const Rect& tile) : options_(options), tile_(tile) {}
  std::array<float, 7> At(int x, int y, Rgb8 color, float time, float depth_m = 1.0F) const {
    return {static_cast<float>(x - tile_.x0) / options_.space_sigma_px,
            static_cast<float>(y - tile_.y0) / options_.space_sigma_px,
            static_cast<float>(color.r) / options_.color_sigma,
            static_cast<float>(color.g) / options_.color_sigma,
            static_cast<float>(color.b) / options_.color_sigma,
            time / options_.time_sigma,
            std::log(depth_m) / options_.depth_sigma};
  }

 private:
  const DolsonOptions& options_;
  const Rect tile_;
};

class FrameFilter {
 public:
  FrameFilter(const DolsonOptions& options, const std::array<ColorDepth, 2>& keys, const Image<Rgb8>& color, float time)
      : options_(options), keys_(keys), color_(color), time_(time) {}

  void Tile(const Rect& tile, Image<float>& depth_m) const {
    const TileSpace space(options_, tile);
    const int margin = static_cast<int>(std::ceil(kMarginSigmas * options_.space_sigma_px));
    const Rect around = {std::max(0, tile.x0 - margin), std::max(0, tile.y0 - margin),
                         std::min(color_.width(), tile.x1 + margin), std::min(color_.height(), tile.y1 + margin)};
    PermutohedralLattice lattice(6, 3);
    for (const ColorDepth& key : keys_)
      for (int y = around.y0; y < around.y1; ++y)
        for (int x = around.x0; x < around.x1; ++x) {
          const float z = key.depth_m(x, y);
          if (z <= 0.0F) continue;
          const float value[3] = {z, z * z, 1.0F};
          lattice.Splat(lattice.AddPoint(space.At(x, y, key.color(x, y), key.time).data()), value);
        }
    std::vector<int> queries;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x)
        queries.push_back(lattice.AddPoint(space.At(x, y, color_(x, y), time_).data()));
    lattice.Blur();
    std::vector<std::pair<int, int>> spread;  // pixels that average several layers
    size_t query = 0;
    for (int y = tile.y0; y < tile.y1; ++y)
      for (int x = tile.x0; x < tile.x1; ++x) {
        float sums[3];
        lattice.Slice(queries[query++], sums);
        if (sums[2] < kLeastWeight) continue;
        const float mean = sums[0] / sums[2];
        depth_m(x, y) = mean;
        const float variance = sums[1] / sums[2] - mean * mean;
        const float one_layer = kOneLayer * options_.depth_sigma * mean;
        if (variance > one_layer * one_layer) spread.emplace_back(x, y);
      }
    if (options_.seek_mode && !spread.empty()) SeekModes(space, around, spread, depth_m);
  }

 private:
  void SeekModes(const TileSpace& space, const Rect& around, const std::vector<std::pair<int, int>>& pixels,
                 Image<float>& depth_m) const {
    PermutohedralLattice lattice(7, 2);
    for (const ColorDepth& key : keys_)
      for (int y = around.y0; y < around.y1; ++y)
        for (int x = around.x0; x < around.x1; ++x) {
          const float z = key.depth_m(x, y);
          if (z <= 0.0F) continue;
          const float value[2] = {z, 1.0F};
          lattice.Splat(lattice.AddPoint(space.At(x, y, key.color(x, y), key.time, z).data()), value);
        }
    std::vector<std::vector<float>> starts;
    for (const auto& [x, y] : pixels) {
      starts.push_back(Starts(x, y));
      starts.back().push_back(depth_m(x, y));
      for (const float z : starts.back()) lattice.AddPoint(space.At(x, y, color_(x, y), time_, z).data());
    }
    lattice.Blur();
    for (size_t i = 0; i < pixels.size(); ++i) {
      const auto [x, y] = pixels[i];
      float best = 0.0F, densest = kLeastWeight;
      for (float z : starts[i]) {
        float sums[2] = {};
        for (int shift = 0; shift <= kMeanShifts; ++shift) {
          lattice.SliceAt(space.At(x, y, color_(x, y), time_, z).data(), sums);
          if (sums[1] <= 0.0F) break;
          z = sums[0] / sums[1];
        }
        if (sums[1] > densest) densest = sums[1], best = z;
      }
      if (best > 0.0F) depth_m(x, y) = best;
    }
  }

  // Key depths at a pixel and one and two sigmas around it, one for each layer.
  std::vector<float> Starts(int x, int y) const {
    std::vector<float> starts;
    for (const float sigmas : {0.0F, 1.0F, 2.0F})
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          for (const ColorDepth& key : keys_) {
            const int step = static_cast<int>(std::lround(sigmas * options_.space_sigma_px));
            const int at_x = x + dx * step, at_y = y + dy * step;
            if (!key.depth_m.Contains(at_x, at_y) || starts.size() >= kMaxStarts) continue;
            const float z = key.depth_m(at_x, at_y);
            const auto same = [&](float other) { return std::abs(std::log(z / other)) < options_.depth_sigma; };
            if (z > 0.0F && std::none_of(starts.begin(), starts.end(), same)) starts.push_back(z);
          }
    return starts;
  }

  const DolsonOptions& options_;
  const std::array<ColorDepth, 2>& keys_;
  const Image<Rgb8>& color_;
  const float time_;
};

}  // namespace

absl::StatusOr<IntervalSummary> DolsonBaseline::Run(const FrameSource& source, const ClipConstants& constants,
                                                    const Interval& interval, const RunContext& context,
                                                    const FrameSink& sink) const {
  if (interval.Held()) return HoldInterval(source, constants, interval, context, sink);
  StageRunner stages(context);
  stages.Begin("read");
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(KeyPair read, ReadKeys(source, interval));
  std::array<ColorDepth, 2> keys;
  ASSIGN_OR_RETURN(keys[0].color, ReadColor(source, NearestColorFrame(sequence, read.before_ns)));
  ASSIGN_OR_RETURN(keys[1].color, ReadColor(source, NearestColorFrame(sequence, read.after_ns)));
  keys[0].depth_m = std::move(read.before_m);
  keys[1].depth_m = std::move(read.after_m);
  keys[1].time = 1.0F;

  const int width = sequence.camera.width, height = sequence.camera.height;
  std::vector<Rect> tiles;
  for (int y = 0; y < height; y += kTilePx)
    for (int x = 0; x < width; x += kTilePx)
      tiles.push_back({x, y, std::min(x + kTilePx, width), std::min(y + kTilePx, height)});
  for (int i = 0; i < interval.frame_count; ++i) {
    RETURN_IF_ERROR(stages.CheckStop());
    stages.Begin("read");
    DepthResult result = BlankResult(source, interval.first_frame + i);
    ASSIGN_OR_RETURN(const Image<Rgb8> color, ReadColor(source, result.color_index));
    stages.Begin("filter");
    const double tau = read.Tau(sequence.color[result.color_index].time_ns);
    const FrameFilter filter(options_, keys, color, static_cast<float>(tau));
    ParallelFor(static_cast<int>(tiles.size()), context.threads, [&](int tile) {
      if (!context.stop.stop_requested()) filter.Tile(tiles[tile], result.depth_m);
    });
    RETURN_IF_ERROR(stages.CheckStop());

    stages.Begin("finish");
    const NearerKey nearer(keys[0].depth_m, keys[1].depth_m, tau);
    for (size_t p = 0; p < result.depth_m.pixel_count(); ++p) {
      const PixelAnswer answer = nearer.Complete({result.depth_m.data()[p], Provenance::kBoth}, p);
      result.depth_m.data()[p] = answer.depth_m;
      result.provenance.data()[p] = answer.provenance;
    }
    PredictMeasurementNoise(constants, result);
    RETURN_IF_ERROR(sink(std::move(result)));
  }
  return stages.Complete(interval.frame_count);
}

}  // namespace depthtween
