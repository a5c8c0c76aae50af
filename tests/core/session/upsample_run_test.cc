// Upsampling a clip in steps: what passes between them, and in which order things are told.
#include "core/session/upsample_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <atomic>

#include "core/api/make_upsampler.h"
#include "core/options/job_options.h"
#include "core/options/scene_flow_options.h"
#include "core/sequence/retold_source.h"
#include "core/session/scene_flow_files.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Three depth frames at colour frames 0, 4 and 8, then two colour frames that are held.
std::unique_ptr<MemorySource> TinySource() {
  Sequence sequence{.camera = {.width = 8, .height = 6, .fx = 8, .fy = 8, .cx = 4, .cy = 3}, .depth_scale = 1000};
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (int i = 0; i < 11; ++i) {
    sequence.color.push_back({.time_ns = i * 4'000'000, .path = "rgb/" + std::to_string(i) + ".png"});
    color.emplace_back(8, 6, Rgb8{static_cast<uint8_t>(20 * i), 100, 0});
    if (i % 4 != 0) continue;
    sequence.depth.push_back({.time_ns = i * 4'000'000, .path = "depth/" + std::to_string(i) + ".png"});
    depth_m.emplace_back(8, 6, 1.0F + 0.1F * static_cast<float>(i));
  }
  return std::make_unique<MemorySource>(std::move(sequence), std::move(color), std::move(depth_m));
}

class Recorder : public RunObserver {
 public:
  void OnStage(int, std::string_view) override {}
  void OnItem() override { ++items; }
  void OnFrame(int, int frame) override { frames.push_back(frame); }
  absl::Status OnIntervalDone(const IntervalReport& report) override {
    intervals.push_back(report.index);
    return absl::OkStatus();
  }
  std::vector<int> frames, intervals;
  std::atomic<int> items{0};
};

// Every word of the list must be known to what computes: a new one that is not would fail for its first user.
TEST(UpsampleOptions, EveryPresetAndPartCanBeMade) {
  for (const std::string& preset : PresetNames()) {
    const auto upsampler = MakeUpsampler({.preset = preset, .without = PartNames()});
    ASSERT_TRUE(upsampler.ok()) << upsampler.status();
    EXPECT_EQ((*upsampler)->name(), "ours");
  }
  const auto literal = MakeUpsampler({.preset = "reference", .literal = LiteralNames()});
  EXPECT_TRUE(literal.ok()) << literal.status();
}

TEST(UpsampleOptions, EveryMethodCanBeMade) {
  for (const std::string& method : UpsampleMethods()) {
    const auto upsampler = MakeUpsampler({.method = method});
    ASSERT_TRUE(upsampler.ok()) << upsampler.status();
    EXPECT_EQ((*upsampler)->name(), method);
  }
}

// A server lists and streams the files of a scene flow by what core/options says of their folders.
TEST(SceneFlowFiles, LieWhereTheOptionsSay) {
  const TemporaryFolder out;
  ASSERT_EQ(MakeSceneFlowFolders(out.path(), SceneFlowFormats()), absl::OkStatus());
  const std::string document = ToJson(SceneFlowOrder{.formats = SceneFlowFormats()}).dump();
  const auto facts = FactsOfJob(JobKind::kSceneFlow, document);
  ASSERT_TRUE(facts.ok()) << facts.status();
  const SceneFlow flow{.flow_px = Image<Flow2>(8, 6),
                       .motion_m = Image<Float3>(8, 6),
                       .depth_m = Image<float>(8, 6, 1.0F),
                       .confidence = Image<float>(8, 6, 1.0F),
                       .hidden = Image<uint8_t>(8, 6)};
  ASSERT_EQ(WriteSceneFlow(out.path(), "stem", SceneFlowFormats(), TinySource()->sequence().camera, 0.1, flow),
            absl::OkStatus());
  std::vector<std::string> said, made;
  for (const FrameFiles& files : facts->outputs) said.push_back(files.folder + "/stem." + files.extension);
  for (const auto& [name, bytes] : FilesBelow(out.path())) made.push_back(name);
  EXPECT_THAT(made, testing::UnorderedElementsAreArray(said));
}

// Constants that were stored must be the very doubles that were computed, or two processes would not give one result.
TEST(ClipPlan, SurvivesJsonToTheLastBit) {
  const auto source = TinySource();
  ClipPlan plan{
      .constants = {.noise_a_m = 1.0 / 3, .noise_b_per_m = 1e-300, .median_depth_m = 0.1, .warnings = {"a \"b\""}},
      .intervals = PlanIntervals(source->sequence())};
  const auto parsed = ParseClipPlan(ToJson(plan, source->sequence()).dump(2), source->sequence(), {});
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->constants.noise_a_m, plan.constants.noise_a_m);
  EXPECT_EQ(parsed->constants.noise_b_per_m, plan.constants.noise_b_per_m);
  EXPECT_EQ(parsed->constants.median_depth_m, plan.constants.median_depth_m);
  EXPECT_EQ(parsed->constants.warnings, plan.constants.warnings);
  EXPECT_EQ(parsed->intervals.size(), 3U);
}

