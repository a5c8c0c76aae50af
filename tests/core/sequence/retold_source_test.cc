// A source of two images, retold with later stamps and without its second depth frame.
#include "core/sequence/retold_source.h"

#include <gtest/gtest.h>

#include <utility>

namespace depthtween {
namespace {

TEST(RetoldSource, HasTheImagesOfTheSourceAndItsOwnList) {
  Sequence sequence;
  sequence.color = {{0, "a"}, {10, "b"}};
  sequence.depth = {{0, "c"}, {10, "d"}};
  std::vector<Image<Rgb8>> color;
  color.emplace_back(2, 1, Rgb8{1, 2, 3});
  color.emplace_back(2, 1, Rgb8{4, 5, 6});
  std::vector<Image<float>> depth;
  depth.emplace_back(2, 1, 1.5F);
  depth.emplace_back(2, 1, 2.5F);
  const MemorySource source(sequence, std::move(color), std::move(depth));
  sequence.depth.resize(1);
  sequence.depth[0].time_ns = 7;
  const RetoldSource retold(source, sequence);
  ASSERT_EQ(retold.sequence().depth.size(), 1U);
  EXPECT_EQ(retold.sequence().depth[0].time_ns, 7);
  EXPECT_EQ(retold.sequence().color[1].time_ns, 10);
  EXPECT_EQ((*retold.Color(1))(1, 0).g, 5);
  EXPECT_EQ((*retold.Depth(0))(1, 0), 1.5F);
}

}  // namespace
}  // namespace depthtween
