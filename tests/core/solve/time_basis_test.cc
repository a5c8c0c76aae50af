// Orthonormality is checked by its definition; what a basis can say, by fitting motions that are known.
#include "core/solve/time_basis.h"

#include <vector>

#include "gtest/gtest.h"

namespace depthtween {
namespace {

double Product(const TimeBasis& basis, int k, int l) {
  double sum = 0;
  for (int s = 0; s < basis.frames(); ++s) sum += static_cast<double>(basis(s, k)) * basis(s, l);
  return sum;
}

TEST(TimeBasis, TrajectoryIsOrthonormalAndHoldsParabolas) {
  const std::vector<float> times = {0.1F, 0.3F, 0.35F, 0.8F, 1.0F};
  const TimeBasis basis = TimeBasis::Trajectory(times);
  ASSERT_EQ(basis.rank(), 2);
  for (int k = 0; k < 2; ++k)
    for (int l = 0; l < 2; ++l) EXPECT_NEAR(Product(basis, k, l), k == l, 1e-5);
  // 3 t - 2 t^2 is 0 at the key, so it lies in the span: its projection gives it back.
  const auto motion = [](double t) { return 3 * t - 2 * t * t; };
  double coefficient[2] = {};
  for (int s = 0; s < 5; ++s)
    for (int k = 0; k < 2; ++k) coefficient[k] += basis(s, k) * motion(times[s]);
  for (int s = 0; s < 5; ++s)
    EXPECT_NEAR(coefficient[0] * basis(s, 0) + coefficient[1] * basis(s, 1), motion(times[s]), 1e-5);
}

TEST(TimeBasis, OneFrameHasRankOne) { EXPECT_EQ(TimeBasis::Trajectory({1.0F}).rank(), 1); }

TEST(TimeBasis, PerFrameIsTheIdentity) {
  const TimeBasis basis = TimeBasis::PerFrame(3);
  for (int s = 0; s < 3; ++s) {
    for (int k = 0; k < 3; ++k) EXPECT_EQ(basis(s, k), s == k);
    EXPECT_EQ(basis.First(s), s);
    EXPECT_EQ(basis.End(s), s + 1);
  }
}

}  // namespace
}  // namespace depthtween
