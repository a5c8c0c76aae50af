// The bookkeeping of a benchmark. Known by definition: which tables, methods and frames each order must give.
#include "tests/bench/benchmark.h"
#include "tests/bench/parameters.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "core/baselines/baselines.h"
#include "core/io/file.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/pipeline.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

class BenchmarkTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const { return root_ / name; }

  // Small scenes: what is tested is the bookkeeping, not the numbers.
  static BenchmarkOptions Small() {
    return {.scenes = {}, .tables = {}, .frames = 17, .width = 96, .height = 80, .rounds = 1};
  }

  TemporaryFolder root_;
};

// Truth: the table of scene flow has both kinds of pairs of a scene, ours first and all baselines; without baselines
// ours alone; and the report shows it.
TEST_F(BenchmarkTest, ComparesSceneFlow) {
  BenchmarkOptions options = Small();
  options.scenes = {"turntable"};
  options.tables = {"sceneflow"};
  options.baselines = {"hold"};
  const auto benchmark = RunBenchmark(options);
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  ASSERT_EQ(benchmark->clips.size(), 1U);
  const ClipBenchmark& clip = benchmark->clips[0];
  EXPECT_FALSE(clip.depth.has_value());
  ASSERT_EQ(clip.scene_flow.size(), 2U);
  EXPECT_EQ(clip.scene_flow[0].pairs, 2);
  EXPECT_EQ(clip.scene_flow[1].pairs, 4);
  for (const SceneFlowBenchmark& motion : clip.scene_flow) {
    ASSERT_EQ(motion.scores.size(), 4U);
    EXPECT_EQ(motion.scores[0].name, "ours");
    EXPECT_EQ(motion.scores[3].name, "layered-flow");
    for (const auto& method : motion.scores) {
      EXPECT_GT(method[MotionRegion::kAll].pixels, 0);
      EXPECT_EQ(method.completeness, 1.0);
    }
    EXPECT_THAT(motion.transfer, IsEmpty());
    EXPECT_FALSE(motion.strip.empty());
  }
  ASSERT_TRUE(WriteBenchmarkReport(*benchmark, "the command", Path("report")).ok());
  EXPECT_THAT(*ReadFile(Path("report/report.md")), HasSubstr("| turntable | 2 key to key | ours |"));
  EXPECT_TRUE(FileExists(Path("report/motion-turntable-key-to-key.png")));

  options.baselines = {};
  const auto alone = RunBenchmark(options);
  ASSERT_TRUE(alone.ok()) << alone.status();
  ASSERT_EQ(alone->clips[0].scene_flow[0].scores.size(), 1U);
  // The same numbers whoever else runs: all methods answer everywhere.
  EXPECT_EQ(alone->clips[0].scene_flow[0].scores[0][MotionRegion::kAll].epe3d_m,
            clip.scene_flow[0].scores[0][MotionRegion::kAll].epe3d_m);
}

// Truth: each table has one score for each method that it is defined by, and what was not asked for is not there.
TEST_F(BenchmarkTest, RunsTheTablesAskedForAndNoOther) {
  BenchmarkOptions options = Small();
  options.scenes = {"bounce"};
  options.tables = {"depth", "ablation", "parameters"};
  options.baselines = {"hold", "flow-warp"};
  int told = 0;
  const auto benchmark = RunBenchmark(options, [&](const Benchmark& so_far) {
    EXPECT_EQ(so_far.clips.size(), 1U);
    ++told;
    return absl::OkStatus();
  });
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  EXPECT_EQ(told, 1);
  EXPECT_THAT(benchmark->times, IsEmpty());
  ASSERT_EQ(benchmark->clips.size(), 1U);
  const ClipBenchmark& clip = benchmark->clips[0];
  EXPECT_EQ(clip.name, "bounce");
  EXPECT_THAT(clip.ratios, IsEmpty());
  ASSERT_TRUE(clip.depth && clip.ablation);
  ASSERT_EQ(clip.depth->score.methods.size(), 3U);
  EXPECT_EQ(clip.depth->score.methods[0].name, "ours");
  EXPECT_GT(clip.depth->score.methods[0].uncertainty.pixels, 0);
  EXPECT_EQ(clip.depth->score.methods[1].uncertainty.pixels, 0);
  EXPECT_EQ(clip.ablation->score.methods.size(),
            2 + static_cast<size_t>(std::count_if(PartNames().begin(), PartNames().end(), [](const std::string& part) {
              return PipelineOptions{}.Uses(part);
            })));
  EXPECT_EQ(clip.ablation->score.methods.back().name, "recover + thin + propagation");
  ASSERT_EQ(clip.parameters.size(), PipelineParameters().size());
  for (size_t p = 0; p < clip.parameters.size(); ++p) {
    bool at_preset = false;
    // The preset's own value scores as the preset does.
    for (const auto& [value, score] : clip.parameters[p].scores)
      if (value == clip.parameters[p].preset_value) {
        at_preset = true;
        EXPECT_DOUBLE_EQ(score[Region::kAll].rmse_mm, clip.ablation->score.methods[0][Region::kAll].rmse_mm);
      }
    EXPECT_TRUE(at_preset) << clip.parameters[p].name;
  }

  ASSERT_TRUE(WriteBenchmarkReport(*benchmark, "the command", Path("report")).ok());
  const auto markdown = ReadFile(Path("report/report.md"));
  ASSERT_TRUE(markdown.ok());
  for (const char* there :
       {"the command", "## Depth", "ours / flow-warp", "## Ablation", "## Parameters", "errors-bounce.svg"})
    EXPECT_THAT(*markdown, HasSubstr(there));
  for (const char* absent : {"## Ratio", "## Time", "nan", "dolson"}) EXPECT_THAT(*markdown, Not(HasSubstr(absent)));
  for (const char* plot :
       {"errors-bounce.svg", "reliability.svg", "sparsification-bounce.svg", "ablation.svg", "strip-bounce.png"})
    EXPECT_TRUE(FileExists(Path("report/") + plot)) << plot;
  const auto report = ReadFile(Path("report/report.json"));
  ASSERT_TRUE(report.ok());
  EXPECT_EQ(nlohmann::json::parse(*report).at("clips").at(0).at("depth").at("methods").size(), 3U);
}

