// One bright square is drawn, and the edges of another place are looked for: where they belong is known.
#include "core/capture/registration_search.h"

#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

constexpr int kWidth = 160, kHeight = 120;

// A picture with a few bright squares, and the edges of their left and upper sides, `off` pixels too far to the right.
Image<Rgb8> Squares(std::vector<DepthEdge>& edges, float off_x, float off_y) {
  Image<Rgb8> color(kWidth, kHeight, {40, 40, 40});
  for (const auto& [left, top] : {std::pair{20, 20}, {80, 24}, {120, 30}, {30, 70}, {75, 80}, {118, 76}}) {
    for (int y = top; y < top + 22; ++y)
      for (int x = left; x < left + 22; ++x) color(x, y) = {200, 190, 180};
    for (int i = 2; i < 20; ++i) {
      const auto along_x = static_cast<float>(left + i) + off_x, along_y = static_cast<float>(top + i) + off_y;
      const float side_x = static_cast<float>(left) - 0.5F + off_x, side_y = static_cast<float>(top) - 0.5F + off_y;
      edges.push_back({.x = side_x, .y = along_y, .normal_x = -1, .near_m = 2});
      edges.push_back({.x = along_x, .y = side_y, .normal_y = -1, .near_m = 2});
    }
  }
  return color;
}

std::vector<EdgeScene> Scene(const Image<Rgb8>& color, const std::vector<DepthEdge>& edges) {
  std::vector<EdgeScene> scenes;
  scenes.emplace_back(color, edges, 1000);
  return scenes;
}

TEST(RegistrationSearch, FindsAShift) {
  std::vector<DepthEdge> edges;
  const Image<Rgb8> color = Squares(edges, 7, -4);
  const RegistrationSearch search = SearchRegistration(Scene(color, edges), 2.0, 1);
  const Flow2 move = search.best.Displacement(kWidth, kHeight, 80, 60, 2);
  EXPECT_NEAR(move.u, -7, 0.6);
  EXPECT_NEAR(move.v, 4, 0.6);
  EXPECT_GT(search.met, 2 * search.met_unmoved);
  EXPECT_GT(MeanVote(Scene(color, edges), search.best), 0.9 * search.met);
}

TEST(RegistrationSearch, LeavesWhatIsRight) {
  std::vector<DepthEdge> edges;
  const Image<Rgb8> color = Squares(edges, 0, 0);
  const RegistrationSearch search = SearchRegistration(Scene(color, edges), 2.0, 1);
  const Flow2 move = search.best.Displacement(kWidth, kHeight, 80, 60, 2);
  EXPECT_NEAR(move.u, 0, 0.6);
  EXPECT_NEAR(move.v, 0, 0.6);
  EXPECT_TRUE(SearchRegistration({}, 2.0, 1).best.IsIdentity()) << "of nothing";
}

// A step across x counts for edges across x alone, and beyond the image nothing is known.
TEST(EdgeScene, VotesForTheDirectionOfAnEdge) {
  Image<Rgb8> color(64, 64);
  for (int y = 0; y < 64; ++y)
    for (int x = 32; x < 64; ++x) color(x, y) = {150, 150, 150};
  const EdgeScene scene(
      color, {{.x = 20, .y = 30, .normal_x = 1, .near_m = 1}, {.x = 20, .y = 30, .normal_y = 1, .near_m = 1}}, 1000);
  EXPECT_GT(scene.Vote(0, 32, 30), 0.8F);
  EXPECT_LT(scene.Vote(0, 20, 30), 0.1F);
  EXPECT_LT(scene.Vote(1, 32, 30), 0.1F);
  EXPECT_EQ(scene.Vote(0, -1, 30), scene.Vote(1, 30, 64));
}

}  // namespace
}  // namespace depthtween
