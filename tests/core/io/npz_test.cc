// Archives: what is written must be read; one comes from NumPy; halves follow IEEE 754's formula.
#include "core/io/npz.h"

#include <gtest/gtest.h>
// rapidcheck needs gtest before it.
#include <rapidcheck/gtest.h>

#include <cmath>
#include <limits>

#include "absl/strings/escaping.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::_;
using testing::ElementsAre;
using testing::HasSubstr;

Npz SomeArrays() {
  Npz arrays;
  arrays["sf"] =
      NpyArray::FromFloats({2, 2, 3}, {0, 1, -2, 0.5F, 65504, 1e-7F, 3, 4, 5, 6, 7, 8}, ElementType::kFloat16);
  arrays["valid"] = {.type = ElementType::kBool, .shape = {2, 2}, .bytes = std::string("\1\0\1\1", 4)};
  arrays["one"] = NpyArray::FromFloats({}, {2.5F}, ElementType::kFloat32);
  arrays["line"] = NpyArray::FromFloats({3}, {1, 2, 3}, ElementType::kFloat32);
  arrays["none"] = {.type = ElementType::kFloat64, .shape = {0, 5}, .bytes = ""};
  return arrays;
}

std::string Patched(std::string bytes, const std::string& from, const std::string& to) {
  const size_t at = bytes.find(from);
  EXPECT_NE(at, std::string::npos);
  return bytes.replace(at, from.size(), to);
}

TEST(Npz, RoundTripsStoredAndDeflated) {
  for (const auto compression : {NpzCompression::kStored, NpzCompression::kFast, NpzCompression::kDeflated}) {
    const Npz arrays = SomeArrays();
    const auto decoded = DecodeNpz(*EncodeNpz(arrays, compression));
    ASSERT_THAT(decoded, IsOk());
    ASSERT_EQ(decoded->size(), arrays.size());
    for (const auto& [name, array] : arrays) {
      const NpyArray& back = decoded->at(name);
      EXPECT_EQ(back.type, array.type) << name;
      EXPECT_EQ(back.shape, array.shape) << name;
      EXPECT_EQ(back.bytes, array.bytes) << name;
    }
  }
}

// numpy.savez_compressed(f, a=np.array([[1, 2.5]], '<f2'), b=np.arange(3, dtype='<i4')) of NumPy 1.24, which streams:
// sizes in its local headers are left open.
constexpr char kNumpyFile[] =
    "UEsDBC0AAAAIAAAAIQDZLoYf//////////8FABQAYS5ucHkBABAAhAAAAAAAAABKAAAAAAAAAJvsF+obEMnIUMZQrZ6SWpxcpG6l"
    "oG6TZqSuo6Cell9UUpSYF59flJIKEndLzClOBYoXZyQWpAL5GoY6CkaaOgq1CmQDLgYbBkcAUEsDBC0AAAAIAAAAIQAC7L2p////"
    "//////8FABQAYi5ucHkBABAAjAAAAAAAAABMAAAAAAAAAJvsF+obEMnIUMZQrZ6SWpxcpG6loG6TaaKuo6Cell9UUpSYF59flJIK"
    "EndLzClOBYoXZyQWpAL5GsY6mjoKtQoUAC4GIGAEYiYgBgBQSwECLQMtAAAACAAAACEA2S6GH0oAAACEAAAABQAAAAAAAAAAAAAA"
    "gAEAAAAAYS5ucHlQSwECLQMtAAAACAAAACEAAuy9qUwAAACMAAAABQAAAAAAAAAAAAAAgAGBAAAAYi5ucHlQSwUGAAAAAAIAAgBm"
    "AAAABAEAAAAA";

TEST(Npz, ReadsWhatNumpyWrites) {
  std::string bytes;
  ASSERT_TRUE(absl::Base64Unescape(kNumpyFile, &bytes));
  const auto arrays = DecodeNpz(bytes);
  ASSERT_THAT(arrays, IsOk());
  EXPECT_THAT(arrays->at("a").shape, ElementsAre(1, 2));
  EXPECT_EQ(arrays->at("a").type, ElementType::kFloat16);
  EXPECT_THAT(arrays->at("a").ToFloats(), ElementsAre(1.0F, 2.5F));
  EXPECT_THAT(arrays->at("b").ToFloats(), ElementsAre(0.0F, 1.0F, 2.0F));
}

// The definition of IEEE 754 half precision, computed with ldexp instead of bits.
TEST(Npz, EveryHalfIsItsFormula) {
  for (int bits = 0; bits < 65536; ++bits) {
    const int exponent = (bits >> 10) & 31, mantissa = bits & 1023;
    const auto half = static_cast<uint16_t>(bits);
    if (exponent == 31 && mantissa != 0) {
      EXPECT_TRUE(std::isnan(HalfToFloat(half)));
      EXPECT_TRUE(std::isnan(HalfToFloat(FloatToHalf(HalfToFloat(half)))));
      continue;
    }
    const double magnitude = exponent == 31  ? std::numeric_limits<double>::infinity()
                             : exponent == 0 ? std::ldexp(mantissa, -24)
                                             : std::ldexp(1024 + mantissa, exponent - 25);
    const double expected = bits >= 0x8000 ? -magnitude : magnitude;
    ASSERT_EQ(HalfToFloat(half), expected) << bits;
    ASSERT_EQ(FloatToHalf(HalfToFloat(half)), half) << bits;
  }
}

