// What a server does for its data folder while it serves: it removes recordings whose upload was given up, and reads
// what it stores again and again, slowly, to find damage.
#ifndef DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_
#define DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_

#include <string>
#include <thread>

#include "absl/time/time.h"
#include "server/jobs/damage_log.h"
#include "server/jobs/sequences.h"
#include "server/store/store.h"

namespace depthtween::server {

struct UpkeepOptions {
  // A recording that is still UPLOADING is removed when no byte of it has come for so long; zero: never.
  absl::Duration keep_uploads = absl::Hours(7 * 24);
  // Every stored file is read once in this time; zero: none is.
  absl::Duration scrub_round = absl::Hours(30 * 24);
  absl::Duration gap = absl::Minutes(10);  // between two looks at what there is to do
};

// Works on threads of its own from its creation to its destruction. Borrows all but the options.
class Upkeep {
 public:
  Upkeep(Store& store, Sequences& sequences, DamageLog& damage, std::string data_dir, const UpkeepOptions& options);

 private:
  void ExpireUploads(const std::stop_token& stop);
  // A round that a stop interrupts resumes at the same file.
  void Scrub(const std::stop_token& stop);

  Store& store_;
  Sequences& sequences_;
  DamageLog& damage_;
  const std::string data_dir_;
  const UpkeepOptions options_;
  std::jthread uploads_, scrub_;  // last: they use all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_UPKEEP_H_
