#include "core/session/upsample_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "absl/strings/str_join.h"
#include "core/session/render_options.h"
#include "core/tools/upsample_flags.h"
#include "core/upsample/pipeline.h"
#include "tests/core/tools/tool_process.h"

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
  void OnFrame(int, int frame) override { frames.push_back(frame); }
  absl::Status OnIntervalDone(const IntervalReport& report) override {
    intervals.push_back(report.index);
    return absl::OkStatus();
  }
  std::vector<int> frames, intervals;
};

// The message must name the field, its value and the rule: a user mends the file by it.
TEST(UpsampleOptions, WrongOnesAreNamed) {
  const auto message = [](const char* json) { return std::string(ParseUpsampleOptions(json).status().message()); };
  EXPECT_THAT(message(R"({"method":"magic"})"), HasSubstr("options.method = 'magic', must be one of: ours, hold"));
  EXPECT_THAT(message(R"({"method":3})"), HasSubstr("options.method = 3, must be a string"));
  EXPECT_THAT(message(R"({"key_every":0})"), HasSubstr("options.key_every = 0, must be at least 1"));
  EXPECT_THAT(message(R"({"key_every":1.5})"), HasSubstr("options.key_every = 1.5, must be a whole number"));
  EXPECT_THAT(message(R"({"key_every":4294967297})"), HasSubstr("options.key_every = 4294967297"));
  EXPECT_THAT(message(R"({"threads":-1})"), HasSubstr("options.threads = -1, must be 1 to 1024"));
  EXPECT_THAT(message(R"({"clock":"sundial"})"),
              HasSubstr("options.clock 'sundial', must be stamps, index, estimate, or"));
  EXPECT_THAT(message(R"({"clock":"1,2,3"})"), HasSubstr("options.clock "));
  EXPECT_THAT(message(R"({"clock":"0,2e5"})"), HasSubstr("ClockModel.drift_ppm = 200000"));
  EXPECT_THAT(message(R"({"thread":2})"), HasSubstr("options.thread is not known"));
  EXPECT_THAT(message(R"({"preset":"turbo"})"),
              HasSubstr("options.preset = 'turbo', must be one of: " + absl::StrJoin(PresetNames(), ", ")));
  EXPECT_THAT(message(R"({"preset":1})"), HasSubstr("options.preset = 1, must be a string"));
  EXPECT_THAT(message(R"({"without":["draw","luck"]})"),
              HasSubstr("options.without has 'luck', must be some of: " + absl::StrJoin(PartNames(), ", ")));
  EXPECT_THAT(message(R"({"without":"draw"})"), HasSubstr("options.without = \"draw\", must be a list of strings"));
  EXPECT_THAT(message(R"({"preset":"reference","literal":["rigid","luck"]})"),
              HasSubstr("options.literal has 'luck', must be some of: " + absl::StrJoin(LiteralNames(), ", ")));
  EXPECT_THAT(message(R"({"preset":"best","literal":["rigid"]})"),
              HasSubstr("options.literal is for preset 'reference' alone, and the preset is 'best'"));
  EXPECT_THAT(message(R"({"literal":"rigid"})"), HasSubstr("options.literal = \"rigid\", must be a list of strings"));
  EXPECT_THAT(message("[]"), HasSubstr("options: must be a JSON object"));
  EXPECT_THAT(message("{"), HasSubstr("options: "));
}

// A server passes the field on to whoever ordered the job.
TEST(UpsampleOptions, WrongOnesNameTheirFieldToPrograms) {
  const auto field = [](const char* json) { return FieldOf(ParseUpsampleOptions(json).status()); };
  EXPECT_EQ(field(R"({"preset":"turbo"})"), "options.preset");
  EXPECT_EQ(field(R"({"without":["luck"]})"), "options.without");
  EXPECT_EQ(field(R"({"clock":"sundial"})"), "options.clock");
  EXPECT_EQ(field(R"({"thread":2})"), "options.thread");
}

