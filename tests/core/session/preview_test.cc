// Colours and layouts of previews, by the definitions of the maps.
#include "core/session/preview.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <tuple>

#include "core/io/color.h"
#include "core/io/file.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using testing::HasSubstr;

PreviewFrame GreyFrame(int width, int height) {
  PreviewFrame frame;
  frame.color = Image<Rgb8>(width, height, Rgb8{90, 90, 90});
  frame.depth_m = Image<float>(width, height, 2.0F);
  frame.sigma_m = Image<float>(width, height, 0.01F);
  return frame;
}

// A colour means one distance: the map knows nothing of the frame, near and far differ, unknown is grey and no depth
// is.
TEST(Preview, AColourMeansADistance) {
  const PreviewRange range{.near_m = 1.0F, .far_m = 4.0F};
  Image<float> depth_m(64, 1);
  for (int x = 1; x < 64; ++x) depth_m(x, 0) = 1.0F + 3.0F * static_cast<float>(x - 1) / 62;
  const Image<Rgb8> colors = ColorizeDepth(depth_m, range);
  const auto is_grey = [](const Rgb8& c) { return std::max({c.r, c.g, c.b}) - std::min({c.r, c.g, c.b}) < 10; };
  EXPECT_TRUE(is_grey(colors(0, 0)));
  std::set<std::tuple<int, int, int>> distinct;
  for (int x = 1; x < 64; ++x) {
    EXPECT_FALSE(is_grey(colors(x, 0))) << x;
    distinct.insert({colors(x, 0).r, colors(x, 0).g, colors(x, 0).b});
  }
  EXPECT_EQ(distinct.size(), 63U);
  const Image<Rgb8> outside = ColorizeDepth(Image<float>(1, 1, 0.2F), range);
  EXPECT_EQ(outside(0, 0), colors(1, 0)) << "nearer than the range shows as its near end";
}

// Right is white, too near bluish, too far reddish; beyond the scale nothing changes; unknown is grey.
TEST(Preview, ErrorsHaveASign) {
  Image<float> truth_m(6, 1, 2.0F), estimate_m(6, 1, 2.0F);
  estimate_m(1, 0) = 2.0F - kErrorShownM;
  estimate_m(2, 0) = 2.0F + kErrorShownM;
  estimate_m(3, 0) = 4.0F;
  estimate_m(4, 0) = 0.0F;
  truth_m(5, 0) = 0.0F;
  const Image<Rgb8> colors = ColorizeError(estimate_m, truth_m);
  const auto parts = [&](int x) { return std::tuple(colors(x, 0).r, colors(x, 0).g, colors(x, 0).b); };
  EXPECT_GT(std::min({colors(0, 0).r, colors(0, 0).g, colors(0, 0).b}), 240);
  EXPECT_GT(colors(1, 0).b, colors(1, 0).r + 100);
  EXPECT_GT(colors(2, 0).r, colors(2, 0).b + 100);
  EXPECT_EQ(parts(2), parts(3));
  EXPECT_EQ(parts(4), parts(5));
  EXPECT_LT(std::max({colors(4, 0).r, colors(4, 0).g, colors(4, 0).b}), 80);
}

// A column of panels for each frame, a row for colour, depth and each method: one more method makes it higher, one more
// frame wider.
TEST(Preview, StripGrowsByMethodsAndFrames) {
  const auto strip = [](int frame_count, const std::vector<std::string>& methods) {
    std::vector<StripFrame> frames(frame_count);
    for (StripFrame& frame : frames) {
      frame.color = Image<Rgb8>(64, 48, Rgb8{90, 90, 90});
      frame.truth_m = Image<float>(64, 48, 2.0F);
      for (size_t m = 0; m < methods.size(); ++m) frame.estimates_m.emplace_back(64, 48, 2.05F);
    }
    return DrawErrorStrip(frames, methods, {});
  };
  const Image<Rgb8> small = strip(1, {"a"}), wide = strip(2, {"a"}), high = strip(1, {"a", "b"});
  EXPECT_GT(wide.width(), small.width());
  EXPECT_EQ(wide.height(), small.height());
  EXPECT_GT(high.height(), small.height());
  EXPECT_EQ(high.width(), small.width());
}

TEST(Preview, VideoFramesAreEvenAndOfOneSize) {
  PreviewFrame frame = GreyFrame(41, 31);
  const Image<Rgb8> first = DrawVideoFrame(frame, {.duration_ns = 1000, .key_times_ns = {0, 1000}}, {});
  frame.index = 99999;
  frame.time_ns = 1000;
  frame.kind = FrameKind::kHeld;
  const Image<Rgb8> last =
      DrawVideoFrame(frame, {.duration_ns = 1000, .key_times_ns = {0}}, {.near_m = 10, .far_m = 12});
  EXPECT_EQ(first.width() % 2 + first.height() % 2, 0);
  EXPECT_EQ(last.width(), first.width());
  EXPECT_EQ(last.height(), first.height());
}

TEST(Preview, SheetHasAColumnForEachFrame) {
  std::vector<PreviewFrame> frames;
  frames.push_back(GreyFrame(40, 30));
  const int one = DrawContactSheet(frames, {}).width();
  frames.push_back(GreyFrame(40, 30));
  const int two = DrawContactSheet(frames, {}).width();
  frames.push_back(GreyFrame(40, 30));
  EXPECT_EQ(DrawContactSheet(frames, {}).width() - two, two - one);
}

TEST(PreviewCommand, ShowsAResult) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 64, 48, 20);
  ASSERT_EQ(RunTool({"upsample", scratch / "recording", "-o", scratch / "out", "--method", "linear"}).exit_code, 0);

  const ToolResult sheet = RunTool({"preview", scratch / "out", "-o", scratch / "sheet.png"});
  ASSERT_EQ(sheet.exit_code, 0) << sheet.err;
  EXPECT_THAT(sheet.out, HasSubstr("frames 10 to 18"));
  const auto picture = ReadColor(scratch / "sheet.png");
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_GT(picture->width(), 5 * 300);

  const ToolResult video = RunTool({"preview", scratch / "out", "-o", scratch / "video.mp4"});
  ASSERT_EQ(video.exit_code, 0) << video.err;
  EXPECT_THAT(video.out, HasSubstr("20 frames at 30 per second"));
  EXPECT_TRUE(FileExists(scratch / "video.mp4"));
}

TEST(PreviewCommand, NamesWhatIsWrong) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "recording", 32, 24, 12);
  WriteTinyRecording(scratch / "other", 32, 24, 11);
  ASSERT_EQ(RunTool({"upsample", scratch / "recording", "-o", scratch / "out", "--method", "hold"}).exit_code, 0);
  EXPECT_THAT(RunTool({"preview", scratch / "out", "-o", scratch / "a.gif"}).err,
              HasSubstr("must end in .png or .mp4"));
  EXPECT_THAT(RunTool({"preview", scratch / "out", "-o", scratch / "a.png", "--frame", "12"}).err,
              HasSubstr("the clip has frames 0 to 11"));
  EXPECT_THAT(RunTool({"preview", scratch / "out", "-o", scratch / "a.png", "--sequence", scratch / "other"}).err,
              HasSubstr("was not made from the recording"));
  EXPECT_THAT(RunTool({"preview", scratch / "out", "-o", scratch / "a.png", "--sequence", scratch / "gone"}).err,
              HasSubstr("--sequence"));
}

}  // namespace
}  // namespace depthtween
