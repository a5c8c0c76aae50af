#include "core/base/utf8.h"

namespace depthtween {

bool IsUtf8(std::string_view text) {
  const auto* p = reinterpret_cast<const unsigned char*>(text.data());
  const auto* const end = p + text.size();
  while (p < end) {
    const unsigned lead = *p++;
    if (lead < 0x80) continue;
    if (lead < 0xC2 || lead > 0xF4) return false;
    const int tail_bytes = lead < 0xE0 ? 1 : lead < 0xF0 ? 2 : 3;
    if (end - p < tail_bytes) return false;
    const unsigned first_low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
    const unsigned first_high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
    if (*p < first_low || *p > first_high) return false;
    for (int i = 1; i < tail_bytes; ++i) {
      if (p[i] < 0x80 || p[i] > 0xBF) return false;
    }
    p += tail_bytes;
  }
  return true;
}

}  // namespace depthtween
