// Tells receivers of jobs that have ended: each job that asks for it is POSTed as JSON to its address, signed, again
// and again until it is taken.
//
// What is to be sent stands in the store, recorded in the transaction that ended the job, so that nothing is forgotten
// when the server dies. A receiver may get the same event twice, with the same id. Attempts: at once, then after 2 s, 6
// s, 18 s and so on, two hours at most, each pause between half of that and one and a half; 20 in all, which takes
// about a day.
#ifndef DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOKS_H_
#define DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOKS_H_

#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <random>
#include <set>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/store/store.h"

namespace depthtween::server {

struct WebhookOptions {
  std::string key_file;        // see signature.h; empty: no job may ask for a webhook
  bool allow_private = false;  // also addresses that are not public, and http://
  int threads = 4;             // posts at the same time; of one host half as many
  int max_attempts = 20;
  absl::Duration time_limit = absl::Seconds(15);  // of one post
  absl::Duration first_pause = absl::Seconds(2);
  absl::Duration longest_pause = absl::Hours(2);
  absl::Duration look_every = absl::Milliseconds(500);  // into the store
};

class Webhooks {
 public:
  // The body of the post for a job. NotFound: it has been deleted.
  using Describe = std::function<absl::StatusOr<std::string>(std::string_view job_id)>;

  // Works on threads of its own until it is destroyed; without a key file there are none. Borrows `store`, and what
  // `describe` does. InvalidArgument, NotFound, PermissionDenied: the key file.
  static absl::StatusOr<std::unique_ptr<Webhooks>> Start(Store& store, Describe describe,
                                                         const WebhookOptions& options);
  ~Webhooks();
  Webhooks(const Webhooks&) = delete;
  Webhooks& operator=(const Webhooks&) = delete;

 private:
  Webhooks(Store& store, Describe describe, const WebhookOptions& options, std::vector<std::string> keys);

  void Work(const std::stop_token& stop);
  // One that is due and that nobody is at; its host is then held until Release.
  std::optional<DueWebhook> Take();
  void Release(const DueWebhook& due);
  // Sends it once and records how that went. False when it could not be recorded.
  bool Attempt(const DueWebhook& due, const std::stop_token& stop);
  absl::Duration PauseAfter(int attempts);

  Store& store_;
  const Describe describe_;
  const WebhookOptions options_;
  const std::vector<std::string> keys_;
  std::mutex mutex_;
  std::set<std::string> busy_;                       // guarded by mutex_; event ids
  std::map<std::string, int> hosts_;                 // guarded by mutex_; posts under way
  std::minstd_rand random_{std::random_device{}()};  // guarded by mutex_
  std::vector<std::jthread> threads_;                // last: they use all of the above
};

// Whether a job may name this address; `options` are those of the server. FailedPrecondition (NO_WEBHOOKS) without a
// key file; InvalidArgument as ParseWebhookUrl. An address that is not public is refused when it is written as such; a
// name is looked up when it is used.
absl::Status CheckWebhook(const WebhookOptions& options, std::string_view url);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOKS_H_