// The clock that `prepare` decided on goes with the plan: every task must see the same stamps.
TEST(ClipPlan, CarriesItsClock) {
  const auto source = TinySource();
  const UpsampleOptions options{.clock = "4,1000"};
  const auto plan = PrepareClip(*source, options);
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_EQ(plan->alignment.clock.model.ColorTime(4'000'000), 0);
  // The first key is now 4 ms before the first frame, the last at 28 ms: frames 8 and on are held.
  ASSERT_EQ(plan->intervals.size(), 3U);
  EXPECT_EQ(plan->intervals[0].frame_count, 3);
  const auto parsed = ParseClipPlan(ToJson(*plan, source->sequence()).dump(), source->sequence(), options);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->alignment.clock.model.offset_ns, plan->alignment.clock.model.offset_ns);
  EXPECT_EQ(parsed->alignment.clock.model.drift_ppm, plan->alignment.clock.model.drift_ppm);
  const ClipSource clip(*source, parsed->alignment, 2);
  ASSERT_EQ(clip.sequence().depth.size(), 2U);
  // Less than a hundredth of a frame before a colour frame: taken with it.
  EXPECT_EQ(plan->alignment.clock.model.ColorTime(32'000'000), 27'972'028);
  EXPECT_EQ(clip.sequence().depth[1].time_ns, 28'000'000);
  EXPECT_EQ((*clip.Depth(1))(0, 0), 1.8F);
  // Stamps so far off that nothing overlaps are refused by the option's name.
  EXPECT_THAT(std::string(PrepareClip(*source, {.clock = "5000"}).status().message()),
              HasSubstr("options.clock = 5000"));
  const auto by_index = PrepareClip(*source, {.clock = "index"});
  ASSERT_TRUE(by_index.ok()) << by_index.status();
  EXPECT_EQ(by_index->alignment.clock.color_per_depth, 4);
}

// The same recording with depth ten minutes late: every way to give the clock works, and without one it is named.
TEST(PrepareClip, AppliesTheClockBeforeItAsksForOverlap) {
  const auto source = TinySource();
  Sequence late = source->sequence();
  for (FrameRef& frame : late.depth) frame.time_ns += 600'000'000'000;
  const RetoldSource recording(*source, std::move(late));
  EXPECT_THAT(std::string(PrepareClip(recording, {}).status().message()), HasSubstr("--clock=600000.000"));
  for (const char* clock : {"600000", "index", "estimate"}) {
    const auto plan = PrepareClip(recording, {.clock = clock});
    ASSERT_TRUE(plan.ok()) << plan.status();
    EXPECT_EQ(plan->intervals.size(), 3U) << clock;
  }
  EXPECT_THAT(PrepareClip(recording, {.clock = "estimate"})->constants.warnings,
              ElementsAre(testing::AllOf(HasSubstr("600000.000 ms"), HasSubstr("is a guess"))));
}

// Two frames held at the end are usual; eight of eleven are not, whichever end they are at.
TEST(PrepareClip, SaysHowManyFramesAreHeld) {
  const auto source = TinySource();
  EXPECT_THAT(PrepareClip(*source, {})->constants.warnings, testing::IsEmpty());
  EXPECT_THAT(PrepareClip(*source, {.clock = "-32"})->constants.warnings,
              ElementsAre(testing::AllOf(HasSubstr("8 of 11 frames are held"), HasSubstr("8 before the first"),
                                         HasSubstr("--clock"))));
  EXPECT_THAT(PrepareClip(*source, {.clock = "24"})->constants.warnings,
              ElementsAre(HasSubstr("0 before the first depth frame and 8 after the last")));
}

// What a source says of its reading stands first; a scale that cannot be right has its alternatives.
TEST(PrepareClip, PassesOnWhatWasAssumed) {
  class Talkative : public MemorySource {
   public:
    using MemorySource::MemorySource;
    std::vector<std::string> Warnings(int) const override { return {"assumed"}; }
  };
  Sequence sequence = TinySource()->sequence();
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (size_t i = 0; i < sequence.color.size(); ++i) color.emplace_back(8, 6);
  for (size_t i = 0; i < sequence.depth.size(); ++i) depth_m.emplace_back(8, 6, 31.0F);
  const auto plan = PrepareClip(Talkative(std::move(sequence), std::move(color), std::move(depth_m)), {});
  ASSERT_TRUE(plan.ok()) << plan.status();
  EXPECT_THAT(plan->constants.warnings, ElementsAre("assumed", testing::AllOf(HasSubstr("camera.depth_scale = 1000"),
                                                                              HasSubstr("5000 (median 6.2 m)"),
                                                                              HasSubstr("10000 (median 3.1 m)"))));
}

