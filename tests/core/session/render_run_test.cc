// Rendering a small result: pieces and processes give the bits of the whole, and a focus that is followed goes on from
// where it was left. The truth is the whole run, and the geometry of the scene.
#include "core/session/render_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <filesystem>

#include "core/io/file.h"
#include "core/io/result_folder.h"
#include "core/session/upsample_run.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr int kFrames = 16, kFrameWidth = 64, kFrameHeight = 48;
constexpr float kWall = 4.0F, kBox = 2.0F;

int BoxLeft(int frame) { return 8 + 2 * frame; }
bool InBox(int frame, int x, int y) { return x >= BoxLeft(frame) && x < BoxLeft(frame) + 12 && y >= 16 && y < 32; }

// A box that moves 2 pixels a frame in front of a wall, upsampled without error.
class RenderRun : public testing::Test {
 protected:
  void SetUp() override {
    Sequence sequence = {
        .camera = {.width = kFrameWidth, .height = kFrameHeight, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5},
        .depth_scale = 1000,
    };
    std::vector<Image<Rgb8>> colors;
    for (int i = 0; i < kFrames; ++i) {
      sequence.color.push_back({i * 4'166'667LL, "rgb/" + std::to_string(100 + i) + ".png"});
      Image<Rgb8>& color = colors.emplace_back(kFrameWidth, kFrameHeight);
      for (int y = 0; y < kFrameHeight; ++y)
        for (int x = 0; x < kFrameWidth; ++x)
          color(x, y) = InBox(i, x, y) ? Rgb8{220, 60, 40}
                                       : Rgb8{static_cast<uint8_t>(40 + 3 * x), static_cast<uint8_t>(60 + 2 * y), 90};
    }
    sequence.depth = {{0, "depth/0.png"}};
    std::vector<Image<float>> depth;
    depth.push_back(Image<float>(kFrameWidth, kFrameHeight, kWall));
    const auto writer = ResultWriter::Create(scratch_.path(), sequence, /*with_motion=*/true);
    ASSERT_TRUE(writer.ok()) << writer.status();
    for (int i = 0; i < kFrames; ++i) {
      DepthResult result = {.color_index = i,
                            .depth_m = Image<float>(kFrameWidth, kFrameHeight, kWall),
                            .sigma_m = Image<float>(kFrameWidth, kFrameHeight, 0.01F),
                            .provenance = Image<Provenance>(kFrameWidth, kFrameHeight, Provenance::kBoth)};
      if (i + 1 < kFrames) {
        result.motion_next = Image<Flow2>(kFrameWidth, kFrameHeight);
        result.motion_back = Image<Flow2>(kFrameWidth, kFrameHeight);
      }
      for (int y = 0; y < kFrameHeight; ++y)
        for (int x = 0; x < kFrameWidth; ++x) {
          if (InBox(i, x, y)) result.depth_m(x, y) = kBox;
          if (i + 1 == kFrames) continue;
          if (InBox(i, x, y)) result.motion_next(x, y) = {2, 0};
          if (InBox(i + 1, x, y)) result.motion_back(x, y) = {-2, 0};
        }
      ASSERT_EQ(writer->Write(result), absl::OkStatus());
    }
    source_ = std::make_unique<MemorySource>(std::move(sequence), std::move(colors), std::move(depth));
    constants_ = {.preview_near_m = 0.95 * kBox, .preview_far_m = 1.05 * kWall, .median_depth_m = kWall};
  }

  std::unique_ptr<ClipRenderer> Make(const std::string& text) {
    const auto options = ParseRender(json::parse(text), "render");
    EXPECT_TRUE(options.ok()) << options.status();
    auto renderer = ClipRenderer::Create(*options, {source_.get(), scratch_.path(), constants_}, "render");
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    return *std::move(renderer);
  }

  struct Rendered {
    std::vector<std::string> pictures;  // as PNG
    RenderPart part;
  };
  Rendered Run(ClipRenderer& renderer, int first, int count, const RenderPart* near = nullptr, int threads = 1) {
    Rendered rendered;
    const auto part = renderer.Run(first, count, near, threads, {}, [&](int frame, std::vector<Image<Rgb8>> pictures) {
      EXPECT_EQ(frame, first + static_cast<int>(rendered.pictures.size()));
      rendered.pictures.push_back(*EncodePicture(pictures.at(0), FrameFormat::kPng));
      return absl::OkStatus();
    });
    EXPECT_TRUE(part.ok()) << part.status();
    rendered.part = *part;
    return rendered;
  }

