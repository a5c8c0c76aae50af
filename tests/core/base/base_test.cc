// Images, threads and files' errors. Values are known by definition.
#include <atomic>
#include <cerrno>
#include <vector>

#include "core/base/image.h"
#include "core/base/parallel.h"
#include "core/base/status.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

// The pixel convention: the value at an integer coordinate is that pixel's, half-way lies between two.
TEST(SampleBilinear, IntegerCoordinateIsPixelCentre) {
  Image<float> image(3, 2);
  image(1, 0) = 4.0F;
  image(2, 0) = 8.0F;
  EXPECT_EQ(SampleBilinear(image, 1.0F, 0.0F), 4.0F);
  EXPECT_EQ(SampleBilinear(image, 1.5F, 0.0F), 6.0F);
  EXPECT_EQ(SampleBilinear(image, 1.0F, 0.5F), 2.0F);
  EXPECT_EQ(SampleBilinear(image, 99.0F, -5.0F), 8.0F);
}

TEST(Image, MovesWithoutCopyAndLeavesNothing) {
  Image<float> a(4, 4, 1.0F);
  const float* pixels = a.data();
  const Image<float> b = std::move(a);
  EXPECT_EQ(b.data(), pixels);
  EXPECT_TRUE(a.empty());  // NOLINT(bugprone-use-after-move): the emptiness is the promise under test
  EXPECT_EQ(reinterpret_cast<uintptr_t>(b.data()) % 64, 0U);
}

// The memory of an image that was freed may be the next one's: nothing of the old one shows, and rows can be loaded
// whole.
TEST(Image, IsZeroAndAlignedWhateverWasFreedBefore) {
  for (int round = 0; round < 3; ++round) {
    Image<int> image(301, 203);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(image.data()) % 64, 0U);
    for (size_t i = 0; i < image.pixel_count(); ++i) ASSERT_EQ(image.data()[i], 0) << "pixel " << i;
    image.Fill(7 + round);
    const Image<int> copy = image.Clone();
    image.Fill(1);
    for (size_t i = 0; i < copy.pixel_count(); ++i) ASSERT_EQ(copy.data()[i], 7 + round) << "pixel " << i;
  }
  EXPECT_TRUE(Image<int>(0, 5).empty());
}

TEST(ParallelFor, VisitsEveryItemOnce) {
  for (int threads : {1, 2, 5}) {
    std::vector<std::atomic<int>> visits(100);
    ParallelFor(100, threads, [&](int i) { ++visits[i]; });
    for (const auto& v : visits) EXPECT_EQ(v, 1);
  }
}

TEST(ParallelRows, BandsCoverAllRows) {
  std::vector<std::atomic<int>> rows(37);
  ParallelRows(37, 2, [&](int begin, int end) {
    for (int y = begin; y < end; ++y) ++rows[y];
  });
  for (const auto& r : rows) EXPECT_EQ(r, 1);
}

TEST(Status, FullDiskIsResourceExhausted) {
  EXPECT_EQ(ErrnoStatus(ENOSPC, "writing x").code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ErrnoStatus(ENOENT, "opening x").code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(WithContext(absl::DataLossError("bad"), "a.png").message(), "a.png: bad");
  EXPECT_TRUE(WithContext(absl::OkStatus(), "a.png").ok());
}

}  // namespace
}  // namespace depthtween
