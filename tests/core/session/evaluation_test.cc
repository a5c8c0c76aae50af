// Evaluation of clips whose depth is a formula, so that each baseline's error is known by hand.
#include "core/session/evaluation.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "core/baselines/baselines.h"
#include "core/io/file.h"
#include "core/io/flow_png.h"
#include "core/io/png.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"
#include "core/session/clip_alignment.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using ::testing::HasSubstr;

constexpr int kWidth = 48, kHeight = 40;
constexpr double kDepthScale = 5000;
constexpr int64_t kMs = 1'000'000;

// Depth of a pixel at a time: a box before a wall that comes nearer; nothing moves sideways.
float TrueDepth(int x, int y, int64_t time_ns) {
  const double approach = 1e-3 * static_cast<double>(time_ns / kMs);
  return static_cast<float>(x < 20 && y > 8 ? 1.5 : 3.0 - approach);
}

class EvaluationTest : public testing::Test {
 protected:
  struct ClipOptions {
    int frames = 9;
    int64_t depth_offset_ns = 0;  // of the depth stamps against the colour stamps
    int depth_every = 1;          // colour frames per depth map
    bool truth = false;           // gt/depth
    int width = kWidth;
    int64_t start_ns = 0;
  };
  std::string Path(const std::string& name) const { return root_ / name; }

  std::string WriteClip(const std::string& name, const ClipOptions& clip) {
    Camera camera{.width = clip.width, .height = kHeight, .fx = 50, .fy = 50, .cx = 23.5, .cy = 19.5};
    auto writer = SequenceWriter::Create(Path(name), camera, kDepthScale);
    EXPECT_TRUE(writer.ok()) << writer.status();
    for (int f = 0; f < clip.frames; ++f) {
      const int64_t time_ns = clip.start_ns + f * 10 * kMs;
      Image<Rgb8> color(clip.width, kHeight);
      Image<float> depth_m(clip.width, kHeight), truth_m(clip.width, kHeight);
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < clip.width; ++x) {
          const auto grey = static_cast<uint8_t>(128 + 60 * std::sin(0.5 * x) * std::cos(0.4 * y));
          color(x, y) = {grey, grey, grey};
          depth_m(x, y) = TrueDepth(x, y, time_ns + clip.depth_offset_ns);
          truth_m(x, y) = TrueDepth(x, y, time_ns);
        }
      }
      EXPECT_TRUE(writer->AddColor(time_ns, color).ok());
      if (clip.truth) {
        EXPECT_TRUE(writer->AddTruth(truth_m).ok());
      }
      if (f % clip.depth_every == 0) {
        EXPECT_TRUE(writer->AddDepth(time_ns + clip.depth_offset_ns, depth_m).ok());
      }
    }
    const absl::Status finished = writer->Finish();
    EXPECT_TRUE(finished.ok()) << finished;
    return Path(name);
  }

  // What `upsample --method baseline --key-every N` leaves. `change` may alter each frame first.
  std::string WriteResult(const std::string& name, const std::string& sequence_dir, const std::string& baseline,
                          int key_every, const std::function<void(DepthResult&)>& change = nullptr,
                          const Registration& registration = {}) {
    const auto folder = SequenceFolder::Open(sequence_dir);
    EXPECT_TRUE(folder.ok()) << folder.status();
    const ClipAlignment alignment{.registration = registration};
    const ClipSource source(**folder, alignment, key_every);
    const auto writer = ResultWriter::Create(Path(name), source.sequence());
    EXPECT_TRUE(writer.ok()) << writer.status();
    const auto upsampler = MakeBaseline(baseline);
    for (const Interval& interval : PlanIntervals(source.sequence())) {
      const auto run = (*upsampler)->Run(source, ClipConstants{}, interval, {}, [&](DepthResult result) {
        if (change) change(result);
        return writer->Write(result);
      });
      EXPECT_TRUE(run.ok()) << run.status();
    }
    nlohmann::json report = {{"options", {{"method", baseline}, {"key_every", key_every}}}};
    AddTo(alignment, report);
    const absl::Status finished = writer->Finish(report);
    EXPECT_TRUE(finished.ok()) << finished;
    return Path(name);
  }

  TemporaryFolder root_;
};