  TemporaryFolder scratch_;
  std::unique_ptr<MemorySource> source_;
  ClipConstants constants_;
};

TEST_F(RenderRun, PiecesGiveTheBitsOfTheWhole) {
  for (const char* text :
       {R"({"depth_of_field":{"aperture_mm":60,"focus":{"track":{"frame":9,"x":30,"y":24}}}})", R"({"stereo":{}})"}) {
    const auto renderer = Make(text);
    const Rendered whole = Run(*renderer, 0, kFrames, nullptr, /*threads=*/3);
    for (int first = 0; first < kFrames; first += 4) {
      const auto another = Make(text);
      const Rendered piece = Run(*another, first, 4);
      for (int i = 0; i < 4; ++i) EXPECT_EQ(piece.pictures[i], whole.pictures[first + i]) << text << first + i;
    }
  }
}

// Motion that was made and is gone must not pass for motion that never was; who knows of none does without.
TEST_F(RenderRun, WhatIsLostEndsTheRender) {
  std::filesystem::remove(scratch_.path() + "/motion/105.npz");
  const auto options = ParseRender(json::parse(R"({"stereo":{}})"), "render");
  ASSERT_TRUE(options.ok());
  const auto run = [&](bool made) {
    const auto was_made = [&](int frame, bool motion) {
      return made && motion && frame == 5 ? LostError("motion", frame) : absl::OkStatus();
    };
    const auto renderer =
        ClipRenderer::Create(*options, {source_.get(), scratch_.path(), constants_, was_made}, "render");
    EXPECT_TRUE(renderer.ok()) << renderer.status();
    return (*renderer)->Run(3, 1, nullptr, 2, {}, [](int, const auto&) { return absl::OkStatus(); }).status();
  };
  EXPECT_EQ(run(/*made=*/false), absl::OkStatus());
  const absl::Status lost = run(/*made=*/true);
  EXPECT_TRUE(absl::IsDataLoss(lost)) << lost;
  EXPECT_EQ(LostOf(lost), json({{"what", "motion"}, {"frame", 5}}));
  EXPECT_TRUE(LostOf(absl::DataLossError("damaged")).is_null());
}

// Whether a part goes on from its neighbour or from the start of the track must not show, forward and backward in time,
// and neither must the way through JSON.
TEST_F(RenderRun, AFollowedFocusGoesOnWhereItWasLeft) {
  const auto renderer = Make(R"({"depth_of_field":{"focus":{"track":{"frame":8,"x":30,"y":24}}}})");
  const Rendered alone = Run(*renderer, 12, 4);
  const Rendered before = Run(*renderer, 8, 4);
  const auto stored = ParseRenderPart(ToJson(before.part).dump());
  ASSERT_TRUE(stored.ok()) << stored.status();
  const Rendered after = Run(*renderer, 12, 4, &*stored);
  EXPECT_EQ(after.pictures, alone.pictures);
  EXPECT_EQ(after.part.last_focus->x, alone.part.last_focus->x);

  const Rendered earlier_alone = Run(*renderer, 0, 4);
  const Rendered later = Run(*renderer, 4, 4);
  EXPECT_EQ(Run(*renderer, 0, 4, &later.part).pictures, earlier_alone.pictures);
  // It is the box that is followed: in frame 15 it is 2 * 7 pixels on.
  EXPECT_NEAR(alone.part.last_focus->x, 30 + 14, 1.0);
  EXPECT_NEAR(alone.part.last_focus->depth_m, kBox, 0.01);
  EXPECT_NEAR(earlier_alone.part.first_focus->x, 30 - 16, 1.0);
}

// A focus farther than the box blurs it, a focus on it does not: the edge of its colour tells.
TEST_F(RenderRun, FocusDecidesWhatIsSharp) {
  const auto sharp = Make(R"({"depth_of_field":{"aperture_mm":400,"focus":{"depth_m":2}}})");
  const auto blurred = Make(R"({"depth_of_field":{"aperture_mm":400,"focus":{"depth_m":4}}})");
  const auto edge = [&](ClipRenderer& renderer) {
    int step = 0;
    EXPECT_TRUE(renderer
                    .Run(8, 1, nullptr, 1, {},
                         [&](int, std::vector<Image<Rgb8>> pictures) {
                           const int x = BoxLeft(8);
                           step = pictures[0](x, 24).r - pictures[0](x - 1, 24).r;
                           return absl::OkStatus();
                         })
                    .ok());
    return step;
  };
  EXPECT_GT(edge(*sharp), edge(*blurred) + 40);
}

