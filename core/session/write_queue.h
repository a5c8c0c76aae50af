// Lets frames be encoded and written while the next ones are computed.
#ifndef DEPTHTWEEN_CORE_SESSION_WRITE_QUEUE_H_
#define DEPTHTWEEN_CORE_SESSION_WRITE_QUEUE_H_

#include <deque>
#include <functional>
#include <future>
#include <utility>

#include "core/base/status.h"

namespace depthtween {

// Add* Finish  - at most `limit` (>= 1) frames are in flight, which bounds memory; with 1 they are written one after
// the other, beside the caller. Frames are told of in the order they came, on the calling thread. Destroying it waits.
class WriteQueue {
 public:
  WriteQueue(int limit, std::function<void(int frame)> on_written)
      : limit_(static_cast<size_t>(limit)), on_written_(std::move(on_written)) {}

  // Waits while the queue is full; the error may be an earlier frame's. `write` need not be copyable.
  template <typename Write>
  absl::Status Add(int frame, Write write) {
    if (in_flight_.size() == limit_) RETURN_IF_ERROR(AwaitFirst());
    in_flight_.emplace_back(frame, std::async(std::launch::async, std::move(write)));
    return absl::OkStatus();
  }

  absl::Status Finish() {
    while (!in_flight_.empty()) RETURN_IF_ERROR(AwaitFirst());
    return absl::OkStatus();
  }

 private:
  absl::Status AwaitFirst() {
    const int frame = in_flight_.front().first;
    absl::Status written = in_flight_.front().second.get();
    in_flight_.pop_front();
    if (written.ok()) on_written_(frame);
    return written;
  }

  const size_t limit_;
  const std::function<void(int)> on_written_;
  std::deque<std::pair<int, std::future<absl::Status>>> in_flight_;  // futures of std::async wait when destroyed
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_WRITE_QUEUE_H_
