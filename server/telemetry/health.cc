#include "server/telemetry/health.h"

#include <utility>

namespace depthtween::server {

void Health::Set(std::string_view service, bool serving) {
  {
    const std::lock_guard lock(mutex_);
    serving_.insert_or_assign(std::string(service), serving);
  }
  Notify();
}

void Health::Hold(std::string_view reason, bool held) {
  {
    const std::lock_guard lock(mutex_);
    serving_.try_emplace("", false);
    if (!(held ? holds_.insert(std::string(reason)).second : holds_.erase(std::string(reason)) > 0)) return;
  }
  Notify();
}

std::optional<bool> Health::IsServing(std::string_view service) const {
  const std::lock_guard lock(mutex_);
  const auto found = serving_.find(service);
  if (found == serving_.end()) return std::nullopt;
  return found->second && holds_.empty();
}

std::shared_ptr<void> Health::Subscribe(std::function<void()> on_change) {
  auto subscriber = std::make_shared<std::function<void()>>(std::move(on_change));
  const std::lock_guard lock(mutex_);
  std::erase_if(subscribers_, [](const auto& other) { return other.expired(); });
  subscribers_.push_back(subscriber);
  return subscriber;
}

void Health::Notify() {
  std::vector<std::shared_ptr<std::function<void()>>> subscribers;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& weak : subscribers_) {
      if (auto subscriber = weak.lock()) subscribers.push_back(std::move(subscriber));
    }
  }
  // Without the lock: a subscriber may ask what has changed.
  for (const auto& subscriber : subscribers) (*subscriber)();
}

}  // namespace depthtween::server