const DepthScore& All(const Evaluation& evaluation, size_t method) {
  return evaluation.score.methods.at(method)[Region::kAll];
}

// Depth is linear in time, so linear is exact up to storage (0.2 mm units) and hold is off by what the wall has moved
// since the last key: 10, 20, 30 mm in the three frames between keys that are left out.
TEST_F(EvaluationTest, ScoresLeftOutDepthMaps) {
  const std::string clip = WriteClip("clip", {});
  const auto evaluation =
      Evaluate({.result_dir = WriteResult("out", clip, "linear", 4), .reference_dir = clip, .baselines = {"hold"}});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  EXPECT_EQ(evaluation->truth, "left-out depth maps");
  EXPECT_EQ(evaluation->key_every, 4);
  ASSERT_EQ(evaluation->frame_stems.size(), 6U);
  EXPECT_EQ(evaluation->frame_stems[0], "000001");
  EXPECT_LE(All(*evaluation, 0).rmse_mm, 0.2);
  EXPECT_EQ(All(*evaluation, 0).pixels, 6 * kWidth * kHeight);
  const double moving_share = 1.0 - 20.0 * (kHeight - 9) / (kWidth * kHeight);
  EXPECT_NEAR(All(*evaluation, 1).rmse_mm, std::sqrt(moving_share * (100 + 400 + 900) / 3.0), 0.01);
  EXPECT_EQ(evaluation->score.methods[1].completeness, 1.0);
  // Colour stands still, so the floor sees the wall approach by 10 mm a frame.
  ASSERT_TRUE(evaluation->sensor_floor.has_value());
  EXPECT_NEAR(evaluation->sensor_floor->rmse_mm, 10.0 * std::sqrt(moving_share), 0.01);
}

// The wall is 3 m away and the box half as far: with truth up to 2 m only the box is scored, and still.
TEST_F(EvaluationTest, ScoresNoTruthBeyondWhatIsAskedFor) {
  const std::string clip = WriteClip("clip", {});
  const std::string result = WriteResult("result", clip, "hold", 2);
  const auto all = Evaluate({.result_dir = result, .reference_dir = clip});
  const auto near = Evaluate({.result_dir = result, .reference_dir = clip, .far_m = 2});
  ASSERT_TRUE(all.ok() && near.ok());
  EXPECT_LT(near->score.truth_pixels, all->score.truth_pixels);
  EXPECT_LT(All(*near, 0).rmse_mm, 0.2);
  EXPECT_GT(All(*all, 0).rmse_mm, 5);
  EXPECT_THAT(FormatTable(*near), HasSubstr("known within 2 m"));
  EXPECT_THAT(FormatTable(*all), HasSubstr("RMSE less the truth's own noise, in mm: hold"));
  EXPECT_TRUE(ToJson(*all)["methods"][0].contains("rmse_less_truth_noise_mm"));
}

// Where depth was moved to colour, so is the truth that was left out: linear stays exact, or a box of 1.5 m would be
// beside itself.
TEST_F(EvaluationTest, MovesLeftOutDepthAsTheInputWasMoved) {
  const std::string clip = WriteClip("clip", {});
  const std::string result = WriteResult("result", clip, "linear", 2, nullptr, {.right_px = 5, .down_px = -3});
  const auto evaluation = Evaluate({.result_dir = result, .reference_dir = clip});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  EXPECT_GT(All(*evaluation, 0).pixels, 1000);
  EXPECT_LT(All(*evaluation, 0).rmse_mm, 0.2);
}

