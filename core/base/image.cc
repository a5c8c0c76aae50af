#include "core/base/image.h"

#include <new>

#include "tbb/scalable_allocator.h"

namespace depthtween {
namespace {

constexpr size_t kAlignment = 64;
// Kept at most by the whole process: what one interval of 512 x 424 frees and asks for again.
constexpr intptr_t kKept = 64 << 20;

}  // namespace

void* AllocatePixels(size_t bytes) {
  static const int limited = scalable_allocation_mode(TBBMALLOC_SET_SOFT_HEAP_LIMIT, kKept);
  (void)limited;
  void* const pixels = scalable_aligned_malloc(bytes, kAlignment);
  if (pixels == nullptr) throw std::bad_alloc();
  return pixels;
}

void FreePixels(void* pixels) noexcept { scalable_aligned_free(pixels); }

void ReleaseFreedPixels() { scalable_allocation_command(TBBMALLOC_CLEAN_ALL_BUFFERS, nullptr); }

}  // namespace depthtween
