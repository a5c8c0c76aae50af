// CRC-32C (Castagnoli), the checksum that depthtween.v1 names beside every piece of data.
//
// It lives with the protocol, header-only, because server and clients share nothing else.
// Source: RFC 3720 appendix B.4; reflected polynomial 0x82F63B78, initial value and final xor 0xFFFFFFFF.
#ifndef DEPTHTWEEN_PROTO_DEPTHTWEEN_CRC32C_H_
#define DEPTHTWEEN_PROTO_DEPTHTWEEN_CRC32C_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>

#ifdef __SSE4_2__
#include <nmmintrin.h>
#endif

namespace depthtween {
namespace crc32c_internal {

constexpr std::array<uint32_t, 256> MakeTable() {
  std::array<uint32_t, 256> table{};
  for (uint32_t i = 0; i < 256; ++i) {
    uint32_t remainder = i;
    for (int bit = 0; bit < 8; ++bit) remainder = (remainder >> 1) ^ ((remainder & 1U) != 0 ? 0x82F63B78U : 0U);
    table[i] = remainder;
  }
  return table;
}

// The plain definition: what processors without the instruction run, and the referee of those that have it.
inline uint32_t ExtendByTable(uint32_t crc, std::string_view bytes) {
  static constexpr std::array<uint32_t, 256> kTable = MakeTable();
  uint32_t state = ~crc;
  for (const char byte : bytes) state = (state >> 8) ^ kTable[(state ^ static_cast<uint8_t>(byte)) & 0xFFU];
  return ~state;
}

}  // namespace crc32c_internal

// The checksum of A followed by `bytes`, where `crc` is the checksum of A (0 for an empty A).
inline uint32_t ExtendCrc32c(uint32_t crc, std::string_view bytes) {
#ifdef __SSE4_2__
  uint64_t state = static_cast<uint32_t>(~crc);
  const char* data = bytes.data();
  size_t left = bytes.size();
  for (; left >= 8; data += 8, left -= 8) {
    uint64_t word;
    std::memcpy(&word, data, 8);
    state = _mm_crc32_u64(state, word);
  }
  for (; left > 0; ++data, --left) {
    state = _mm_crc32_u8(static_cast<uint32_t>(state), static_cast<uint8_t>(*data));
  }
  return ~static_cast<uint32_t>(state);
#else
  return crc32c_internal::ExtendByTable(crc, bytes);
#endif
}

inline uint32_t Crc32c(std::string_view bytes) { return ExtendCrc32c(0, bytes); }

}  // namespace depthtween

#endif  // DEPTHTWEEN_PROTO_DEPTHTWEEN_CRC32C_H_
