// What the tests of core/io share: a PNG writer that is not the one under test, pixels, files.
#ifndef DEPTHTWEEN_TESTS_CORE_IO_IO_FIXTURES_H_
#define DEPTHTWEEN_TESTS_CORE_IO_IO_FIXTURES_H_

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/geometry/camera.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace depthtween {

template <typename T>
testing::AssertionResult SamePixels(ImageView<const T> a, ImageView<const T> b) {
  if (!a.SameSize(b)) return testing::AssertionFailure() << "sizes differ";
  for (int y = 0; y < a.height(); ++y) {
    for (int x = 0; x < a.width(); ++x) {
      if (!(a(x, y) == b(x, y))) return testing::AssertionFailure() << "pixel (" << x << ", " << y << ") differs";
    }
  }
  return testing::AssertionSuccess();
}
template <typename T>
testing::AssertionResult SamePixels(const Image<T>& a, const Image<T>& b) {
  return SamePixels<T>(a.view(), b.view());
}

// Every value of T's bytes turns up, in no simple pattern.
template <typename T>
Image<T> NoisyImage(int width, int height, uint32_t seed = 1) {
  Image<T> image(width, height);
  auto* bytes = reinterpret_cast<uint8_t*>(image.data());
  for (size_t i = 0; i < image.pixel_count() * sizeof(T); ++i) {
    seed = seed * 1664525U + 1013904223U;
    bytes[i] = static_cast<uint8_t>(seed >> 24);
  }
  return image;
}

inline void Put(const std::string& path, std::string_view bytes) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

inline std::string Get(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// ---- a PNG, chunk by chunk (RFC 2083) ----

inline std::string BigEndian(uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16), static_cast<char>(value >> 8),
          static_cast<char>(value)};
}

inline std::string PngChunk(const std::string& type, const std::string& data) {
  const std::string body = type + data;
  const auto crc = crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
  return BigEndian(static_cast<uint32_t>(data.size())) + body + BigEndian(static_cast<uint32_t>(crc));
}

inline std::string PngHeader(uint32_t width, uint32_t height, int bit_depth, int color_type) {
  const std::string data = BigEndian(width) + BigEndian(height) + static_cast<char>(bit_depth) +
                           static_cast<char>(color_type) + std::string(3, '\0');
  return std::string("\x89PNG\r\n\x1a\n", 8) + PngChunk("IHDR", data);
}

// `rows` with each row's filter byte. `between` stands before the pixels: PLTE, tRNS.
inline std::string PngFile(uint32_t width, uint32_t height, int bit_depth, int color_type, const std::string& rows,
                           const std::string& between = "") {
  std::string packed(compressBound(rows.size()), '\0');
  uLongf size = packed.size();
  compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(rows.data()), rows.size());
  packed.resize(size);
  return PngHeader(width, height, bit_depth, color_type) + between + PngChunk("IDAT", packed) + PngChunk("IEND", "");
}

inline Camera SmallCamera() { return {.width = 8, .height = 6, .fx = 7.5, .fy = 7.25, .cx = 3.5, .cy = 2.5}; }

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_IO_IO_FIXTURES_H_
