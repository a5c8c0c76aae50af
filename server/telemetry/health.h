// Which services can serve, for the gRPC health service and for probes.
//
// Threads: all methods may be called concurrently.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_HEALTH_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_HEALTH_H_

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace depthtween::server {

class Health {
 public:
  // "" stands for the server as a whole.
  void Set(std::string_view service, bool serving);
  // While any reason is held, nothing serves.
  void Hold(std::string_view reason, bool held = true);
  // Every service that was ever set, and "", no longer serve, for good.
  void StopServing() { Hold("stopping"); }
  // nullopt for a service that was never set.
  std::optional<bool> IsServing(std::string_view service) const;

  // Calls `on_change` after every change, until the returned handle is gone; a call that has begun may outlast it.
  std::shared_ptr<void> Subscribe(std::function<void()> on_change);

 private:
  void Notify();

  mutable std::mutex mutex_;
  std::map<std::string, bool, std::less<>> serving_;               // guarded by mutex_
  std::set<std::string, std::less<>> holds_;                       // guarded by mutex_
  std::vector<std::weak_ptr<std::function<void()>>> subscribers_;  // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_HEALTH_H_
