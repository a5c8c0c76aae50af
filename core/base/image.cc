#include "core/base/image.h"

#include <cstdlib>
#include <new>

#include "tbb/scalable_allocator.h"

// Sanitizers must see every allocation for itself.
#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define DEPTHTWEEN_FREE_AT_ONCE
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define DEPTHTWEEN_FREE_AT_ONCE
#endif

namespace depthtween {
namespace {

constexpr size_t kAlignment = 64;
// Limit for the whole process: what one interval of 512 x 424 frees and allocates again.
constexpr intptr_t kKept = 64 << 20;

}  // namespace

#ifdef DEPTHTWEEN_FREE_AT_ONCE

void* AllocatePixels(size_t bytes) {
  void* const pixels = std::aligned_alloc(kAlignment, (bytes + kAlignment - 1) / kAlignment * kAlignment);
  if (pixels == nullptr) throw std::bad_alloc();
  return pixels;
}
void FreePixels(void* pixels) noexcept { std::free(pixels); }

#else

void* AllocatePixels(size_t bytes) {
  static const int limited = scalable_allocation_mode(TBBMALLOC_SET_SOFT_HEAP_LIMIT, kKept);
  (void)limited;
  void* const pixels = scalable_aligned_malloc(bytes, kAlignment);
  if (pixels == nullptr) throw std::bad_alloc();
  return pixels;
}
void FreePixels(void* pixels) noexcept { scalable_aligned_free(pixels); }

#endif

}  // namespace depthtween