TEST_F(RenderRun, DoesWithoutWhatIsNotThere) {
  const Rendered with = Run(*Make(R"({"stereo":{}})"), 8, 1);
  std::filesystem::remove_all(scratch_ / "motion");
  const Rendered without = Run(*Make(R"({"stereo":{}})"), 8, 1);
  EXPECT_NE(with.pictures, without.pictures) << "behind the box other frames see the wall";
  std::filesystem::remove(scratch_ / "depth/106.png");
  EXPECT_EQ(Run(*Make(R"({"stereo":{}})"), 8, 1).pictures, without.pictures);
  const auto renderer = Make(R"({"stereo":{}})");
  EXPECT_EQ(renderer->Run(6, 1, nullptr, 1, {}, nullptr).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(RenderRun, WhatPointsAtNothingIsTheFieldsFault) {
  std::filesystem::remove_all(scratch_ / "depth");
  const auto options = ParseRender(json::parse(R"({"depth_of_field":{"focus":{"pixel":{"frame":1}}}})"), "render");
  const auto renderer = ClipRenderer::Create(*options, {source_.get(), scratch_.path(), constants_}, "render");
  EXPECT_FALSE(renderer.ok());
  const auto wide = ParseRender(json::parse(R"({"stereo":{"baseline_m":30}})"), "render");
  const absl::Status refused = CheckRender(*wide, source_->sequence(), constants_, "render");
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(FieldOf(refused).empty());
}

TEST_F(RenderRun, ReportsAreMergedFromParts) {
  const auto renderer = Make(R"({"stereo":{}})");
  const json whole = renderer->Report({Run(*renderer, 0, kFrames).part});
  const json parts = renderer->Report({Run(*renderer, 8, 8).part, Run(*renderer, 0, 8).part});
  EXPECT_EQ(whole, parts);
  EXPECT_EQ(whole.at("comfort").at("frames"), kFrames);
}

TEST_F(RenderRun, StopsWhenToldTo) {
  std::stop_source stop;
  const auto renderer = Make(R"({"stereo":{}})");
  const auto part = renderer->Run(0, kFrames, nullptr, 1, stop.get_token(), [&](int, const auto&) {
    stop.request_stop();
    return absl::OkStatus();
  });
  EXPECT_EQ(part.status().code(), absl::StatusCode::kCancelled);
}

TEST_F(RenderRun, VideosAreMadeOfTheStoredPictures) {
  const auto options = ParseRender(json::parse(R"({"container":"mkv","stereo":{"format":"separate"}})"), "render");
  const auto plan = PlanRender(*options, source_->sequence(), "render");
  ASSERT_TRUE(plan.ok()) << plan.status();
  const TemporaryFolder out;
  const auto folders = PictureFolders::Create(out.path(), *options, *plan);
  ASSERT_TRUE(folders.ok()) << folders.status();
  for (const FrameRef& frame : source_->sequence().color) {
    std::vector<Image<Rgb8>> eyes;
    eyes.emplace_back(kFrameWidth, kFrameHeight, Rgb8{1, 2, 3});
    eyes.emplace_back(kFrameWidth, kFrameHeight, Rgb8{4, 5, 6});
    ASSERT_EQ(folders->Write(frame.Stem(), eyes), absl::OkStatus());
  }
  std::vector<int> told;
  ASSERT_EQ(
      AssembleVideos(out.path(), *options, *plan, source_->sequence(), {}, [&](int frame) { told.push_back(frame); }),
      absl::OkStatus());
  ASSERT_EQ(told.size(), source_->sequence().color.size());
  EXPECT_EQ(told.back(), static_cast<int>(told.size()) - 1);
  EXPECT_TRUE(FileExists(out / "stereo_left.mkv"));
  EXPECT_TRUE(FileExists(out / "stereo_right.mkv"));
  std::filesystem::remove(out / "stereo-left/103.png");
  EXPECT_EQ(AssembleVideos(out.path(), *options, *plan, source_->sequence(), {}).code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace depthtween
