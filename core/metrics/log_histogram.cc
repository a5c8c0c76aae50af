#include "core/metrics/log_histogram.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>

namespace depthtween {
namespace {

// A float's exponent and its first 9 mantissa bits are its bin: 512 bins an octave.
constexpr int kDroppedBits = 23 - 9;
constexpr uint32_t kLowest = std::bit_cast<uint32_t>(0x1p-24F) >> kDroppedBits;
constexpr uint32_t kHighest = std::bit_cast<uint32_t>(0x1p+8F) >> kDroppedBits;

size_t BinOf(float key) {
  const uint32_t bits = std::bit_cast<uint32_t>(std::abs(key)) >> kDroppedBits;  // abs: -0 has a sign bit
  return std::clamp(bits, kLowest, kHighest) - kLowest;
}

}  // namespace

LogHistogram::LogHistogram() : bins_(kHighest - kLowest + 1) {}

void LogHistogram::Add(float key, double payload) {
  assert(std::isfinite(key) && key >= 0.0F);
  Bin& bin = bins_[BinOf(key)];
  ++bin.count;
  bin.key_sum += key;
  bin.payload_sum += payload;
  ++count_;
}

double LogHistogram::Quantile(double quantile) const {
  if (count_ == 0) return 0.0;
  const double rank = quantile * static_cast<double>(count_);
  int64_t seen = 0;
  for (const Bin& bin : bins_) {
    seen += bin.count;
    if (bin.count > 0 && static_cast<double>(seen) >= rank) return bin.key_sum / static_cast<double>(bin.count);
  }
  return 0.0;
}

double LogHistogram::ShareUpTo(float key) const {
  if (count_ == 0) return 0.0;
  int64_t seen = 0;
  for (size_t bin = 0; bin <= BinOf(key); ++bin) seen += bins_[bin].count;
  return static_cast<double>(seen) / static_cast<double>(count_);
}

}  // namespace depthtween
