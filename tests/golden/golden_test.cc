// What the current version scores on the library's scenes: a change that moves accuracy shows here, whether meant or
// not.
//
// Truth: tests/golden/scenes.json, which tests/golden/update.sh made. After a change that is meant to move numbers, run
// that script and let the change of the file say by how much.
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "core/base/parallel.h"
#include "core/io/file.h"
#include "gtest/gtest.h"
#include "tests/bench/benchmark.h"

namespace depthtween::tools {
namespace {

using nlohmann::json;

// Other processors and compilers round differently, and where two proposals match equally well a rounding decides:
// single pixels at edges flip. -O3 instead of -O2 moves numbers of the whole frame by up to 1 %, and those of its
// smallest part, disoccluded, by 2.5 %. 5 % is less than what most parts are worth.
constexpr double kTolerance = 0.05;
// Of numbers near 0, in their own unit (mm or share).
constexpr double kLeastTolerance = 0.02;

TEST(Golden, ScenesScoreAsBefore) {
  const auto text = ReadFile(GOLDEN_FILE);
  ASSERT_TRUE(text.ok()) << text.status();
  const json golden = json::parse(*text);
  BenchmarkOptions options{.scenes = {},
                           .tables = {"depth"},
                           .baselines = {"flow-warp"},
                           .frames = golden.at("frames").get<int>(),
                           .width = golden.at("width").get<int>(),
                           .height = golden.at("height").get<int>(),
                           .threads = AvailableThreads()};
  for (const auto& [scene, numbers] : golden.at("scenes").items()) options.scenes.push_back(scene);
  const auto benchmark = RunBenchmark(options);
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  const json report = ToJson(*benchmark);
  ASSERT_EQ(report.at("clips").size(), options.scenes.size());
  for (const json& clip : report.at("clips")) {
    const std::string scene = clip.at("name").get<std::string>();
    // Each number stands under its path in the report of that clip.
    for (const auto& [path, number] : golden.at("scenes").at(scene).items()) {
      const double before = number.get<double>(), now = clip.at(json::json_pointer(path)).get<double>();
      EXPECT_LE(std::abs(now - before), std::max(kLeastTolerance, kTolerance * std::abs(before)))
          << scene << " " << path << " was " << before << ", is " << now
          << "; if that is meant, run tests/golden/update.sh";
    }
  }
}

}  // namespace
}  // namespace depthtween::tools
