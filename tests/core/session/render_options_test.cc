// Options of renders: every field that can be wrong, and what follows from the right ones. Expected values are worked
// out by hand from the header.
#include "core/session/render_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/options/render_option_list.h"

namespace depthtween {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

Sequence Clip(int width = 64, int height = 48) {
  Sequence sequence = {.camera = {.width = width, .height = height, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5},
                       .depth_scale = 1000};
  for (int i = 0; i < 10; ++i) sequence.color.push_back({i * 4'000'000, "rgb/" + std::to_string(i) + ".png"});
  sequence.depth = {{0, "depth/0.png"}};
  return sequence;
}

// The field that an error is about, wherever it is found: when parsing, or when planning for a clip.
std::string WrongField(const std::string& text, const Sequence& sequence = Clip()) {
  const auto options = ParseRender(json::parse(text), "renders[3]");
  const absl::Status status =
      options.ok() ? PlanRender(*options, sequence, "renders[3]").status() : absl::Status(options.status());
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << text;
  EXPECT_THAT(std::string(status.message()), StartsWith(FieldOf(status) + " ")) << text;
  return FieldOf(status);
}

TEST(RenderOptions, EveryWrongValueNamesItsField) {
  const auto dof = [](const std::string& fields) { return "{\"depth_of_field\":{" + fields + "}}"; };
  EXPECT_EQ(WrongField(dof(R"("fstop":-1)")), "renders[3].depth_of_field.fstop");
  EXPECT_EQ(WrongField(dof(R"("fstop":"wide")")), "renders[3].depth_of_field.fstop");
  EXPECT_EQ(WrongField(dof(R"("focal_mm":-50)")), "renders[3].depth_of_field.focal_mm");
  EXPECT_EQ(WrongField(dof(R"("aperture_mm":-2)")), "renders[3].depth_of_field.aperture_mm");
  EXPECT_EQ(WrongField(dof(R"("sensor":"huge")")), "renders[3].depth_of_field.sensor");
  EXPECT_EQ(WrongField(dof(R"("method":"magic")")), "renders[3].depth_of_field.method");
  EXPECT_EQ(WrongField(dof(R"("layers":1)")), "renders[3].depth_of_field.layers");
  EXPECT_EQ(WrongField(dof(R"("layers":1.5)")), "renders[3].depth_of_field.layers");
  EXPECT_EQ(WrongField(dof(R"("blades":2)")), "renders[3].depth_of_field.blades");
  EXPECT_EQ(WrongField(dof(R"("max_radius_px":1000)")), "renders[3].depth_of_field.max_radius_px");
  EXPECT_EQ(WrongField(dof(R"("bokeh":1)")), "renders[3].depth_of_field.bokeh");
  EXPECT_EQ(WrongField(dof(R"("focus":{"depth_m":-1})")), "renders[3].depth_of_field.focus.depth_m");
  EXPECT_EQ(WrongField(dof(R"("focus":{"depth_m":1,"pixel":{}})")), "renders[3].depth_of_field.focus");
  EXPECT_EQ(WrongField(dof(R"("focus":{"pixel":{"frame":10}})")), "renders[3].depth_of_field.focus.pixel.frame");
  EXPECT_EQ(WrongField(dof(R"("focus":{"pixel":{"x":64}})")), "renders[3].depth_of_field.focus.pixel.x");
  EXPECT_EQ(WrongField(dof(R"("focus":{"track":{"y":-1}})")), "renders[3].depth_of_field.focus.track.y");
  EXPECT_EQ(WrongField(dof(R"("focus":{"keys":{}})")), "renders[3].depth_of_field.focus.keys.keys");
  EXPECT_EQ(WrongField(dof(R"("focus":{"keys":{"keys":[{"frame":3,"depth_m":1},{"frame":3,"depth_m":2}]}})")),
            "renders[3].depth_of_field.focus.keys.keys[1].frame");
  EXPECT_EQ(WrongField(dof(R"("focus":{"keys":{"keys":[{"frame":3,"depth_m":0}]}})")),
            "renders[3].depth_of_field.focus.keys.keys[0].depth_m");
  EXPECT_EQ(WrongField(dof(R"("focus":{"keys":{"easing":"wild"}})")), "renders[3].depth_of_field.focus.keys.easing");

  const auto stereo = [](const std::string& fields) { return "{\"stereo\":{" + fields + "}}"; };
  EXPECT_EQ(WrongField(stereo(R"("baseline_m":-1)")), "renders[3].stereo.baseline_m");
  EXPECT_EQ(WrongField(stereo(R"("divergence_percent":50)")), "renders[3].stereo.divergence_percent");
  EXPECT_EQ(WrongField(stereo(R"("convergence_m":0)")), "renders[3].stereo.convergence_m");
  EXPECT_EQ(WrongField(stereo(R"("made":"third")")), "renders[3].stereo.made");
  EXPECT_EQ(WrongField(stereo(R"("format":"imax")")), "renders[3].stereo.format");
  EXPECT_EQ(WrongField(stereo(R"("metadata":1)")), "renders[3].stereo.metadata");
  EXPECT_EQ(WrongField(stereo(R"("screen_width_m":0)")), "renders[3].stereo.screen_width_m");

  EXPECT_EQ(WrongField(R"({"name":"../x","stereo":{}})"), "renders[3].name");
  EXPECT_EQ(WrongField(R"({"name":"depth","stereo":{}})"), "renders[3].name");
  EXPECT_EQ(WrongField(R"({"frame_format":"gif","stereo":{}})"), "renders[3].frame_format");
  EXPECT_EQ(WrongField(R"({"container":"avi","stereo":{}})"), "renders[3].container");
  EXPECT_EQ(WrongField(R"({"container":"mp4","depth_of_field":{}})", Clip(63, 48)), "renders[3].container");
  EXPECT_EQ(WrongField("{}"), "renders[3]");
  EXPECT_EQ(WrongField(R"({"stereo":{},"depth_of_field":{}})"), "renders[3]");
}

// Flags and help offer what the list says (core/options): the document must take each option, with each of its words.
TEST(RenderOptions, TakeWhatTheListOffers) {
  const auto expect_taken = [](const json& render) {
    const auto options = ParseRender(render, "render");
    EXPECT_TRUE(options.ok()) << options.status();
  };
  const auto expect_all_taken = [&](const std::string& product, const std::vector<OptionSpec>& specs) {
    for (const OptionSpec& spec : specs) {
      for (const std::string& word : spec.words) expect_taken({{product, {{spec.name, word}}}});
      if (spec.words.empty()) expect_taken({{product, {{spec.name, 4}}}});  // within every range
    }
  };
  expect_all_taken("depth_of_field", DepthOfFieldOptionSpecs());
  expect_all_taken("stereo", StereoOptionSpecs());
  for (const std::string& word : FrameFormatWords()) expect_taken({{"stereo", json::object()}, {"frame_format", word}});
  for (const std::string& word : FocusEasingWords())
    expect_taken({{"depth_of_field", {{"focus", {{"keys", {{"easing", word}}}}}}}});
}

TEST(RenderOptions, DefaultsAreThoseOfTheRenderers) {
  const auto options = ParseRender(json::parse(R"({"depth_of_field":{}})"), "render");
  ASSERT_TRUE(options.ok()) << options.status();
  EXPECT_EQ(options->name, "dof");
  const auto& dof = std::get<DepthOfFieldRender>(options->product);
  EXPECT_EQ(dof.lens.fstop, LensOptions().fstop);
  EXPECT_EQ(dof.blur.layers, DepthOfFieldOptions().layers);
  EXPECT_TRUE(std::holds_alternative<FocusMedian>(dof.focus));
  EXPECT_FALSE(options->container.has_value());
}

TEST(RenderOptions, NamesDiffer) {
  const auto names = [](const std::string& list) {
    const auto renders = ParseRenders(json::parse(list));
    EXPECT_TRUE(renders.ok()) << renders.status();
    std::vector<std::string> result;
    for (const RenderOptions& render : *renders) result.push_back(render.name);
    return result;
  };
  EXPECT_THAT(names("[]"), IsEmpty());
  EXPECT_THAT(names(R"([{"stereo":{}},{"depth_of_field":{}},{"stereo":{}},{"name":"x","stereo":{}}])"),
              ElementsAre("stereo", "dof", "stereo-2", "x"));
  const auto clash = [](const std::string& list) { return FieldOf(ParseRenders(json::parse(list)).status()); };
  EXPECT_EQ(clash(R"([{"name":"a","stereo":{}},{"name":"a","stereo":{}}])"), "renders[1].name");
  EXPECT_EQ(clash(R"([{"name":"a-left","stereo":{}},{"name":"a","stereo":{"format":"separate"}}])"), "renders[1].name");
  EXPECT_EQ(clash("7"), "renders");
}

RenderPlan Plan(const std::string& text) {
  const auto options = ParseRender(json::parse(text), "render");
  EXPECT_TRUE(options.ok()) << options.status();
  const auto plan = PlanRender(*options, Clip(), "render");
  EXPECT_TRUE(plan.ok()) << plan.status();
  return *plan;
}

// Names by which players know how the eyes are packed.
TEST(RenderPlan, FilesAreNamedByTheConvention) {
  EXPECT_THAT(Plan(R"({"container":"mp4","depth_of_field":{}})").videos, ElementsAre("dof.mp4"));
  EXPECT_THAT(Plan(R"({"container":"mkv","stereo":{}})").videos, ElementsAre("stereo_LRF_Full_SBS.mkv"));
  EXPECT_THAT(Plan(R"({"container":"mp4","stereo":{"format":"half-sbs"}})").videos, ElementsAre("stereo_LR.mp4"));
  const RenderPlan separate = Plan(R"({"name":"a","container":"mp4","stereo":{"format":"separate"}})");
  EXPECT_THAT(separate.streams, ElementsAre("a-left", "a-right"));
  EXPECT_THAT(separate.videos, ElementsAre("a_left.mp4", "a_right.mp4"));
  EXPECT_THAT(Plan(R"({"stereo":{}})").videos, IsEmpty());
  EXPECT_EQ(Plan(R"({"frame_format":"jpeg","stereo":{}})").extension, "jpg");
}

TEST(RenderPlan, LooksAtOtherFramesOnlyWhereItHelps) {
  EXPECT_GT(Plan(R"({"stereo":{}})").reach_frames, 0);
  EXPECT_TRUE(Plan(R"({"stereo":{}})").uses_motion);
  const RenderPlan gather = Plan(R"({"depth_of_field":{"method":"gather"}})");
  EXPECT_EQ(gather.reach_frames, 0);
  EXPECT_FALSE(gather.uses_motion);
  const RenderPlan track = Plan(R"({"depth_of_field":{"method":"kraus","focus":{"track":{"frame":7}}}})");
  EXPECT_EQ(track.anchor_frame, 7);
  EXPECT_TRUE(track.uses_motion) << "the point is followed along it";
}

TEST(VideoOptions, AnaglyphsKeepTheirColoursAndMarksAreAskedFor) {
  const auto options = [](const std::string& text) {
    return VideoOptionsOf(*ParseRender(json::parse(text), "render"), VideoContainer::kMp4);
  };
  EXPECT_TRUE(options(R"({"stereo":{"format":"anaglyph-dubois"}})").full_chroma);
  EXPECT_FALSE(options(R"({"stereo":{}})").full_chroma);
  EXPECT_EQ(options(R"({"stereo":{}})").stereo, VideoStereo::kNone);
  EXPECT_EQ(options(R"({"stereo":{"metadata":true}})").stereo, VideoStereo::kSideBySide);
  EXPECT_EQ(options(R"({"stereo":{"metadata":true,"format":"half-tb"}})").stereo, VideoStereo::kTopBottom);
}

}  // namespace
}  // namespace depthtween
