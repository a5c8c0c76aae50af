#include "core/upsample/fill_limit.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

// Pixels to the nearest one that was seen, large everywhere if none was: steps of 1 and of the root of 2, which is at
// most 8 % too far. Two sweeps, from the top and from the bottom, are exact for such steps.
Image<float> DistanceToSeen(ImageView<const Provenance> provenance) {
  constexpr float kFar = 1e9F, kDiagonal = 1.41421356F;
  const int width = provenance.width(), height = provenance.height();
  Image<float> distance(width, height, kFar);
  const auto sweep = [&](int from, int end, int step) {
    for (int y = from; y != end; y += step)
      for (int i = 0; i < width; ++i) {
        const int x = step > 0 ? i : width - 1 - i;
        const auto through = [&](int dx, int dy, float length) {
          const int nx = x - step * dx, ny = y - step * dy;
          if (distance.Contains(nx, ny)) distance(x, y) = std::min(distance(x, y), distance(nx, ny) + length);
        };
        if (provenance(x, y) != Provenance::kNone && provenance(x, y) != Provenance::kInferred) distance(x, y) = 0;
        through(1, 0, 1), through(0, 1, 1), through(1, 1, kDiagonal), through(-1, 1, kDiagonal);
      }
  };
  sweep(0, height, 1);
  sweep(height - 1, -1, -1);
  return distance;
}

class FillLimited : public Upsampler {
 public:
  FillLimited(std::unique_ptr<Upsampler> upsampler, Fill fill) : upsampler_(std::move(upsampler)), fill_(fill) {}
  std::string_view name() const override { return upsampler_->name(); }
  KeyReach reach() const override { return upsampler_->reach(); }
  absl::StatusOr<IntervalSummary> Run(const FrameSource& source, const ClipConstants& constants,
                                      const Interval& interval, const RunContext& context,
                                      const FrameSink& sink) const override {
    return upsampler_->Run(source, constants, interval, context, [&](DepthResult result) {
      LimitFill(fill_, result);
      return sink(std::move(result));
    });
  }

 private:
  const std::unique_ptr<Upsampler> upsampler_;
  const Fill fill_;
};

}  // namespace

absl::StatusOr<Fill> ParseFill(std::string_view word) {
  if (word == "all") return Fill::kAll;
  if (word == "near") return Fill::kNear;
  if (word == "none") return Fill::kNone;
  return absl::InvalidArgumentError(absl::StrFormat("fill = '%s', must be all, near or none", word));
}

void LimitFill(Fill fill, DepthResult& result) {
  if (fill == Fill::kAll || result.depth_m.empty()) return;
  Image<float> distance;
  for (int y = 0; y < result.depth_m.height(); ++y)
    for (int x = 0; x < result.depth_m.width(); ++x) {
      if (result.provenance(x, y) != Provenance::kInferred) continue;
      if (fill == Fill::kNear) {
        if (distance.empty()) distance = DistanceToSeen(result.provenance);
        const bool near = distance(x, y) <= kNearShare * static_cast<float>(result.depth_m.width());
        if (near && result.sigma_m(x, y) <= kMostSigma * result.depth_m(x, y)) continue;
      }
      result.depth_m(x, y) = 0, result.sigma_m(x, y) = 0;
      result.provenance(x, y) = Provenance::kNone;
    }
}

std::unique_ptr<Upsampler> WithFillLimit(std::unique_ptr<Upsampler> upsampler, Fill fill) {
  return std::make_unique<FillLimited>(std::move(upsampler), fill);
}

}  // namespace depthtween
