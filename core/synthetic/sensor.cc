#include "core/synthetic/sensor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/synthetic/random.h"

namespace depthtween {
namespace {

// Which random number of a pixel.
enum Stream : uint64_t { kAxial = 1, kMixes, kPartner, kWeight, kMissingPatch, kPatchSize, kMissing, kEcho, kColor };

double FadedEcho(float infrared, float depth) {
  const double fade = 2.0 / std::max(depth, 1.0F);
  return infrared * fade * fade;
}

}  // namespace

SensorModel PerfectSensor() { return {}; }

SensorModel Kinect2Sensor() {
  return {.noise_a_m = 0.0015,
          .noise_b_per_m = 0.0004,
          .flying_share = 0.35,
          .edge_dropout_share = 0.10,
          .random_dropout_share = 0.005,
          .least_echo = 0.006,
          .quantum_m = 0.001,
          .color_noise_levels = 0.8,
          .color_shot_noise = 0.12};
}

absl::StatusOr<SensorModel> SensorByName(std::string_view name) {
  if (name == "none") return PerfectSensor();
  if (name == "kinect2") return Kinect2Sensor();
  return absl::InvalidArgumentError(
      absl::StrFormat("noise = '%s', must be kinect2 or none", absl::string_view(name.data(), name.size())));
}

absl::Status SensorModel::Validate() const {
  const std::pair<const char*, double> shares[] = {{"flying_share", flying_share},
                                                   {"edge_dropout_share", edge_dropout_share},
                                                   {"random_dropout_share", random_dropout_share}};
  for (const auto& [field, value] : shares)
    if (!(value >= 0 && value <= 1))
      return absl::InvalidArgumentError(absl::StrFormat("SensorModel.%s = %g, must be between 0 and 1", field, value));
  const std::pair<const char*, double> amounts[] = {
      {"noise_a_m", noise_a_m}, {"noise_b_per_m", noise_b_per_m},           {"least_echo", least_echo},
      {"quantum_m", quantum_m}, {"color_noise_levels", color_noise_levels}, {"color_shot_noise", color_shot_noise}};
  for (const auto& [field, value] : amounts)
    if (!(value >= 0 && std::isfinite(value)))
      return absl::InvalidArgumentError(
          absl::StrFormat("SensorModel.%s = %g, must be finite and at least 0", field, value));
  return absl::OkStatus();
}

Image<float> MeasureDepth(const SensorModel& model, const SurfaceTruth& truth, uint64_t seed, int frame) {
  const Image<float>& exact = truth.depth_m;
  const int width = exact.width(), height = exact.height();
  Image<float> measured(width, height);
  Image<uint8_t> missing(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double z = exact(x, y);
      if (z <= 0) continue;
      const auto uniform = [&](Stream stream) { return UniformFrom(RandomBits(seed, frame, y, x, stream)); };

      std::array<float, 8> across;  // neighbours on the other side of an edge
      int across_count = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          if (!exact.Contains(x + dx, y + dy)) continue;
          const float neighbour = exact(x + dx, y + dy);
          if (neighbour > 0 && std::abs(neighbour - exact(x, y)) > kDepthEdgeM) across[across_count++] = neighbour;
        }
      if (across_count > 0) {
        if (uniform(kMixes) < model.flying_share) {
          const double partner = across[static_cast<int>(uniform(kPartner) * across_count)];
          const double weight = uniform(kWeight);
          z = weight * z + (1 - weight) * partner;
        }
        if (uniform(kMissingPatch) < model.edge_dropout_share) {
          const int size = uniform(kPatchSize) < 0.5 ? 1 : 2;
          for (int dy = 0; dy < size; ++dy)
            for (int dx = 0; dx < size; ++dx)
              if (missing.Contains(x + dx, y + dy)) missing(x + dx, y + dy) = 1;
        }
      }
      if (uniform(kMissing) < model.random_dropout_share) missing(x, y) = 1;
      if (model.least_echo > 0) {
        const double echo = FadedEcho(truth.infrared(x, y), exact(x, y)) / model.least_echo;
        if (echo < 1 + uniform(kEcho)) missing(x, y) = 1;
      }

      const double sigma = model.noise_a_m + model.noise_b_per_m * z * z;
      if (sigma > 0) z += sigma * NormalFrom(RandomBits(seed, frame, y, x, kAxial));
      if (model.quantum_m > 0) z = model.quantum_m * std::round(z / model.quantum_m);
      measured(x, y) = static_cast<float>(std::max(z, 0.0));
    }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if (missing(x, y)) measured(x, y) = 0.0F;
  return measured;
}

Image<Rgb8> MeasureColor(const SensorModel& model, ImageView<const Rgb8> perfect, uint64_t seed, int frame) {
  Image<Rgb8> recorded(perfect.width(), perfect.height());
  for (int y = 0; y < perfect.height(); ++y)
    for (int x = 0; x < perfect.width(); ++x) {
      const auto noisy = [&](uint8_t level, int channel) {
        const double sigma = model.color_noise_levels + model.color_shot_noise * std::sqrt(level);
        if (sigma <= 0) return level;
        const double noise = sigma * NormalFrom(RandomBits(seed, frame, y, x, kColor, channel));
        return static_cast<uint8_t>(std::clamp(std::lround(level + noise), 0L, 255L));
      };
      const Rgb8& pixel = perfect(x, y);
      recorded(x, y) = {noisy(pixel.r, 0), noisy(pixel.g, 1), noisy(pixel.b, 2)};
    }
  return recorded;
}

}  // namespace depthtween
