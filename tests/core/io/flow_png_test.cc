// KITTI's flow PNG against the formula of its development kit.
#include "core/io/flow_png.h"

#include <limits>

#include "core/io/png.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

// The KITTI development kit's formula, by hand: u = (32768 + 64 * 1.5 - 32768) / 64.
TEST(FlowPng, StoresAsKittiDoes) {
  Image<Flow2> flow(2, 1);
  flow(0, 0) = {1.5F, -2.25F};
  const Image<uint8_t> valid(2, 1, 1);
  const auto stored = DecodePngRgb16(*EncodeFlowPng(flow, valid));
  ASSERT_THAT(stored, IsOk());
  EXPECT_TRUE(((*stored)(0, 0) == Rgb16{32768 + 96, 32768 - 144, 1}));
  EXPECT_TRUE(((*stored)(1, 0) == Rgb16{32768, 32768, 1}));
}

// Multiples of 1/64 px are exact; everything else is off by half of that at most.
TEST(FlowPng, RoundTripsToASixtyFourthPixel) {
  Image<Flow2> flow(40, 3);
  Image<uint8_t> valid(40, 3, 1);
  for (int x = 0; x < 40; ++x) {
    flow(x, 0) = {static_cast<float>(x) / 64.0F, static_cast<float>(-x) / 64.0F};
    flow(x, 1) = {static_cast<float>(x) * 12.7F, -3.3F};
    valid(x, 2) = 0;
  }
  const TemporaryFolder folder;
  ASSERT_THAT(WriteFlowPng(folder / "flow.png", flow, valid), IsOk());
  const auto field = ReadFlowPng(folder / "flow.png");
  ASSERT_THAT(field, IsOk());
  EXPECT_TRUE(SamePixels(field->valid, valid));
  for (int x = 0; x < 40; ++x) {
    EXPECT_TRUE(field->flow(x, 0) == flow(x, 0));
    EXPECT_NEAR(field->flow(x, 1).u, flow(x, 1).u, 1.0F / 128);
    EXPECT_NEAR(field->flow(x, 1).v, flow(x, 1).v, 1.0F / 128);
    EXPECT_TRUE((field->flow(x, 2) == Flow2{0, 0}));
  }
}

TEST(FlowPng, WhatDoesNotFitIsNotValid) {
  Image<Flow2> flow(3, 1);
  flow(0, 0) = {600.0F, 0.0F};
  flow(1, 0) = {0.0F, -600.0F};
  flow(2, 0) = {std::numeric_limits<float>::quiet_NaN(), 0.0F};
  const auto field = DecodeFlowPng(*EncodeFlowPng(flow, Image<uint8_t>(3, 1, 1)));
  ASSERT_THAT(field, IsOk());
  EXPECT_TRUE(SamePixels(field->valid, Image<uint8_t>(3, 1, 0)));
}

TEST(FlowPng, RefusesOtherFiles) {
  EXPECT_THAT(EncodeFlowPng(Image<Flow2>(2, 1), Image<uint8_t>(1, 1)),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("one size")));
  EXPECT_THAT(DecodeFlowPng(*EncodePng16(Image<uint16_t>(2, 2))),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("must be 16-bit RGB")));
}

}  // namespace
}  // namespace depthtween
