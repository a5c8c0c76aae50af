#include "server/jobs/health_probe.h"

#include <unistd.h>

#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/store/files.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

// A file comes into being and goes again.
absl::Status ProbeFolder(const DataDirectory& directory) {
  const std::string file = directory.TasksFolder() + "/probe";
  absl::Status status = WriteScratchFile(file, "probe\n");
  if (status.ok()) status = SyncFile(file);
  unlink(file.c_str());
  return status;
}

// A full disk, or another process that holds the database, comes to an end.
bool Passes(const absl::Status& status) { return status.ok() || absl::IsResourceExhausted(status); }

}  // namespace

absl::Status ProbeDisk(Store& store, const DataDirectory& directory, const DamageLog& damage) {
  if (damage.Has(kDatabaseName)) return absl::DataLossError("the database is damaged, as the scrub has found");
  if (absl::Status probed = store.Probe(); !Passes(probed)) return probed;
  if (absl::Status probed = ProbeFolder(directory); !Passes(probed)) return probed;
  return absl::OkStatus();
}

HealthProbe::HealthProbe(Store& store, const DataDirectory& directory, const DamageLog& damage, Health& health,
                         absl::Duration gap)
    : store_(store),
      directory_(directory),
      damage_(damage),
      health_(health),
      gap_(gap),
      thread_([this](const std::stop_token& stop) { Work(stop); }) {}

void HealthProbe::Work(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock lock(mutex);
  bool broken = false;
  while (!stop.stop_requested()) {
    const absl::Status status = ProbeDisk(store_, directory_, damage_);
    if (!status.ok() && !broken) {
      LogError("the disk or the database is broken: not ready until it is repaired",
               {{"error", std::string(status.message())}});
    }
    if (status.ok() && broken) LogInfo("disk and database can be written again: ready", {});
    broken = !status.ok();
    health_.Hold("broken", broken);
    woken.wait_for(lock, stop, absl::ToChronoMicroseconds(gap_), [] { return false; });
  }
}

}  // namespace depthtween::server