// A clip of 97 frames at 240 over 30 fps has keys 8 apart: dropping them leaves 16, 24 and 32. The 12 x 7 frames
// between keys are those that all four ratios answer.
TEST_F(BenchmarkTest, DropsKeysAndScoresTheSameFrames) {
  BenchmarkOptions options = Small();
  options.scenes = {"pan"};
  options.tables = {"ratio"};
  options.frames = 33;
  options.preset = "fast";
  options.width = 64;
  options.height = 56;
  const auto benchmark = RunBenchmark(options);
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  ASSERT_EQ(benchmark->clips.size(), 1U);
  std::vector<int> ratios;
  for (const ClipBenchmark::Ratio& ratio : benchmark->clips[0].ratios) {
    ratios.push_back(ratio.color_per_depth);
    EXPECT_EQ(ratio.scores.score.frames.size(), 84U);
    EXPECT_EQ(ratio.scores.score.methods.size(), 2U);
  }
  EXPECT_THAT(ratios, ElementsAre(8, 16, 24, 32));
}

// A folder with gt/depth keeps all maps; one without keeps as many as make the usual ratio and leave five.
TEST_F(BenchmarkTest, KnowsWhatIsTruthInAFolder) {
  const SyntheticOptions clip{
      .scene = "pan", .frames = 17, .color_fps = 30, .depth_fps = 30, .width = 64, .height = 56};
  ASSERT_TRUE(WriteSyntheticSequence(clip, Path("with"), {.truth = true}).ok());
  ASSERT_TRUE(WriteSyntheticSequence(clip, Path("without"), {.truth = false}).ok());
  BenchmarkOptions options = Small();
  options.tables = {"depth"};
  options.sequences = {Path("with"), Path("without"), Path("without") + ":8"};
  const auto benchmark = RunBenchmark(options);
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  ASSERT_EQ(benchmark->clips.size(), 3U);
  EXPECT_EQ(benchmark->clips[0].name, "with");
  EXPECT_EQ(benchmark->clips[0].kind, ClipKind::kRendered);
  EXPECT_EQ(benchmark->clips[0].key_every, 1);
  EXPECT_EQ(benchmark->clips[1].name, "without:4");
  EXPECT_EQ(benchmark->clips[1].kind, ClipKind::kReal);
  EXPECT_EQ(benchmark->clips[1].depth->score.frames.size(), 12U);  // 16 - 4 keys
  EXPECT_EQ(benchmark->clips[2].name, "without:8");
}

TEST_F(BenchmarkTest, TimesEveryPresetOnOneThreadAndTwo) {
  BenchmarkOptions options = Small();
  options.tables = {"time"};
  const auto benchmark = RunBenchmark(options);
  ASSERT_TRUE(benchmark.ok()) << benchmark.status();
  ASSERT_EQ(benchmark->times.size(), 2 * PresetNames().size());
  for (const TimeBenchmark& time : benchmark->times) {
    EXPECT_GT(time.seconds, 0) << time.preset;
    EXPECT_GT(time.ratio, 0) << time.preset;
    EXPECT_THAT(time.stage_seconds, Not(IsEmpty())) << time.preset;
  }
}

// Truth: the rules of BenchmarkOptions, each broken once; the message names the field or lists what there is.
TEST_F(BenchmarkTest, RefusesWhatItDoesNotKnow) {
  const auto message = [](const auto& change) {
    BenchmarkOptions options = Small();
    change(options);
    const absl::Status status = options.Validate();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.tables = {"width"}; }), HasSubstr("ablation"));
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.baselines = {"magic"}; }), HasSubstr("flow-warp"));
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.scenes = {"moon"}; }), HasSubstr("kick"));
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.preset = "slow"; }), HasSubstr("balanced"));
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.frames = 9; }), HasSubstr("frames = 9"));
  EXPECT_THAT(message([](BenchmarkOptions& o) { o.sequences = {"recording:x"}; }), HasSubstr("recording:8"));
}

// Truth: a stop that has fired before the start.
TEST_F(BenchmarkTest, StopsOnRequest) {
  BenchmarkOptions options = Small();
  options.scenes = {"kick"};
  options.tables = {"depth"};
  std::stop_source stop;
  options.stop = stop.get_token();
  stop.request_stop();
  EXPECT_EQ(RunBenchmark(options).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace depthtween
