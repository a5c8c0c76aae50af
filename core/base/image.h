// Image owns pixels; ImageView borrows them and is passed by value.
//
// The pixel convention of the whole project: x right, y down, the integer coordinate (x, y) is the centre of a pixel,
// so an image covers [-0.5, width-0.5) x [-0.5, height-0.5). Depth images are float metres along z with 0 = unknown.
// Colour images are 8-bit sRGB. No image holds NaN.
//
// Threads: an Image is a value; concurrent reads are safe, and so are writes to different pixels.
#ifndef DEPTHTWEEN_CORE_BASE_IMAGE_H_
#define DEPTHTWEEN_CORE_BASE_IMAGE_H_

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <type_traits>
#include <utility>

namespace depthtween {

// One 8-bit sRGB pixel, in file order.
struct Rgb8 {
  uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb8& a, const Rgb8& c) { return a.r == c.r && a.g == c.g && a.b == c.b; }
};

// Displacement in pixels, x right, y down.
struct Flow2 {
  float u = 0.0F, v = 0.0F;
  friend bool operator==(const Flow2& a, const Flow2& b) { return a.u == b.u && a.v == b.v; }
};

// Borrowed pixels: T* with a row stride counted in elements. Cheap to copy. Valid while the owner lives.
template <typename T>
class ImageView {
 public:
  ImageView() = default;
  ImageView(T* data, int width, int height, ptrdiff_t stride)
      : data_(data), stride_(stride), width_(width), height_(height) {}
  // ImageView<T> converts to ImageView<const T>.
  template <typename U, typename = std::enable_if_t<std::is_same<const U, T>::value>>
  ImageView(ImageView<U> other)  // NOLINT(google-explicit-constructor)
      : ImageView(other.data(), other.width(), other.height(), other.stride()) {}

  int width() const { return width_; }
  int height() const { return height_; }
  ptrdiff_t stride() const { return stride_; }
  bool empty() const { return width_ == 0 || height_ == 0; }
  size_t pixel_count() const { return static_cast<size_t>(width_) * static_cast<size_t>(height_); }
  T* data() const { return data_; }
  T* row(int y) const {
    assert(y >= 0 && y < height_);
    return data_ + y * stride_;
  }
  T& operator()(int x, int y) const {
    assert(Contains(x, y));
    return data_[y * stride_ + x];
  }
  bool Contains(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_; }
  // The nearest pixel inside the image.
  T& Clamped(int x, int y) const { return (*this)(std::clamp(x, 0, width_ - 1), std::clamp(y, 0, height_ - 1)); }
  template <typename U>
  bool SameSize(const ImageView<U>& other) const {
    return width_ == other.width() && height_ == other.height();
  }

 private:
  T* data_ = nullptr;
  ptrdiff_t stride_ = 0;
  int width_ = 0, height_ = 0;
};

// Memory for pixels, 64-byte aligned. Freed memory is kept for the next image, up to a limit for the process: a fresh
// page from the system costs as much as computing on it. Throws std::bad_alloc.
void* AllocatePixels(size_t bytes);
void FreePixels(void* pixels) noexcept;

// Owned pixels: contiguous (stride == width), 64-byte aligned, move-only (Clone() copies, visibly).
template <typename T>
class Image {
  static_assert(std::is_trivially_copyable<T>::value, "pixels are plain data");

 public:
  Image() = default;
  // All pixels value-initialised (zero).
  Image(int width, int height) : Image(width, height, T{}) {}
  Image(int width, int height, T fill) : Image(width, height, Unfilled{}) {
    std::uninitialized_fill_n(data_.get(), pixel_count(), fill);
  }
  Image(Image&& other) noexcept { *this = std::move(other); }
  Image& operator=(Image&& other) noexcept {
    data_ = std::move(other.data_);
    width_ = std::exchange(other.width_, 0);
    height_ = std::exchange(other.height_, 0);
    return *this;
  }
  Image(const Image&) = delete;
  Image& operator=(const Image&) = delete;

  Image Clone() const {
    Image copy(width_, height_, Unfilled{});
    std::uninitialized_copy_n(data_.get(), pixel_count(), copy.data_.get());
    return copy;
  }
  void Fill(T value) { std::fill_n(data_.get(), pixel_count(), value); }

  int width() const { return width_; }
  int height() const { return height_; }
  bool empty() const { return data_ == nullptr; }
  size_t pixel_count() const { return static_cast<size_t>(width_) * static_cast<size_t>(height_); }
  T* data() { return data_.get(); }
  const T* data() const { return data_.get(); }
  T* row(int y) { return view().row(y); }
  const T* row(int y) const { return view().row(y); }
  T& operator()(int x, int y) { return view()(x, y); }
  const T& operator()(int x, int y) const { return view()(x, y); }
  bool Contains(int x, int y) const { return view().Contains(x, y); }

  ImageView<T> view() { return {data_.get(), width_, height_, width_}; }
  ImageView<const T> view() const { return {data_.get(), width_, height_, width_}; }
  operator ImageView<T>() { return view(); }              // NOLINT(google-explicit-constructor)
  operator ImageView<const T>() const { return view(); }  // NOLINT(google-explicit-constructor)

 private:
  struct Unfilled {};
  Image(int width, int height, Unfilled) : width_(width), height_(height) {
    assert(width >= 0 && height >= 0);
    if (pixel_count() > 0) data_.reset(static_cast<T*>(AllocatePixels(pixel_count() * sizeof(T))));
  }

  struct Free {
    void operator()(T* pixels) const { FreePixels(pixels); }
  };
  std::unique_ptr<T, Free> data_;
  int width_ = 0, height_ = 0;
};

// Value at a sub-pixel position, coordinates clamped to the image.
inline float SampleBilinear(ImageView<const float> image, float x, float y) {
  x = std::clamp(x, 0.0F, static_cast<float>(image.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(image.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width() - 1), y1 = std::min(y0 + 1, image.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const float top = image(x0, y0) * (1 - ax) + image(x1, y0) * ax;
  const float bottom = image(x0, y1) * (1 - ax) + image(x1, y1) * ax;
  return top * (1 - ay) + bottom * ay;
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_IMAGE_H_
