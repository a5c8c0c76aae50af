// Any bytes as an npz: a status, or arrays whose bytes are of their shape and which are written and read to themselves.
#include "core/io/npz.h"

#include <cstdlib>

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto arrays = DecodeNpz({reinterpret_cast<const char*>(data), size}, {.max_bytes = 1 << 20, .max_arrays = 16});
  if (!arrays.ok()) return 0;
  for (const auto& [name, array] : *arrays) {
    if (array.ToFloats().size() != static_cast<size_t>(array.element_count())) std::abort();
  }
  const auto again = DecodeNpz(*EncodeNpz(*arrays));
  if (!again.ok() || again->size() != arrays->size()) std::abort();
  return 0;
}
