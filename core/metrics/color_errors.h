// How close a rendered colour image is to the true one: PSNR and SSIM over any set of pixels, pooled over images.
//
// PSNR over the three sRGB channels. SSIM of BT.601 luma, Gaussian window 11 x 11 with sigma 1.5, averaged over the
// pixels asked for. Source: Wang et al., Image quality assessment: from error visibility to structural similarity,
// TIP 2004.
#ifndef DEPTHTWEEN_CORE_METRICS_COLOR_ERRORS_H_
#define DEPTHTWEEN_CORE_METRICS_COLOR_ERRORS_H_

#include <cstdint>

#include "core/base/image.h"

namespace depthtween {

class ColorErrors {
 public:
  // Images of one size; counts the pixels whose mask is not 0, all of them if `mask` is empty.
  void Add(ImageView<const Rgb8> image, ImageView<const Rgb8> truth, ImageView<const uint8_t> mask);
  void Add(const ColorErrors& other);

  int64_t pixels() const { return pixels_; }
  double PsnrDb() const;  // infinite for equal images
  double Ssim() const { return ssim_sum_ / static_cast<double>(pixels_); }

 private:
  int64_t pixels_ = 0;
  double squared_error_sum_ = 0.0;  // over pixels and channels, 8-bit units
  double ssim_sum_ = 0.0;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_COLOR_ERRORS_H_
