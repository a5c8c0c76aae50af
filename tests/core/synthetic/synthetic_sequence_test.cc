// Recordings that are rendered: stamps by arithmetic, files as their documentation says.
#include "core/synthetic/synthetic_sequence.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/io/file.h"
#include "core/io/flow_png.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/io/sequence_folder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Small and quick: 9 colour frames with keys at 0, 4 and 8.
SyntheticOptions Small(const std::string& scene) {
  return {.scene = scene, .frames = 9, .depth_fps = 60, .width = 96, .height = 80, .seed = 3};
}

template <typename T>
bool Same(const Image<T>& a, const Image<T>& b) {
  return a.view().SameSize(b.view()) && std::equal(a.data(), a.data() + a.pixel_count(), b.data());
}

class Folder : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    dir_ = (fs::path(testing::TempDir()) / (std::string("synthetic_") + info->name())).string();
    fs::remove_all(dir_);
  }
  void TearDown() override { fs::remove_all(dir_); }
  std::string Path(const std::string& name) const { return JoinPath(dir_, name); }
  std::string dir_;
};

TEST(SyntheticSequence, StampsFollowTheRates) {
  SyntheticOptions options = Small("still");
  const auto clip = *SyntheticSequence::Create(options);
  ASSERT_EQ(clip->sequence().color.size(), 9U);
  ASSERT_EQ(clip->sequence().depth.size(), 3U);
  EXPECT_EQ(clip->sequence().color[1].time_ns, 4166667);
  EXPECT_EQ(clip->sequence().depth[2].time_ns, clip->sequence().color[8].time_ns);

  // Of 9 frames at 240 fps, 33.3 ms, depth at 100 fps from 3 ms on has 4: at 3, 13, 23 and 33 ms.
  options.depth_fps = 100;
  options.depth_phase_s = 0.003;
  const auto odd = *SyntheticSequence::Create(options);
  ASSERT_EQ(odd->sequence().depth.size(), 4U);
  EXPECT_EQ(odd->sequence().depth[3].time_ns, 33000000);
}

// A clock that is off changes the stamps of depth frames and nothing that they show.
TEST(SyntheticSequence, ClocksChangeStampsOnly) {
  SyntheticOptions options = Small("kick");
  const auto plain = *SyntheticSequence::Create(options);
  options.depth_clock = {.offset_s = -0.002, .drift_ppm = 1000};
  const auto off = *SyntheticSequence::Create(options);
  EXPECT_EQ(off->sequence().depth[0].time_ns, -2000000);
  EXPECT_EQ(off->sequence().depth[2].time_ns, -2000000 + 33366667);
  EXPECT_EQ(off->sequence().color[8].time_ns, plain->sequence().color[8].time_ns);
  EXPECT_TRUE(Same(*off->Depth(2), *plain->Depth(2)));
}

// Time is time: the fourth frame at 120 fps shows the same instant as the eighth at 240.
TEST(SyntheticSequence, FramesDependOnTimeNotOnRate) {
  SyntheticOptions options = Small("bounce");
  options.sensor = PerfectSensor();
  const auto fast = *SyntheticSequence::Create(options);
  options.color_fps = 120;
  options.frames = 5;
  const auto slow = *SyntheticSequence::Create(options);
  EXPECT_TRUE(Same(*fast->Color(8), *slow->Color(4)));
  EXPECT_FALSE(Same(*fast->Color(8), *fast->Color(0)));
  EXPECT_TRUE(Same(fast->ColorView(8).Surface(1).depth_m, *fast->Depth(2)));
}

TEST(SyntheticSequence, IsSetByItsSeed) {
  SyntheticOptions options = Small("turntable");
  const auto one = *SyntheticSequence::Create(options, 1), again = *SyntheticSequence::Create(options, 3);
  options.seed = 4;
  const auto other = *SyntheticSequence::Create(options);
  EXPECT_TRUE(Same(*one->Color(2), *again->Color(2)));
  EXPECT_TRUE(Same(*one->Depth(1), *again->Depth(1)));
  EXPECT_FALSE(Same(*one->Color(2), *other->Color(2)));
}

