// Tells watchers of a job every change: a snapshot first, then numbered deltas.
//
// A watcher pulls: the hub tells it that there is news, and it asks for the news when it can. So a slow watcher slows
// nobody, holds no worker and no transaction, and costs a bounded amount of memory: one that falls more than
// kEventsKept behind gets a new snapshot instead of the deltas it missed.
#ifndef DEPTHTWEEN_SERVER_JOBS_WATCH_H_
#define DEPTHTWEEN_SERVER_JOBS_WATCH_H_

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "server/jobs/progress.h"
#include "server/store/records.h"

namespace depthtween::server {

struct JobView {
  JobRecord record;
  Progress progress;
  absl::Time expire_time = absl::InfiniteFuture();  // when the server deletes it; InfiniteFuture: it does not
};

struct JobEvent {
  enum class Kind { kSnapshot, kState, kProgress, kFramesReady };
  int64_t number = 0;        // deltas of a job follow one another without gap
  std::string resume_token;  // Watch with this continues after this event
  Kind kind = Kind::kSnapshot;
  JobView job;          // as of this event, whatever its kind
  int first_frame = 0;  // kFramesReady only: frames that may now be read
  int frame_count = 0;
  std::string render;  // whose pictures they are; empty: depth, uncertainty and provenance
};

class WatchHub;

// One watcher. Destroying it waits for an on_news that is being called, so it must not be destroyed from within one.
class JobWatch {
 public:
  ~JobWatch();
  JobWatch(const JobWatch&) = delete;
  JobWatch& operator=(const JobWatch&) = delete;

  // The next event, or nullopt if there is none yet: then on_news will be called once there is. After an event in which
  // the job has ended nothing follows unless it is retried.
  std::optional<JobEvent> Next();
  // The job was deleted: nothing will follow.
  bool Deleted();

 private:
  friend class WatchHub;
  struct Bell;
  JobWatch(WatchHub& hub, std::string job_id, std::shared_ptr<Bell> bell);

  WatchHub& hub_;
  const std::string job_id_;
  const std::shared_ptr<Bell> bell_;
  int64_t seen_ = 0;                  // number of the last event handed out
  std::optional<JobEvent> snapshot_;  // to be handed out first
};

class WatchHub {
 public:
  static constexpr int kEventsKept = 256;

  WatchHub();
  ~WatchHub();

  // Starts watching. `now` is the job as it stands: the caller makes sure that no Publish of this job runs between
  // reading it and this call. A `resume_token` that is not known (any more) gives a snapshot. `on_news` is called from
  // a thread of the hub that holds no lock; it must return soon, and may call Next.
  std::unique_ptr<JobWatch> Watch(const JobView& now, std::string_view resume_token, std::function<void()> on_news);

  // A change of the job. Calls about one job must be made in the order of the changes.
  void Publish(JobEvent::Kind kind, const JobView& job, int first_frame = 0, int frame_count = 0,
               std::string_view render = {});
  // Of the jobs that were queued when they were last published, have watchers, and stand elsewhere in the queue now:
  // that record, with its new place; no more than `limit`. `places` are those of all queued jobs.
  std::vector<JobRecord> Moved(const std::map<std::string, int, std::less<>>& places, size_t limit);
  // The job is gone: its watchers are told, its events forgotten.
  void Forget(std::string_view job_id);

 private:
  friend class JobWatch;
  // The events of one job. Kept until the job has ended and has no watchers.
  struct Topic {
    int64_t generation = 0;  // tells it from an earlier topic of the same job
    JobView latest;
    int64_t number = 0;           // of the latest event
    std::deque<JobEvent> recent;  // at most kEventsKept
    std::vector<std::shared_ptr<JobWatch::Bell>> bells;
  };
  using Topics = std::map<std::string, Topic, std::less<>>;

  static JobEvent Snapshot(const Topic& topic, std::string token);
  // All of these with mutex_ held.
  std::string Token(const Topic& topic) const;
  Topic& FindTopic(const JobView& job);
  void DropIfIdle(Topics::iterator topic);
  void Ring(const Topic& topic);

  void RingBells(const std::stop_token& stop);

  const std::string epoch_;  // of this process: tokens of another are not known
  std::mutex mutex_;
  Topics topics_;                                         // guarded by mutex_
  int64_t generations_ = 0;                               // guarded by mutex_
  std::vector<std::shared_ptr<JobWatch::Bell>> to_ring_;  // guarded by mutex_
  std::condition_variable_any to_ring_changed_;
  std::jthread ringer_;  // last: it uses all of the above
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_WATCH_H_