// Nearest among all halves, and the even one half-way: compared with the two neighbours.
RC_GTEST_PROP(Npz, ToHalfRoundsToNearestEven, ()) {
  const int bits = *rc::gen::inRange(0, 0x7BFF);  // non-negative, below the largest
  const double low = HalfToFloat(static_cast<uint16_t>(bits)), high = HalfToFloat(static_cast<uint16_t>(bits + 1));
  const double share = *rc::gen::inRange(0, 4097) / 4096.0;
  const uint16_t half = FloatToHalf(static_cast<float>(low + share * (high - low)));
  const int expected = share < 0.5 ? bits : share > 0.5 ? bits + 1 : bits + (bits & 1);
  RC_ASSERT(half == expected);
}

TEST(Npz, HalfOverflowsToInfinity) {
  EXPECT_EQ(FloatToHalf(65504.0F), 0x7BFF);
  EXPECT_EQ(FloatToHalf(65519.0F), 0x7BFF);
  EXPECT_EQ(FloatToHalf(65520.0F), 0x7C00);
  EXPECT_EQ(FloatToHalf(-1e30F), 0xFC00);
  EXPECT_EQ(FloatToHalf(1e-30F), 0);
  EXPECT_EQ(FloatToHalf(-0.0F), 0x8000);
}

TEST(Npz, NamesEveryTruncation) {
  const std::string file = *EncodeNpz(SomeArrays());
  for (size_t size = 0; size < file.size(); ++size)
    EXPECT_THAT(DecodeNpz(std::string_view(file).substr(0, size)), HasStatus(StatusCode::kDataLoss, _)) << size;
}

// Changed data fail the checksum; changed structure fails somewhere; nothing crashes.
TEST(Npz, ChangedDataFailsTheChecksum) {
  std::string file =
      *EncodeNpz({{"x", NpyArray::FromFloats({1}, {1.0F}, ElementType::kFloat32)}}, NpzCompression::kStored);
  const size_t last_data_byte = file.find("PK\x01\x02") - 1;
  file[last_data_byte] ^= 1;
  EXPECT_THAT(DecodeNpz(file), HasStatus(StatusCode::kDataLoss, HasSubstr("checksum")));
}

RC_GTEST_PROP(Npz, AnyChangedByteIsRefusedOrHarmless, ()) {
  std::string file = *EncodeNpz(SomeArrays());
  const int at = *rc::gen::inRange<int>(0, static_cast<int>(file.size()));
  file[at] = *rc::gen::arbitrary<char>();
  const auto decoded = DecodeNpz(file);
  if (decoded.ok()) {
    for (const auto& [name, array] : *decoded)
      RC_ASSERT(static_cast<size_t>(array.element_count()) * ElementBytes(array.type) == array.bytes.size());
  }
}

// The directory says what is unpacked; a liar is caught before the memory is taken.
TEST(Npz, RefusesBombs) {
  Npz arrays;
  arrays["zeros"] = {.type = ElementType::kUint8, .shape = {1 << 20}, .bytes = std::string(1 << 20, '\0')};
  const std::string file = *EncodeNpz(arrays);
  EXPECT_THAT(DecodeNpz(file, {.max_bytes = 1 << 19}), HasStatus(StatusCode::kResourceExhausted, HasSubstr("524288")));
  EXPECT_THAT(DecodeNpz(file, {.max_arrays = 0}), HasStatus(StatusCode::kResourceExhausted, HasSubstr("1 arrays")));
  std::string liar = file;
  liar.replace(file.find("PK\x01\x02") + 24, 4, "\xff\xff\xff\x3f");  // a gibibyte out of a kilobyte
  EXPECT_THAT(DecodeNpz(liar), HasStatus(StatusCode::kDataLoss, HasSubstr("cannot unpack")));
}

TEST(Npz, RefusesWhatItDoesNotRead) {
  const std::string file =
      *EncodeNpz({{"x", NpyArray::FromFloats({2, 1}, {1, 2}, ElementType::kFloat32)}}, NpzCompression::kStored);
  const auto with_checksum = [](std::string zip) {
    const size_t local_data = 30 + 5, directory = zip.find("PK\x01\x02");
    const auto crc = static_cast<uint32_t>(
        crc32(0, reinterpret_cast<const Bytef*>(zip.data() + local_data), static_cast<uInt>(directory - local_data)));
    return zip.replace(directory + 16, 4, std::string(reinterpret_cast<const char*>(&crc), 4));
  };
  EXPECT_THAT(DecodeNpz(with_checksum(Patched(file, "<f4", ">f4"))),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("'>f4'")));
  EXPECT_THAT(DecodeNpz(with_checksum(Patched(file, "False", "True "))),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("Fortran")));
  EXPECT_THAT(DecodeNpz(with_checksum(Patched(file, "(2, 1)", "(9, 9)"))),
              HasStatus(StatusCode::kDataLoss, HasSubstr("shape")));
  EXPECT_THAT(DecodeNpz(with_checksum(Patched(file, "'descr'", "'descx'"))),
              HasStatus(StatusCode::kDataLoss, HasSubstr("header")));
  EXPECT_THAT(DecodeNpz("PK but not a zip, long enough to hold an end record"),
              HasStatus(StatusCode::kDataLoss, HasSubstr("npz")));
  EXPECT_THAT(EncodeNpz({{"x", {.type = ElementType::kInt32, .shape = {2}, .bytes = "abc"}}}),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("3 bytes")));
}

}  // namespace
}  // namespace depthtween