// A baseline computed on the fly must get the numbers that its stored result gets, or ratios would compare unlike
// things.
TEST_F(EvaluationTest, BaselinesScoreAsTheirStoredResults) {
  const std::string clip = WriteClip("clip", {});
  std::map<std::string, DepthScore> stored;
  for (const std::string& name : BaselineNames()) {
    const auto evaluation = Evaluate({.result_dir = WriteResult(name, clip, name, 4), .reference_dir = clip});
    ASSERT_TRUE(evaluation.ok()) << evaluation.status();
    stored[name] = All(*evaluation, 0);
  }
  const auto together = Evaluate(
      {.result_dir = Path("hold"), .reference_dir = clip, .baselines = {"hold", "nearest", "linear", "flow-warp"}});
  ASSERT_TRUE(together.ok()) << together.status();
  ASSERT_EQ(together->score.methods.size(), 4U);  // the result's own method once
  for (const MethodScore& method : together->score.methods) {
    EXPECT_EQ(method[Region::kAll].rmse_mm, stored[method.name].rmse_mm) << method.name;
    EXPECT_EQ(method[Region::kAll].mae_mm, stored[method.name].mae_mm) << method.name;
  }
}

// Exact depth for every colour frame wins over left-out maps; frames strictly between first and last key are scored.
TEST_F(EvaluationTest, PrefersExactTruth) {
  const std::string clip = WriteClip("clip", {.frames = 11, .depth_every = 4, .truth = true});
  const auto evaluation = Evaluate({.result_dir = WriteResult("out", clip, "linear", 1), .reference_dir = clip});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  EXPECT_EQ(evaluation->truth, "gt/depth");
  EXPECT_EQ(evaluation->frame_stems.size(), 7U);  // 1 to 7 of keys 0, 4, 8; frames 9 and 10 are held
  EXPECT_FALSE(evaluation->sensor_floor.has_value());
  EXPECT_EQ(evaluation->score.methods[0][Region::kMoving].pixels, 0);
}

// True motion comes from gt/flow and gt/occ. The left 10 columns move by 1 px; column 9 becomes hidden in each next
// frame.
TEST_F(EvaluationTest, SplitsByTrueMotionWhereKnown) {
  const std::string clip = WriteClip("clip", {.depth_every = 4, .truth = true});
  ASSERT_TRUE(MakeFolder(clip + "/gt/flow").ok());
  ASSERT_TRUE(MakeFolder(clip + "/gt/occ").ok());
  Image<Flow2> flow(kWidth, kHeight);
  Image<uint8_t> valid(kWidth, kHeight, 1), hidden(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < 10; ++x) flow(x, y) = {1.0F, 0.0F};
    hidden(9, y) = 255;
  }
  for (int f = 0; f < 8; ++f) {
    const std::string name = "00000" + std::to_string(f) + ".png";
    ASSERT_TRUE(WriteFlowPng(clip + "/gt/flow/" + name, flow, valid).ok());
    ASSERT_TRUE(WritePng8(clip + "/gt/occ/" + name, hidden).ok());
  }
  const auto evaluation = Evaluate({.result_dir = WriteResult("out", clip, "linear", 1), .reference_dir = clip});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  const MethodScore& score = evaluation->score.methods[0];
  EXPECT_EQ(score[Region::kMoving].pixels, 7 * 10 * kHeight);
  EXPECT_EQ(score[Region::kStatic].pixels, 7 * (kWidth - 10) * kHeight);
  // At the left border s columns come in s frames after a key (a single one is taken for growth), none at a key.
  EXPECT_EQ(score[Region::kDisoccluded].pixels, 2 * (1 + 2 + 3) * kHeight);
  EXPECT_TRUE(score.flicker_mm.has_value());
}

