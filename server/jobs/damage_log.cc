#include "server/jobs/damage_log.h"

#include "server/telemetry/log.h"

namespace depthtween::server {

void DamageLog::Report(std::string_view file, std::string_view what) {
  {
    const std::lock_guard lock(mutex_);
    if (files_.size() >= kMaxFiles || !files_.emplace(file).second) return;
  }
  LogError("file damaged", {{"file", std::string(file)}, {"what", std::string(what)}});
}

bool DamageLog::Has(std::string_view file) const {
  const std::lock_guard lock(mutex_);
  return files_.find(file) != files_.end();
}

int64_t DamageLog::files() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int64_t>(files_.size());
}

}  // namespace depthtween::server
