// Where and when depth belongs, through JSON and in the frames that a clip gives.
#include "core/session/clip_alignment.h"

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/session/upsample_run.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/capture/rig_source.h"
#include "tests/core/session/nine_frames.h"

namespace depthtween {
namespace {

using testing::AllOf;
using testing::HasSubstr;

// Stamps move, frames stay those of the recording, and every n-th depth frame is the one that its stamp says.
TEST(ClipSource, HasStampsAndFramesThatBelongTogether) {
  const MemorySource recording = NineFrames();
  for (const int key_every : {1, 2}) {
    const ClipSource clip(recording, {.clock = {.model = {.offset_ns = 500'000}}}, key_every);
    ASSERT_EQ(clip.sequence().depth.size(), key_every == 1 ? 5U : 3U);
    for (size_t k = 0; k < clip.sequence().depth.size(); ++k) {
      const int color = 2 * key_every * static_cast<int>(k);
      EXPECT_EQ(clip.sequence().depth[k].time_ns, color * 1'000'000);
      EXPECT_EQ((*clip.Depth(static_cast<int>(k)))(0, 0), 1.0F + static_cast<float>(color));
    }
    EXPECT_EQ(clip.sequence().color[3].time_ns, 3'000'000);
    EXPECT_EQ((*clip.Color(3))(0, 0).r, 3);
  }
  // Pairing comes before leaving out: depth frame k belongs to colour frame 2 k, whichever are kept.
  const ClipSource paired(recording, {.clock = {.color_per_depth = 2}}, 2);
  ASSERT_EQ(paired.sequence().depth.size(), 3U);
  EXPECT_EQ(paired.sequence().depth[1].time_ns, 4'000'000);
  EXPECT_EQ((*paired.Depth(1))(0, 0), 5.0F);
}

// Depth is moved once, as the alignment says.
TEST(ClipSource, MovesDepthToColor) {
  const MemorySource recording = NineFrames();
  const ClipSource clip(recording, {.registration = {.right_px = 1}}, 1);
  const Image<float> depth = *clip.Depth(1);
  EXPECT_EQ(depth(0, 1), 0);
  EXPECT_EQ(depth(2, 1), 3.0F);
}

TEST(ClipAlignment, SurvivesJson) {
  ClipAlignment alignment{.clock = {.color_per_depth = 3},
                          .registration = {.right_px = 1.0 / 3, .scale = 0.9, .reference_m = 1.7},
                          .registered = RegistrationEstimate{.moves_px = 12.5, .keys = 4}};
  nlohmann::json plan;
  AddTo(alignment, plan);
  nlohmann::json again;
  AddTo(AlignmentOf(nlohmann::json::parse(plan.dump())), again);
  EXPECT_EQ(again, plan);
  alignment.registered.reset();
  AddTo(alignment, plan);
  EXPECT_FALSE(AlignmentOf(plan).registered.has_value());
  EXPECT_THROW(AlignmentOf(nlohmann::json{{"clock", plan["clock"]}}), nlohmann::json::exception);
}

// Depth that lies 9 px beside colour: said loudly either way, and moved when asked. The plan carries it to every task.
TEST(PrepareClip, SaysThatDepthIsNotRegistered) {
  const RigSource recording({.scene = "bounce", .right_px = 9});
  for (const char* choice : {"none", "estimate"}) {
    const UpsampleOptions options{.registration = choice, .threads = 2};
    const auto plan = PrepareClip(recording, options);
    ASSERT_TRUE(plan.ok()) << plan.status();
    const bool moved = std::string(choice) == "estimate";
    EXPECT_THAT(plan->constants.warnings, testing::Contains(AllOf(HasSubstr("beside those of colour"),
                                                                  HasSubstr(moved ? "was moved so" : "--register"))));
    EXPECT_NEAR(plan->alignment.registration.right_px, moved ? -9 : 0, 0.5);
    const auto parsed = ParseClipPlan(ToJson(*plan, recording.sequence()).dump(), recording.sequence(), options);
    ASSERT_TRUE(parsed.ok()) << parsed.status();
    EXPECT_EQ(parsed->alignment.registration.right_px, plan->alignment.registration.right_px);
  }
}

}  // namespace
}  // namespace depthtween
