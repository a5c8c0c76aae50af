#include "server/jobs/watch.h"

#include <algorithm>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace depthtween::server {

// What the hub and a watcher share. Both hold it, so that neither has to outlive the calls of the other.
struct JobWatch::Bell {
  std::mutex mutex;
  std::function<void()> on_news;  // guarded by mutex, which is held while it is called; empty once the watcher is gone
  bool queued = false;            // guarded by the hub's mutex
  bool deleted = false;           // guarded by the hub's mutex
};

JobWatch::JobWatch(WatchHub& hub, std::string job_id, std::shared_ptr<Bell> bell)
    : hub_(hub), job_id_(std::move(job_id)), bell_(std::move(bell)) {}

JobWatch::~JobWatch() {
  {
    const std::lock_guard lock(bell_->mutex);
    bell_->on_news = nullptr;
  }
  const std::lock_guard lock(hub_.mutex_);
  const auto topic = hub_.topics_.find(job_id_);
  if (topic == hub_.topics_.end()) return;
  std::erase(topic->second.bells, bell_);
  hub_.DropIfIdle(topic);
}

std::optional<JobEvent> JobWatch::Next() {
  const std::lock_guard lock(hub_.mutex_);
  if (snapshot_) return std::exchange(snapshot_, std::nullopt);
  const auto found = hub_.topics_.find(job_id_);
  if (found == hub_.topics_.end() || bell_->deleted) return std::nullopt;
  const WatchHub::Topic& topic = found->second;
  if (seen_ == topic.number) return std::nullopt;
  const int64_t oldest = topic.number - static_cast<int64_t>(topic.recent.size()) + 1;
  if (seen_ + 1 < oldest) {
    seen_ = topic.number;
    return WatchHub::Snapshot(topic, hub_.Token(topic));
  }
  ++seen_;
  return topic.recent[static_cast<size_t>(seen_ - oldest)];
}

bool JobWatch::Deleted() {
  const std::lock_guard lock(hub_.mutex_);
  return bell_->deleted;
}

WatchHub::WatchHub()
    : epoch_(absl::StrCat(absl::Hex(absl::ToUnixNanos(absl::Now())))),
      ringer_([this](const std::stop_token& stop) { RingBells(stop); }) {}

WatchHub::~WatchHub() {
  ringer_.request_stop();
  ringer_.join();
}

std::string WatchHub::Token(const Topic& topic) const {
  return absl::StrCat(epoch_, "-", topic.generation, "-", topic.number);
}

JobEvent WatchHub::Snapshot(const Topic& topic, std::string token) {
  return {
      .number = topic.number, .resume_token = std::move(token), .kind = JobEvent::Kind::kSnapshot, .job = topic.latest};
}

WatchHub::Topic& WatchHub::FindTopic(const JobView& job) {
  const auto [topic, is_new] = topics_.try_emplace(job.record.id);
  if (is_new) topic->second.generation = ++generations_;
  topic->second.latest = job;
  return topic->second;
}

void WatchHub::DropIfIdle(Topics::iterator topic) {
  if (topic->second.bells.empty() && HasEnded(topic->second.latest.record.state)) topics_.erase(topic);
}

std::unique_ptr<JobWatch> WatchHub::Watch(const JobView& now, std::string_view resume_token,
                                          std::function<void()> on_news) {
  auto bell = std::make_shared<JobWatch::Bell>();
  bell->on_news = std::move(on_news);
  std::unique_ptr<JobWatch> watch(new JobWatch(*this, now.record.id, bell));
  const std::lock_guard lock(mutex_);
  Topic& topic = FindTopic(now);
  topic.bells.push_back(std::move(bell));
  watch->seen_ = topic.number;
  absl::string_view token(resume_token.data(), resume_token.size());
  int64_t seen = 0;
  if (absl::ConsumePrefix(&token, absl::StrCat(epoch_, "-", topic.generation, "-")) && absl::SimpleAtoi(token, &seen) &&
      seen <= topic.number && seen >= topic.number - static_cast<int64_t>(topic.recent.size())) {
    watch->seen_ = seen;
  } else {
    watch->snapshot_ = Snapshot(topic, Token(topic));
  }
  return watch;
}

void WatchHub::Publish(JobEvent::Kind kind, const JobView& job, int first_frame, int frame_count,
                       std::string_view render) {
  const std::lock_guard lock(mutex_);
  Topic& topic = FindTopic(job);
  ++topic.number;
  topic.recent.push_back({.number = topic.number,
                          .resume_token = Token(topic),
                          .kind = kind,
                          .job = job,
                          .first_frame = first_frame,
                          .frame_count = frame_count,
                          .render = std::string(render)});
  if (topic.recent.size() > kEventsKept) topic.recent.pop_front();
  Ring(topic);
  DropIfIdle(topics_.find(job.record.id));
}

std::vector<JobRecord> WatchHub::Moved(const std::map<std::string, int, std::less<>>& places, size_t limit) {
  const std::lock_guard lock(mutex_);
  std::vector<JobRecord> moved;
  for (const auto& [id, topic] : topics_) {
    if (topic.bells.empty() || topic.latest.record.state != JobState::kQueued) continue;
    const auto place = places.find(id);
    if (place == places.end() || topic.latest.record.queue_position == place->second) continue;
    moved.push_back(topic.latest.record);
    moved.back().queue_position = place->second;
    if (moved.size() >= limit) break;
  }
  return moved;
}

void WatchHub::Forget(std::string_view job_id) {
  const std::lock_guard lock(mutex_);
  const auto topic = topics_.find(job_id);
  if (topic == topics_.end()) return;
  for (const auto& bell : topic->second.bells) bell->deleted = true;
  Ring(topic->second);
  topics_.erase(topic);
}

void WatchHub::Ring(const Topic& topic) {
  for (const auto& bell : topic.bells) {
    if (std::exchange(bell->queued, true)) continue;
    to_ring_.push_back(bell);
  }
  to_ring_changed_.notify_one();
}

void WatchHub::RingBells(const std::stop_token& stop) {
  while (true) {
    std::vector<std::shared_ptr<JobWatch::Bell>> bells;
    {
      std::unique_lock lock(mutex_);
      if (!to_ring_changed_.wait(lock, stop, [this] { return !to_ring_.empty(); })) return;
      bells.swap(to_ring_);
      for (const auto& bell : bells) bell->queued = false;
    }
    for (const auto& bell : bells) {
      const std::lock_guard lock(bell->mutex);
      if (bell->on_news) bell->on_news();
    }
  }
}

}  // namespace depthtween::server
