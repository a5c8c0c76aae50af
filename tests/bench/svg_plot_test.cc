// Plots as text. Places are counted by hand.
#include "tests/bench/svg_plot.h"

#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::Pointwise;

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

// Truth: counted by hand.
TEST(Ticks, AreRoundAndInside) {
  EXPECT_THAT(LinearTicks(0, 10, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(LinearTicks(-1.1, 2.3, 4), ElementsAre(-1, 0, 1, 2));
  EXPECT_THAT(LinearTicks(0, 0.3, 3), Pointwise(DoubleNear(1e-12), {0.0, 0.1, 0.2, 0.3}));
  EXPECT_THAT(LogarithmicTicks(0.5, 2000), Pointwise(DoubleNear(1e-9), {1.0, 10.0, 100.0, 1000.0}));
  EXPECT_THAT(LogarithmicTicks(2, 30), Pointwise(DoubleNear(1e-9), {2.0, 5.0, 10.0, 20.0}));
}

// A line from (1,1) to (100,100) on logarithmic axes is the diagonal, so its middle point lies in the middle.
TEST(DrawSvg, PlacesPointsOnLogarithmicAxes) {
  const LinePlot plot{.title = "t",
                      .x = {.title = "x", .logarithmic = true},
                      .y = {.title = "y", .logarithmic = true},
                      .series = {{.name = "a", .points = {{1, 1}, {10, 10}, {100, 100}}}}};
  const std::string svg = DrawSvg(plot);
  const size_t begin = svg.find("points=\"");
  ASSERT_NE(begin, std::string::npos);
  double x[3], y[3];
  ASSERT_EQ(
      std::sscanf(svg.c_str() + begin, "points=\"%lf,%lf %lf,%lf %lf,%lf", &x[0], &y[0], &x[1], &y[1], &x[2], &y[2]),
      6);
  EXPECT_NEAR(x[1], (x[0] + x[2]) / 2, 0.11);
  EXPECT_NEAR(y[1], (y[0] + y[2]) / 2, 0.11);
  EXPECT_LT(x[0], x[2]);
  EXPECT_GT(y[0], y[2]);  // SVG counts rows downwards
}

// What an axis cannot show must not become a coordinate, and text must not become markup.
TEST(DrawSvg, LeavesOutWhatCannotBeShownAndEscapesText) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const LinePlot plot{.title = "a < b & c",
                      .x = {.title = "x", .logarithmic = true},
                      .y = {.title = "y"},
                      .series = {{.name = "s", .points = {{0, 1}, {-1, 2}, {1, nan}, {2, 3}}, .marked = true}}};
  const std::string svg = DrawSvg(plot);
  EXPECT_THAT(svg, HasSubstr("a &lt; b &amp; c"));
  EXPECT_EQ(Count(svg, "<circle"), 1U);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(DrawSvg, SaysSoWhenThereIsNothing) {
  EXPECT_THAT(DrawSvg(LinePlot{.title = "t"}), HasSubstr("nothing was measured"));
  EXPECT_THAT(DrawSvg(BarPlot{.title = "t"}), HasSubstr("nothing was measured"));
}

// Two groups of two series are four bars, beside two swatches of the legend, the ground and the frame.
TEST(DrawSvg, DrawsABarForEachValue) {
  const BarPlot plot{.title = "t", .y_title = "y", .groups = {"one", "two"}, .series = {{"a", {1, -2}}, {"b", {3, 4}}}};
  EXPECT_EQ(Count(DrawSvg(plot), "<rect"), 4U + 2U + 1U + 1U);
}

}  // namespace
}  // namespace depthtween
