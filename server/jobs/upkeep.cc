#include "server/jobs/upkeep.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/jobs/scrub.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr int kScrubPage = 64;  // files between two records of how far it is
// A small folder is done soon; a large one gets the speed that its round needs.
constexpr int64_t kLeastScrubBytesPerSecond = 1 << 20;

void Sleep(absl::Duration time, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock lock(mutex);
  woken.wait_for(lock, stop, absl::ToChronoMicroseconds(time), [] { return false; });
}

// Reads of this thread wait for those of everybody else. Linux has no declaration of this call.
void BeLastAtTheDisk() {
  constexpr int kWhoProcess = 1, kClassIdle = 3, kClassShift = 13;
  syscall(SYS_ioprio_set, kWhoProcess, 0, kClassIdle << kClassShift);
}

std::string Text(const absl::Status& status) { return std::string(status.message()); }

}  // namespace

Upkeep::Upkeep(Store& store, Sequences& sequences, DamageLog& damage, std::string data_dir,
               const UpkeepOptions& options)
    : store_(store), sequences_(sequences), damage_(damage), data_dir_(std::move(data_dir)), options_(options) {
  if (options_.keep_uploads > absl::ZeroDuration()) {
    uploads_ = std::jthread([this](const std::stop_token& stop) { ExpireUploads(stop); });
  }
  if (options_.scrub_round > absl::ZeroDuration()) {
    scrub_ = std::jthread([this](const std::stop_token& stop) { Scrub(stop); });
  }
}

void Upkeep::ExpireUploads(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const absl::StatusOr<std::vector<std::string>> removed =
        sequences_.RemoveAbandoned(absl::Now() - options_.keep_uploads);
    if (!removed.ok()) LogWarning("cannot remove abandoned uploads", {{"error", Text(removed.status())}});
    for (const std::string& id : removed.ok() ? *removed : std::vector<std::string>()) {
      LogInfo("abandoned upload removed",
              {{"sequence", id}, {"no_byte_for", absl::FormatDuration(options_.keep_uploads)}});
    }
    Sleep(options_.gap, stop);
  }
}

void Upkeep::Scrub(const std::stop_token& stop) {
  BeLastAtTheDisk();
  ScrubSummary found;
  while (!stop.stop_requested()) {
    absl::StatusOr<ScrubRecord> at = store_.GetScrub();
    absl::Status failed = at.status();
    if (at.ok() && at->over) {
      if (absl::Now() < at->start_time + options_.scrub_round) {
        Sleep(options_.gap, stop);
        continue;
      }
      *at = {.start_time = absl::Now(), .over = false};
      found = {};
    }
    const absl::StatusOr<int64_t> bytes = store_.StoredBytes();
    // Twice as fast as the round needs, so that a restart and what is added meanwhile do not make it late.
    const auto needed = static_cast<int64_t>(2.0 * static_cast<double>(bytes.value_or(0)) /
                                             absl::ToDoubleSeconds(options_.scrub_round));
    while (failed.ok() && !at->over && !stop.stop_requested()) {
      absl::StatusOr<std::string> next = ScrubSome(store_, data_dir_, at->cursor, kScrubPage,
                                                   std::max(needed, kLeastScrubBytesPerSecond), stop, found);
      for (const FileFault& fault : std::exchange(found.faults, {})) damage_.Report(fault.path, fault.what);
      failed = next.status();
      if (!next.ok()) break;
      at->over = next->empty();
      at->cursor = *std::move(next);
      failed = store_.SetScrub(*at);
    }
    if (stop.stop_requested()) return;
    if (!failed.ok()) {
      LogWarning("cannot check stored files", {{"error", Text(failed)}});
      Sleep(options_.gap, stop);
    } else {
      LogInfo("stored files checked", {{"files", absl::StrCat(found.files)},
                                       {"bytes", absl::StrCat(found.bytes)},
                                       {"without_checksum", absl::StrCat(found.unknown_files)},
                                       {"damaged_so_far", absl::StrCat(damage_.files())}});
    }
  }
}

}  // namespace depthtween::server
