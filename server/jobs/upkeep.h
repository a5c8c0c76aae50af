// What a server does for its data folder while it serves: it deletes what it may delete, and reads what it stores again
// and again, slowly, to find damage.
#ifndef DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_
#define DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_

#include <atomic>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

#include "absl/time/time.h"
#include "server/jobs/collector.h"
#include "server/jobs/damage_log.h"
#include "server/store/store.h"

namespace depthtween::server {

struct UpkeepOptions {
  // Every stored file is read once in this time; zero: none is.
  absl::Duration scrub_round = absl::Hours(30 * 24);
  absl::Duration gap = absl::Minutes(10);  // between two looks at what there is to do
};

struct ScrubState {
  bool running = false;
  absl::Time start_time = absl::InfinitePast();  // of the round that runs, or of the last; InfinitePast: none yet
  int64_t files_checked = 0;                     // in it, since the server started
  int64_t damaged_files = 0;                     // found since the server started, in scrubs or else
};

// Works on threads of its own from its creation to its destruction. Borrows all but the options.
// Threads: all methods may be called concurrently.
class Upkeep {
 public:
  Upkeep(Store& store, Collector& collector, DamageLog& damage, std::string data_dir, const UpkeepOptions& options);

  // Begins a round now, unless one runs.
  void StartScrub();
  absl::StatusOr<ScrubState> GetScrub();

  Collector& collector() { return collector_; }

 private:
  void Collect(const std::stop_token& stop);
  // A round that a stop interrupts resumes at the same file.
  void Scrub(const std::stop_token& stop);
  // Until a round is asked for, or for the gap.
  void WaitForRound(const std::stop_token& stop);

  Store& store_;
  Collector& collector_;
  DamageLog& damage_;
  const std::string data_dir_;
  const UpkeepOptions options_;
  std::mutex mutex_;
  std::condition_variable_any round_wanted_changed_;
  bool round_wanted_ = false;              // guarded by mutex_
  std::atomic<int64_t> files_checked_{0};  // in this round
  std::jthread collecting_, scrub_;        // last: they use all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_
