// The table sceneflow of the benchmark: our scene flow beside the re-implemented baselines on pairs of frames.
#ifndef DEPTHTWEEN_TESTS_BENCH_BENCHMARK_SCENE_FLOW_H_
#define DEPTHTWEEN_TESTS_BENCH_BENCHMARK_SCENE_FLOW_H_

#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/metrics/scene_flow_errors.h"
#include "tests/bench/motion_pairs.h"

namespace depthtween {

// One clip's pairs of one kind.
struct SceneFlowBenchmark {
  PairStep step = PairStep::kKeys;
  int pairs = 0;
  std::vector<SceneFlowComparison::MethodScore> scores;  // ours first; empty where there is no true motion:
  std::vector<TransferScore> transfer;                   // then means over the pairs, by pixels
  std::vector<double> seconds;                           // of a pair, by method: mean
  Image<Rgb8> strip;  // of one pair: both colours and the true motion, then a row of motions and one of errors
};

struct SceneFlowBenchmarkOptions {
  std::vector<std::string> methods;  // of SceneFlowMethods()
  int threads = 1;                   // does not change the numbers. >= 1
  std::stop_token stop = {};
  std::function<void(int done, int total)> on_pair = nullptr;
};

// Errors: what reading and methods return; Cancelled when `stop` fires.
absl::StatusOr<SceneFlowBenchmark> BenchmarkSceneFlow(const MotionPairs& pairs,
                                                      const SceneFlowBenchmarkOptions& options);

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_BENCHMARK_SCENE_FLOW_H_