TEST(ClipPlan, BelongsToOneSequence) {
  const auto source = TinySource();
  const auto plan = PrepareClip(*source, {});
  ASSERT_TRUE(plan.ok()) << plan.status();
  const std::string json = ToJson(*plan, source->sequence()).dump();
  EXPECT_EQ(ParseClipPlan(json, source->sequence(), {.key_every = 2}).status().code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(ParseClipPlan("{}", source->sequence(), {}).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST(RunIntervals, TellsOfEveryFrameInOrder) {
  const auto source = TinySource();
  const TemporaryFolder out;
  const auto plan = PrepareClip(*source, {});
  const auto writer = ResultWriter::Create(out.path(), source->sequence());
  const auto upsampler = MakeUpsampler({.method = "linear"});
  ASSERT_TRUE(plan.ok() && writer.ok() && upsampler.ok());
  Recorder recorder;
  const auto reports = RunIntervals(**upsampler, *source, *plan, 0, 3, {.threads = 3}, {}, *writer, recorder);
  ASSERT_TRUE(reports.ok()) << reports.status();
  EXPECT_THAT(recorder.frames, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10));
  EXPECT_THAT(recorder.intervals, ElementsAre(0, 1, 2));

  ASSERT_EQ(AssembleResult({.method = "linear"}, "/recording", source->sequence(), *plan, *reports,
                           nlohmann::json::array(), {}, *writer),
            absl::OkStatus());
  const auto result = ResultFolder::Open(out.path());
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->report().at("frames"), 11);
  EXPECT_EQ(result->report().at("held_frames"), 2);
  EXPECT_EQ(result->report().at("sequence"), "/recording");
  // Linear in time between 1.4 m at frame 4 and 1.8 m at frame 8.
  EXPECT_NEAR(result->Depth(6).value()(3, 3), 1.6F, 0.0006F);
}

// The pipeline's stages go over the 7 frames of the window between two keys one by one.
TEST(RunIntervals, TellsOfWorkWithinAStage) {
  const auto source = TinySource();
  const TemporaryFolder out;
  const auto plan = PrepareClip(*source, {});
  const auto writer = ResultWriter::Create(out.path(), source->sequence());
  const auto upsampler = MakeUpsampler({.preset = "fast"});
  ASSERT_TRUE(plan.ok() && writer.ok() && upsampler.ok());
  Recorder recorder;
  const auto reports = RunIntervals(**upsampler, *source, *plan, 0, 1, {.preset = "fast"}, {}, *writer, recorder);
  ASSERT_TRUE(reports.ok()) << reports.status();
  EXPECT_GE(recorder.items, reports->front().summary.frames);
}

TEST(RunIntervals, NamesIntervalsThatAreNotThere) {
  const auto source = TinySource();
  const TemporaryFolder out;
  const auto plan = PrepareClip(*source, {});
  const auto writer = ResultWriter::Create(out.path(), source->sequence());
  const auto upsampler = MakeUpsampler({.method = "hold"});
  ASSERT_TRUE(plan.ok() && writer.ok() && upsampler.ok());
  Recorder recorder;
  EXPECT_THAT(RunIntervals(**upsampler, *source, *plan, 2, 2, {}, {}, *writer, recorder).status().message(),
              HasSubstr("this clip has intervals 0 to 2"));
  const auto first = RunIntervals(**upsampler, *source, *plan, 0, 1, {}, {}, *writer, recorder);
  ASSERT_TRUE(first.ok()) << first.status();
  EXPECT_THAT(AssembleResult({}, "", source->sequence(), *plan, *first, nlohmann::json::array(), {}, *writer).message(),
              HasSubstr("interval 1 has not been computed"));
}

TEST(RunIntervals, StopsWhenAsked) {
  const auto source = TinySource();
  const TemporaryFolder out;
  const auto plan = PrepareClip(*source, {});
  const auto writer = ResultWriter::Create(out.path(), source->sequence());
  const auto upsampler = MakeUpsampler({.method = "hold"});
  ASSERT_TRUE(plan.ok() && writer.ok() && upsampler.ok());
  std::stop_source stop;
  stop.request_stop();
  Recorder recorder;
  EXPECT_TRUE(absl::IsCancelled(
      RunIntervals(**upsampler, *source, *plan, 0, 3, {}, stop.get_token(), *writer, recorder).status()));
  EXPECT_TRUE(recorder.intervals.empty());
}

}  // namespace
}  // namespace depthtween