// Depth stamps 2 ms off are near enough to be scored at the colour frame beside them, 4 ms are not.
TEST_F(EvaluationTest, ScoresAsynchronousClipsOnlyWhereStampsMeet) {
  const std::string near = WriteClip("near", {.depth_offset_ns = 2 * kMs});
  const auto evaluation = Evaluate({.result_dir = WriteResult("near_out", near, "linear", 4), .reference_dir = near});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  EXPECT_EQ(evaluation->frame_stems.size(), 6U);
  EXPECT_NEAR(All(*evaluation, 0).median_mm, 2.0, 0.3);  // the wall moves 2 mm in 2 ms

  const std::string far = WriteClip("far", {.depth_offset_ns = 4 * kMs});
  const auto none = Evaluate({.result_dir = WriteResult("far_out", far, "linear", 4), .reference_dir = far});
  EXPECT_EQ(none.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(none.status().message(), HasSubstr("none of its 6 left-out depth maps is within 3 ms"));
}

TEST_F(EvaluationTest, SaysWhatIsWrongAndHowToFixIt) {
  const std::string clip = WriteClip("clip", {});
  const std::string out = WriteResult("out", clip, "linear", 4);

  auto status = Evaluate({.result_dir = clip, .reference_dir = clip}).status();
  EXPECT_FALSE(status.ok());
  EXPECT_THAT(status.message(), HasSubstr("report.json"));
  EXPECT_THAT(status.message(), HasSubstr("depthtween-core upsample"));

  status = Evaluate({.result_dir = out, .reference_dir = WriteClip("later", {.start_ns = 3 * kMs})}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("name the sequence that the result was made from"));

  status = Evaluate({.result_dir = out, .reference_dir = WriteClip("wide", {.width = kWidth + 2})}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("48 x 40"));
  EXPECT_THAT(status.message(), HasSubstr("50 x 40"));

  status = Evaluate({.result_dir = WriteResult("all", clip, "linear", 1), .reference_dir = clip}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(status.message(), HasSubstr("--key-every"));

  status = Evaluate({.result_dir = out, .reference_dir = clip, .baselines = {"magic"}}).status();
  EXPECT_THAT(status.message(), HasSubstr("'magic' is not known"));

  ASSERT_TRUE(WriteFile(out + "/report.json", R"({"options": {"method": "linear", "key_every": "four"}})").ok());
  status = Evaluate({.result_dir = out, .reference_dir = clip}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("options.key_every"));
}

TEST_F(EvaluationTest, StopsWhenAskedTo) {
  const std::string clip = WriteClip("clip", {});
  std::stop_source stop;
  const auto stopped = Evaluate({.result_dir = WriteResult("out", clip, "linear", 4),
                                 .reference_dir = clip,
                                 .stop = stop.get_token(),
                                 .on_progress = [&](int done, int total) {
                                   EXPECT_EQ(total, 6);
                                   if (done == 2) stop.request_stop();
                                 }});
  EXPECT_EQ(stopped.status().code(), absl::StatusCode::kCancelled);
}

// A method 8 mm off where its key was, the other as far as the wall went: ratios are quotients, and the JSON says all.
TEST_F(EvaluationTest, ReportsAsJsonAndAsATable) {
  const std::string clip = WriteClip("clip", {});
  const std::string out = WriteResult("out", clip, "linear", 4, [](DepthResult& result) {
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) result.depth_m(x, y) += 0.008F;
  });
  const auto evaluation = Evaluate({.result_dir = out, .reference_dir = clip, .baselines = {"hold", "nearest"}});
  ASSERT_TRUE(evaluation.ok()) << evaluation.status();
  const nlohmann::json json = ToJson(*evaluation);
  EXPECT_EQ(json["methods"].size(), 3U);
  EXPECT_EQ(json["methods"][0]["name"], "linear");
  EXPECT_NEAR(json["methods"][0]["regions"]["all"]["rmse_mm"].get<double>(), 8.0, 0.2);
  EXPECT_NEAR(json["ratios"]["hold"]["rmse"].get<double>(), All(*evaluation, 0).rmse_mm / All(*evaluation, 1).rmse_mm,
              1e-12);
  EXPECT_EQ(json["frames"].size(), 6U);
  EXPECT_EQ(json["methods"][0]["uncertainty"]["sparsification_mm"].size(), 100U);
  EXPECT_FALSE(json["methods"][1].contains("uncertainty"));
  EXPECT_THAT(json.dump(), testing::Not(HasSubstr("null")));  // what JSON makes of NaN

  const std::string table = FormatTable(*evaluation, 2);
  for (const char* part : {"6 frames", "1 in 4 depth maps", "edge F1", "linear / hold", "worst frames", "sensor floor"})
    EXPECT_THAT(table, HasSubstr(part));
  EXPECT_THAT(table, testing::Not(HasSubstr("nan")));
}

}  // namespace
}  // namespace depthtween
