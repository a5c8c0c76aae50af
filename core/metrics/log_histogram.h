// Order statistics of a stream in bounded memory: counts and payload sums in bins of equal ratio.
//
// Medians and sorted curves over millions of pixels of a long clip need every value; bins 0.2 % wide need 220 KB. Means
// inside a bin are exact, so a bin that holds one distinct value gives that value back.
// Threads: a value; guard concurrent writes.
#ifndef DEPTHTWEEN_CORE_METRICS_LOG_HISTOGRAM_H_
#define DEPTHTWEEN_CORE_METRICS_LOG_HISTOGRAM_H_

#include <cstdint>
#include <vector>

namespace depthtween {

class LogHistogram {
 public:
  struct Bin {
    int64_t count = 0;
    double key_sum = 0.0;
    double payload_sum = 0.0;
  };

  LogHistogram();

  // key: finite, >= 0. Keys below 2^-24 (60 nm, in metres) share the lowest bin, keys from 2^8 on the highest.
  void Add(float key, double payload);

  int64_t count() const { return count_; }
  // In ascending order of key; empty ones included.
  const std::vector<Bin>& bins() const { return bins_; }

  // The key that a share `quantile` in [0,1] of all keys does not exceed, to within 0.1 %. 0 when empty.
  double Quantile(double quantile) const;
  // The share of keys that are at most `key`, to within 0.1 % of it. 0 when empty.
  double ShareUpTo(float key) const;

 private:
  std::vector<Bin> bins_;
  int64_t count_ = 0;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_LOG_HISTOGRAM_H_
