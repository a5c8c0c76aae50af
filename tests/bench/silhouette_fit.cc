// Fits the weights of core/upsample/silhouettes.cc, and says what they are worth.
//
// Every scene of the library (33 colour frames, 512 x 424, Kinect-like noise, the seed given) goes through the
// pipeline; for each pixel beside a silhouette the evidence and the truth (which of its two depths is nearer to the
// exact one) are collected. Logistic regression by Newton's method; a pixel counts by the squared error (m^2) that a
// wrong decision costs, scaled to a mean of 1 in each scene. One pass after the other: each is fitted on what the
// passes before it, as fitted, leave. Prints the weights in the order of SilhouetteEvidence, and for each scene the
// squared error beside silhouettes after the decision as a share of that before it.
//
// Usage: silhouette_fit [seed, default 1]
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string>
#include <vector>

#include "Eigen/Cholesky"
#include "Eigen/Core"
#include "core/base/parallel.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/pipeline.h"
#include "core/upsample/silhouettes.h"

namespace depthtween {
namespace {

using Weights = Eigen::Matrix<double, kEvidenceCount, 1>;

struct Sample {
  SilhouettePixel pixel;
  float near_error2 = 0, far_error2 = 0;  // m^2, of either answer
};

// What the pass after `passes` looks at.
absl::StatusOr<std::vector<Sample>> Collect(const std::string& scene, uint64_t seed,
                                            const std::vector<SilhouetteWeights>& passes) {
  ASSIGN_OR_RETURN(const auto clip, SyntheticSequence::Create({.scene = scene, .seed = seed}, AvailableThreads()));
  std::vector<Sample> samples;
  std::mutex mutex;
  const int collected = static_cast<int>(passes.size());
  const SilhouetteDecision decide = [&](int color_index, int pass, const std::vector<SilhouettePixel>& pixels,
                                        ImageView<float> depth_m) {
    if (pass < collected) return SettleSilhouettes(pixels, passes[pass], depth_m);
    const Image<float> truth = clip->ColorView(color_index).Surface(1).depth_m.Clone();
    const std::lock_guard lock(mutex);
    for (const SilhouettePixel& pixel : pixels) {
      const float z = truth(pixel.x, pixel.y);
      if (z > 0)
        samples.push_back({pixel, (pixel.near_m - z) * (pixel.near_m - z), (pixel.far_m - z) * (pixel.far_m - z)});
    }
    return SettleSilhouettes(pixels, {}, depth_m);
  };
  const auto pipeline = MakePipeline({.silhouette_passes = collected + 1}, decide);
  ASSIGN_OR_RETURN(const ClipConstants constants, EstimateClipConstants(*clip));
  const RunContext context{.threads = AvailableThreads()};
  for (const Interval& interval : PlanIntervals(clip->sequence()))
    RETURN_IF_ERROR(
        pipeline->Run(*clip, constants, interval, context, [](DepthResult) { return absl::OkStatus(); }).status());
  return samples;
}

double Score(const Weights& weights, const SilhouettePixel& pixel) {
  double sum = 0;
  for (int i = 0; i < kEvidenceCount; ++i) sum += weights[i] * pixel.evidence[i];
  return sum;
}

Weights Fit(const std::vector<std::vector<Sample>>& scenes) {
  Weights weights = Weights::Zero();
  for (int iteration = 0; iteration < 25; ++iteration) {
    Weights gradient = -1e-3 * weights;
    Eigen::MatrixXd hessian = 1e-3 * Eigen::MatrixXd::Identity(kEvidenceCount, kEvidenceCount);
    for (const std::vector<Sample>& samples : scenes) {
      double cost = 0;
      for (const Sample& s : samples) cost += std::abs(s.near_error2 - s.far_error2);
      const double scale = static_cast<double>(samples.size()) / cost;
      for (const Sample& s : samples) {
        const Weights x =
            Eigen::Map<const Eigen::Matrix<float, kEvidenceCount, 1>>(s.pixel.evidence.data()).cast<double>();
        const double p = 1 / (1 + std::exp(-Score(weights, s.pixel)));
        const double count = scale * std::abs(s.near_error2 - s.far_error2);
        gradient += count * ((s.near_error2 < s.far_error2 ? 1.0 : 0.0) - p) * x;
        hessian += count * p * (1 - p) * x * x.transpose();
      }
    }
    weights += hessian.ldlt().solve(gradient);
  }
  return weights;
}

double ShareLeft(const Weights& weights, const std::vector<Sample>& samples) {
  double before = 0, after = 0;
  for (const Sample& s : samples) {
    before += s.pixel.is_near ? s.near_error2 : s.far_error2;
    after += Score(weights, s.pixel) > 0 ? s.near_error2 : s.far_error2;
  }
  return after / before;
}

absl::StatusOr<SilhouetteWeights> FitPass(uint64_t seed, const std::vector<SilhouetteWeights>& passes) {
  std::vector<std::vector<Sample>> scenes;
  std::vector<std::string> names;
  for (const SceneInfo& info : SceneList()) {
    if (info.name == "still") continue;  // no motion to learn from
    names.emplace_back(info.name);
    ASSIGN_OR_RETURN(scenes.emplace_back(), Collect(names.back(), seed, passes));
    std::fprintf(stderr, "%s: %zu pixels\n", names.back().c_str(), scenes.back().size());
  }
  const Weights fitted = Fit(scenes);
  SilhouetteWeights weights;
  std::printf("weights of pass %zu: {", passes.size() + 1);
  for (int i = 0; i < kEvidenceCount; ++i) {
    weights[i] = static_cast<float>(fitted[i]);
    std::printf("%s%.2fF", i == 0 ? "" : ", ", weights[i]);
  }
  std::printf("}\n\n| scene | pixels | squared error left |\n|---|---:|---:|\n");
  for (size_t i = 0; i < scenes.size(); ++i)
    std::printf("| %s | %zu | %.3f |\n", names[i].c_str(), scenes[i].size(), ShareLeft(fitted, scenes[i]));
  std::printf("\n");
  return weights;
}

absl::Status Run(uint64_t seed) {
  std::vector<SilhouetteWeights> passes;
  while (passes.size() < kSilhouetteWeights.size()) {
    ASSIGN_OR_RETURN(passes.emplace_back(), FitPass(seed, passes));
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  const absl::Status status = depthtween::Run(argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 1);
  if (!status.ok()) std::fprintf(stderr, "silhouette_fit: %s\n", std::string(status.message()).c_str());
  return status.ok() ? 0 : 1;
}
