// Which files were found damaged or lost, each logged once as an error.
#ifndef DEPTHTWEEN_SERVER_JOBS_DAMAGE_LOG_H_
#define DEPTHTWEEN_SERVER_JOBS_DAMAGE_LOG_H_

#include <cstdint>
#include <mutex>
#include <set>
#include <string>
#include <string_view>

namespace depthtween::server {

// Threads: all methods may be called concurrently.
class DamageLog {
 public:
  // `file` is relative to the data folder, `what` says what is wrong with it.
  void Report(std::string_view file, std::string_view what);
  bool Has(std::string_view file) const;
  // How many different files were reported, up to kMaxFiles.
  int64_t files() const;

 private:
  static constexpr size_t kMaxFiles = 100'000;  // bounds the memory; after a disk has died, more would say nothing new

  mutable std::mutex mutex_;
  std::set<std::string, std::less<>> files_;  // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_DAMAGE_LOG_H_