TEST(SyntheticOptions, ValidateNamesFieldValueAndRule) {
  const auto message = [](auto change) {
    SyntheticOptions options = Small("kick");
    change(options);
    return std::string(SyntheticSequence::Create(options).status().message());
  };
  EXPECT_THAT(message([](auto& o) { o.frames = 0; }), HasSubstr("frames = 0, must be between 1"));
  EXPECT_THAT(message([](auto& o) { o.color_fps = std::nan(""); }), HasSubstr("color_fps = nan, must be above 0"));
  EXPECT_THAT(message([](auto& o) { o.depth_fps = 241; }),
              HasSubstr("depth_fps = 241, must be above 0 and at most color_fps (240)"));
  EXPECT_THAT(message([](auto& o) { o.depth_phase_s = 1; }), HasSubstr("depth_phase_s = 1, must be between"));
  EXPECT_THAT(message([](auto& o) { o.width = 8; }), HasSubstr("width = 8, must be between 16"));
  EXPECT_THAT(message([](auto& o) { o.scene = "kik"; }), HasSubstr("scene = 'kik', must be one of"));
  EXPECT_THAT(message([](auto& o) { o.sensor.quantum_m = -1; }), HasSubstr("quantum_m = -1"));
  EXPECT_THAT(message([](auto& o) { o.depth_clock.offset_s = 5; }), HasSubstr("do not overlap"));
}

TEST_F(Folder, HoldsWhatTheFormatSays) {
  const SyntheticOptions options = Small("kick");
  int last_done = 0, last_total = 0;
  ASSERT_TRUE(WriteSyntheticSequence(options, dir_,
                                     {.threads = 2,
                                      .on_progress =
                                          [&](int done, int total) {
                                            EXPECT_EQ(done, last_done + 1);
                                            last_done = done;
                                            last_total = total;
                                          }})
                  .ok());
  EXPECT_EQ(last_done, 12);
  EXPECT_EQ(last_total, 12);
  const auto check = CheckSequenceFolder(dir_);
  ASSERT_TRUE(check.ok());
  EXPECT_TRUE(check->ok()) << check->violations.front().file << check->violations.front().status;
  EXPECT_THAT(check->warnings, testing::IsEmpty());

  const auto clip = *SyntheticSequence::Create(options);
  const auto folder = *SequenceFolder::Open(dir_);
  ASSERT_EQ(folder->sequence().color.size(), 9U);
  ASSERT_EQ(folder->sequence().depth.size(), 3U);
  for (size_t i = 0; i < 9; ++i) {
    EXPECT_EQ(folder->sequence().color[i].time_ns, clip->sequence().color[i].time_ns);
    EXPECT_EQ(folder->sequence().color[i].path, clip->sequence().color[i].path);
  }
  EXPECT_EQ(folder->sequence().camera.fx, clip->sequence().camera.fx);
  const double scale = folder->sequence().depth_scale;
  EXPECT_TRUE(Same(QuantiseDepth(*folder->Depth(1), scale), QuantiseDepth(*clip->Depth(1), scale)));
  // JPEG of quality 96 keeps colour within a few levels.
  const Image<Rgb8> color = *folder->Color(4), rendered = *clip->Color(4);
  double difference = 0;
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 96; ++x) difference += std::abs(color(x, y).g - rendered(x, y).g);
  EXPECT_LT(difference / (96 * 80), 3);

  const SurfaceTruth surface = clip->ColorView(5).Surface(1);
  EXPECT_TRUE(Same(*ReadPng16(Path("gt/depth/000005.png")), QuantiseDepth(surface.depth_m, scale)));
  EXPECT_TRUE(Same(*ReadPng8(Path("gt/object/000005.png")), surface.object));
  EXPECT_TRUE(
      Same(*ReadPng16(Path("depth_clean/000001.png")), QuantiseDepth(clip->DepthView(1).Surface(1).depth_m, scale)));
  const MotionTruth motion = clip->ColorView(5).MotionTo(clip->ColorView(6), 1);
  const FlowField flow = *ReadFlowPng(Path("gt/flow/000005.png"));
  EXPECT_NEAR(flow.flow(50, 60).u, motion.flow(50, 60).u, 1 / 128.0 + 1e-6);
  EXPECT_TRUE(Same(*ReadPng8(Path("gt/occ/000005.png")), motion.occluded));
  EXPECT_FALSE(FileExists(Path("gt/flow/000008.png"))) << "the last frame goes nowhere";

  const MotionTruth back = clip->DepthView(2).MotionTo(clip->DepthView(1), 1);
  const FlowField key_flow = *ReadFlowPng(Path("gt/flow_key/bwd_000002_000001.png"));
  EXPECT_NEAR(key_flow.flow(40, 50).v, back.flow(40, 50).v, 1 / 128.0 + 1e-6);
  EXPECT_TRUE(Same(*ReadPng8(Path("gt/flow_key/occ_000002_000001.png")), back.occluded));
  EXPECT_TRUE(FileExists(Path("gt/flow_key/fwd_000000_000001.png")));
  const MotionTruth forward = clip->DepthView(0).MotionTo(clip->DepthView(1), 1);
  const Npz scene_flow = *ReadNpz(Path("gt/sceneflow_key/000000_000001.npz"));
  EXPECT_THAT(scene_flow.at("sf").shape, testing::ElementsAre(80, 96, 3));
  EXPECT_THAT(scene_flow.at("valid").shape, testing::ElementsAre(80, 96));
  const std::vector<float> components = scene_flow.at("sf").ToFloats();
  EXPECT_NEAR(components[3 * (60 * 96 + 45) + 2], forward.scene_flow(45, 60).z, 1e-3);

  const nlohmann::json objects = nlohmann::json::parse(*ReadFile(Path("gt/objects.json")));
  ASSERT_EQ(objects.size(), clip->scene().bodies().size());
  EXPECT_EQ(objects[0]["index"], 1);
  EXPECT_EQ(objects[0]["name"], "floor");
  EXPECT_EQ(objects[0]["dynamic"], false);
  EXPECT_THAT(*ReadFile(Path("depth_clean.txt")), HasSubstr("depth_clean/000002.png"));
}