// Baselines have neither presets nor stages: an option that would change nothing is a mistake.
TEST(UpsampleOptions, PresetsAndPartsAreOursAlone) {
  const auto message = [](const UpsampleOptions& options) { return std::string(options.Validate().message()); };
  EXPECT_THAT(message({.method = "hold", .preset = "fast"}),
              HasSubstr("options.preset is for method 'ours' alone, and the method is 'hold'"));
  EXPECT_THAT(message({.method = "linear", .without = {"draw"}}), HasSubstr("options.without is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .self_check = true}), HasSubstr("options.self_check is for method 'ours'"));
  EXPECT_THAT(message({.method = "linear", .causal = true}), HasSubstr("options.causal is for method 'ours'"));
  EXPECT_EQ(message({.preset = "fast", .without = {"draw"}, .causal = true, .self_check = true}), "");
}

TEST(UpsampleOptions, EveryPresetAndPartCanBeMade) {
  for (const std::string& preset : PresetNames()) {
    const auto upsampler = MakeUpsampler({.preset = preset, .without = PartNames()});
    ASSERT_TRUE(upsampler.ok()) << upsampler.status();
    EXPECT_EQ((*upsampler)->name(), "ours");
    EXPECT_THAT(PresetHelp(), HasSubstr("\n  " + preset + " ")) << "--help says what each trades";
  }
}

TEST(UpsampleOptions, SurviveJson) {
  const auto ours = ParseUpsampleOptions(
      ToJson(UpsampleOptions{.preset = "fast", .without = {"draw", "median"}, .causal = true, .self_check = true})
          .dump());
  ASSERT_TRUE(ours.ok()) << ours.status();
  EXPECT_EQ(ours->preset, "fast");
  EXPECT_THAT(ours->without, ElementsAre("draw", "median"));
  EXPECT_TRUE(ours->causal);
  EXPECT_TRUE(ours->self_check);
  const auto parsed =
      ParseUpsampleOptions(ToJson(UpsampleOptions{.method = "linear", .key_every = 8, .threads = 3}).dump());
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->method, "linear");
  EXPECT_EQ(parsed->key_every, 8);
  EXPECT_EQ(parsed->threads, 3);
  const auto defaults = ParseUpsampleOptions("{}");
  ASSERT_TRUE(defaults.ok()) << defaults.status();
  EXPECT_EQ(defaults->method, "ours");
  EXPECT_EQ(defaults->preset, "balanced");
  EXPECT_TRUE(defaults->without.empty());
}

TEST(UpsampleOptions, EveryMethodCanBeMade) {
  for (const std::string& method : UpsampleMethods()) {
    const auto upsampler = MakeUpsampler({.method = method});
    ASSERT_TRUE(upsampler.ok()) << upsampler.status();
    EXPECT_EQ((*upsampler)->name(), method);
  }
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
  EXPECT_EQ(plan->clock.model.ColorTime(4'000'000), 0);
  // The first key is now 4 ms before the first frame, the last at 28 ms: frames 8 and on are held.
  ASSERT_EQ(plan->intervals.size(), 3U);
  EXPECT_EQ(plan->intervals[0].frame_count, 3);
  const auto parsed = ParseClipPlan(ToJson(*plan, source->sequence()).dump(), source->sequence(), options);
  ASSERT_TRUE(parsed.ok()) << parsed.status();
  EXPECT_EQ(parsed->clock.model.offset_ns, plan->clock.model.offset_ns);
  EXPECT_EQ(parsed->clock.model.drift_ppm, plan->clock.model.drift_ppm);
  const ClipSource clip(*source, parsed->clock, 2);
  ASSERT_EQ(clip.sequence().depth.size(), 2U);
  // Less than a hundredth of a frame before a colour frame: taken with it.
  EXPECT_EQ(plan->clock.model.ColorTime(32'000'000), 27'972'028);
  EXPECT_EQ(clip.sequence().depth[1].time_ns, 28'000'000);
  EXPECT_EQ((*clip.Depth(1))(0, 0), 1.8F);
  // Stamps so far off that nothing overlaps are refused by the option's name.
  EXPECT_THAT(std::string(PrepareClip(*source, {.clock = "5000"}).status().message()),
              HasSubstr("options.clock = 5000"));
  const auto by_index = PrepareClip(*source, {.clock = "index"});
  ASSERT_TRUE(by_index.ok()) << by_index.status();
  EXPECT_EQ(by_index->clock.color_per_depth, 4);
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
  const ScratchFolder out;
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

TEST(RunIntervals, NamesIntervalsThatAreNotThere) {
  const auto source = TinySource();
  const ScratchFolder out;
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
  const ScratchFolder out;
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
