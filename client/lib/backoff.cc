#include "client/lib/backoff.h"

#include <algorithm>
#include <random>
#include <thread>

namespace depthtween::client {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFirstPause{100};
constexpr milliseconds kLongestPause{3000};
constexpr int kQuietTries = 2;  // of a second or less, as a restart or a busy server takes

// Clients that one restart has cut off must not all come back at the same moment.
double Jitter() {
  thread_local std::minstd_rand generator(std::random_device{}());
  return std::uniform_real_distribution<>(0.8, 1.2)(generator);
}

}  // namespace

bool Backoff::Wait(const absl::Status& why) {
  const auto now = std::chrono::steady_clock::now();
  if (tries_ == 0) first_failure_ = now;
  const auto left = std::chrono::duration_cast<milliseconds>(first_failure_ + patience_ - now);
  if (left <= milliseconds::zero()) return false;
  const milliseconds pause = std::min(kFirstPause * (1 << std::min(tries_, 5)), kLongestPause);
  ++tries_;
  if (tries_ == kQuietTries + 1 && on_away_ && IsTransient(why)) on_away_(why);
  std::this_thread::sleep_for(std::min<std::chrono::duration<double, std::milli>>(pause * Jitter(), left));
  return true;
}

void Backoff::Reset() { tries_ = 0; }

}  // namespace depthtween::client