TEST_F(Folder, DoesNotDependOnThreads) {
  SyntheticOptions options = Small("cloth");
  options.frames = 5;
  ASSERT_TRUE(WriteSyntheticSequence(options, Path("one"), {.threads = 1}).ok());
  ASSERT_TRUE(WriteSyntheticSequence(options, Path("three"), {.threads = 3}).ok());
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(Path("one"))) {
    if (!entry.is_regular_file()) continue;
    ++files;
    const std::string name = fs::relative(entry.path(), Path("one")).string();
    EXPECT_EQ(*ReadFile(Path("one/" + name)), *ReadFile(Path("three/" + name))) << name;
  }
  EXPECT_GT(files, 30);
}

TEST_F(Folder, WithoutTruthHoldsARecordingOnly) {
  ASSERT_TRUE(WriteSyntheticSequence(Small("still"), dir_, {.truth = false}).ok());
  EXPECT_TRUE(CheckSequenceFolder(dir_)->ok());
  EXPECT_FALSE(fs::exists(Path("gt")));
  EXPECT_FALSE(fs::exists(Path("depth_clean")));
}

TEST_F(Folder, StopsWhenAskedAndIsNoSequenceThen) {
  std::stop_source stop;
  const absl::Status status = WriteSyntheticSequence(
      Small("still"), dir_, {.stop = stop.get_token(), .on_progress = [&](int, int) { stop.request_stop(); }});
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_FALSE(FileExists(Path("rgb.txt")));
}

TEST_F(Folder, NeverWritesOverASequence) {
  ASSERT_TRUE(WriteSyntheticSequence(Small("still"), dir_, {.truth = false}).ok());
  EXPECT_EQ(WriteSyntheticSequence(Small("still"), dir_, {}).code(), absl::StatusCode::kAlreadyExists);
}

}  // namespace
}  // namespace depthtween
