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
#include "server/store/data_directory.h"
#include "server/store/sqlite_store.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr int kScrubPage = 64;  // files between two records of how far it is
// A small folder is done soon; a large one gets the speed that its round needs.
constexpr int64_t kLeastScrubBytesPerSecond = 1 << 20;
// How long a round takes that is asked for where none come by themselves.
constexpr absl::Duration kRoundWithoutSchedule = absl::Hours(24);

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

Upkeep::Upkeep(Store& store, Collector& collector, DamageLog& damage, std::string data_dir,
               const UpkeepOptions& options)
    : store_(store), collector_(collector), damage_(damage), data_dir_(std::move(data_dir)), options_(options) {
  collecting_ = std::jthread([this](const std::stop_token& stop) { Collect(stop); });
  scrub_ = std::jthread([this](const std::stop_token& stop) { Scrub(stop); });
}

void Upkeep::Collect(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const absl::Status collected = collector_.Collect(/*dry_run=*/false).status();
    if (!collected.ok()) LogWarning("cannot collect garbage", {{"error", Text(collected)}});
    Sleep(options_.gap, stop);
  }
}

void Upkeep::StartScrub() {
  {
    const std::lock_guard lock(mutex_);
    round_wanted_ = true;
  }
  round_wanted_changed_.notify_all();
}

absl::StatusOr<ScrubState> Upkeep::GetScrub() {
  ASSIGN_OR_RETURN(const ScrubRecord record, store_.GetScrub());
  const std::lock_guard lock(mutex_);
  return ScrubState{.running = !record.over || round_wanted_,
                    .start_time = record.start_time,
                    .files_checked = files_checked_,
                    .damaged_files = damage_.files()};
}

void Upkeep::WaitForRound(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  round_wanted_changed_.wait_for(lock, stop, absl::ToChronoMicroseconds(options_.gap),
                                 [this] { return round_wanted_; });
}

void Upkeep::Scrub(const std::stop_token& stop) {
  BeLastAtTheDisk();
  ScrubSummary found;
  while (!stop.stop_requested()) {
    absl::StatusOr<ScrubRecord> at = store_.GetScrub();
    absl::Status failed = at.status();
    if (at.ok() && at->over) {
      const bool due =
          options_.scrub_round > absl::ZeroDuration() && absl::Now() >= at->start_time + options_.scrub_round;
      bool wanted = false;
      {
        const std::lock_guard lock(mutex_);
        wanted = round_wanted_;
      }
      if (!due && !wanted) {
        WaitForRound(stop);
        continue;
      }
      *at = {.start_time = absl::Now(), .over = false};
      failed = store_.SetScrub(*at);
      found = {};
      files_checked_ = 0;
      if (failed.ok()) {
        const std::lock_guard lock(mutex_);
        round_wanted_ = false;
      }
      const absl::Status database = CheckSqliteFile(absl::StrCat(data_dir_, "/", kDatabaseName));
      if (absl::IsDataLoss(database)) damage_.Report(kDatabaseName, Text(database));
    }
    const absl::StatusOr<int64_t> bytes = store_.StoredBytes();
    // Twice as fast as the round needs, so that a restart and what is added meanwhile do not make it late.
    const double round_s = absl::ToDoubleSeconds(options_.scrub_round > absl::ZeroDuration() ? options_.scrub_round
                                                                                             : kRoundWithoutSchedule);
    const auto needed = static_cast<int64_t>(2.0 * static_cast<double>(bytes.value_or(0)) / round_s);
    while (failed.ok() && !at->over && !stop.stop_requested()) {
      absl::StatusOr<std::string> next = ScrubSome(store_, data_dir_, at->cursor, kScrubPage,
                                                   std::max(needed, kLeastScrubBytesPerSecond), stop, found);
      for (const FileFault& fault : std::exchange(found.faults, {})) damage_.Report(fault.path, fault.what);
      files_checked_ = found.files;
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
