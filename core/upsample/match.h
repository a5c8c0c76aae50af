// How well a pixel of the target frame matches a place in a key's colour frame.
//
// The cost compares colour and half-weighted luma gradient over a window whose pixels count by their likeness to the
// centre in the target (adaptive support weights: the window keeps to the centre's side of an edge). Source: Yoon and
// Kweon, Adaptive Support-Weight Approach for Correspondence Search, PAMI 2006.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_MATCH_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_MATCH_H_

#include <cstddef>

#include "core/base/image.h"

namespace depthtween {

// A colour image as planes for matching: r, g, b (0..255) and the luma's gradients, with a border of repeated edge
// pixels so that a window may hang over the edge.
class MatchImage {
 public:
  static constexpr int kPlanes = 5;
  static constexpr int kBorder = 12;

  MatchImage() = default;
  explicit MatchImage(ImageView<const Rgb8> color);

  int width() const { return width_; }
  int height() const { return height_; }
  // Row y (-kBorder <= y < height + kBorder) of a plane; index 0 is x = 0, valid from -kBorder to width + kBorder - 1.
  const float* row(int plane, int y) const { return planes_.row(y + kBorder) + plane * plane_stride_ + kBorder; }
  // From a value to the same pixel's in the next plane, and to the next row's in the same plane.
  ptrdiff_t plane_stride() const { return plane_stride_; }
  ptrdiff_t row_stride() const { return kPlanes * plane_stride_; }

 private:
  int width_ = 0, height_ = 0;
  ptrdiff_t plane_stride_ = 0;
  Image<float> planes_;  // the planes of a row one after the other: what a window touches lies together
};

// The window around one target pixel, loaded once and compared with many places.
class MatchPatch {
 public:
  static constexpr int kRadius = 2;
  static constexpr int kRows = 2 * kRadius + 1;
  static constexpr int kLanes = 8;  // one vector; lanes past kRows weigh nothing
  // Where nothing matches: a difference counts at most this much (sRGB units).
  static constexpr float kTruncation = 40.0F;

  MatchPatch(const MatchImage& target, int x, int y);

  // Mean weighted difference to the window around (x, y) of `key`, sRGB units in [0, kTruncation]. Bilinear. Places
  // outside the image cost kTruncation. Once the cost is known to exceed `limit`, the sum so far is returned.
  float CostAt(const MatchImage& key, float x, float y, float limit = kTruncation) const;

 private:
  alignas(32) float value_[MatchImage::kPlanes][kRows][kLanes];
  alignas(32) float weight_[kRows][kLanes];  // sums to 1
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_MATCH_H_
