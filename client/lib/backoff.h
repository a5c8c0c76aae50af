// How long to keep trying while a server is unreachable, and how long to pause between tries.
#ifndef DEPTHTWEEN_CLIENT_LIB_BACKOFF_H_
#define DEPTHTWEEN_CLIENT_LIB_BACKOFF_H_

#include <chrono>
#include <functional>
#include <utility>

#include "client/lib/status.h"

namespace depthtween::client {

// How often bytes may arrive damaged in a row before it is an error: such a connection does not recover by itself.
inline constexpr int kDamagedTries = 3;

// Grammar of use:  (Wait | Reset)*  - Wait after every failed try, Reset whenever something has got through.
class Backoff {
 public:
  // `on_away` is called once in each absence longer than a moment, with why the last try failed; may be empty.
  explicit Backoff(std::chrono::milliseconds patience, std::function<void(const absl::Status&)> on_away = nullptr)
      : patience_(patience), on_away_(std::move(on_away)) {}

  // Pauses: 0.1 s at first, twice as long each time, at most 3 s. `why` the try failed. Returns false at once when
  // `patience` has passed since the first failure after the last success.
  bool Wait(const absl::Status& why);
  void Reset();

 private:
  const std::chrono::milliseconds patience_;
  const std::function<void(const absl::Status&)> on_away_;
  std::chrono::steady_clock::time_point first_failure_{};  // meaningless while tries_ is 0
  int tries_ = 0;
};

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_BACKOFF_H_
