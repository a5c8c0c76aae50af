#include "server/webhooks/webhooks.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <cmath>
#include <condition_variable>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/store/error_info.h"
#include "server/telemetry/log.h"
#include "server/webhooks/post.h"
#include "server/webhooks/signature.h"
#include "server/webhooks/webhook_url.h"

namespace depthtween::server {
namespace {

// Of those that are due; more than threads, so that many for one slow host do not hide those for others.
constexpr int kLookAhead = 200;
constexpr size_t kMaxErrorBytes = 500;

void WaitFor(absl::Duration time, const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any woken;
  std::unique_lock lock(mutex);
  woken.wait_for(lock, stop, absl::ToChronoNanoseconds(time), [] { return false; });
}

}  // namespace

absl::StatusOr<std::unique_ptr<Webhooks>> Webhooks::Start(Store& store, Describe describe,
                                                          const WebhookOptions& options) {
  std::vector<std::string> keys;
  if (!options.key_file.empty()) {
    ASSIGN_OR_RETURN(keys, ReadWebhookKeys(options.key_file));
  }
  return std::unique_ptr<Webhooks>(new Webhooks(store, std::move(describe), options, std::move(keys)));
}

Webhooks::Webhooks(Store& store, Describe describe, const WebhookOptions& options, std::vector<std::string> keys)
    : store_(store), describe_(std::move(describe)), options_(options), keys_(std::move(keys)) {
  for (int i = 0; i < (keys_.empty() ? 0 : options_.threads); ++i) {
    threads_.emplace_back([this](const std::stop_token& stop) { Work(stop); });
  }
}

Webhooks::~Webhooks() {
  for (std::jthread& thread : threads_) thread.request_stop();
}

void Webhooks::Work(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const std::optional<DueWebhook> due = Take();
    if (!due) {
      WaitFor(options_.look_every, stop);
      continue;
    }
    // On a full disk it is still due, and would be sent again at once.
    if (!Attempt(*due, stop)) WaitFor(absl::Seconds(10), stop);
    Release(*due);
  }
}

std::optional<DueWebhook> Webhooks::Take() {
  const std::lock_guard lock(mutex_);
  absl::StatusOr<std::vector<DueWebhook>> found = store_.DueWebhooks(absl::Now(), kLookAhead);
  if (!found.ok()) {
    LogWarning("cannot look for webhooks", {{"error", std::string(found.status().message())}});
    return std::nullopt;
  }
  for (DueWebhook& due : *found) {
    const absl::StatusOr<WebhookUrl> url = ParseWebhookUrl(due.url, /*allow_private=*/true);
    int& of_host = hosts_[url.ok() ? url->host : ""];
    if (of_host >= std::max(1, options_.threads / 2) || !busy_.insert(due.event_id).second) continue;
    ++of_host;
    return std::move(due);
  }
  return std::nullopt;
}

void Webhooks::Release(const DueWebhook& due) {
  const absl::StatusOr<WebhookUrl> url = ParseWebhookUrl(due.url, /*allow_private=*/true);
  const std::lock_guard lock(mutex_);
  busy_.erase(due.event_id);
  const auto host = hosts_.find(url.ok() ? url->host : "");
  if (host != hosts_.end() && --host->second == 0) hosts_.erase(host);
}

bool Webhooks::Attempt(const DueWebhook& due, const std::stop_token& stop) {
  WebhookRecord now = {.url = due.url, .state = WebhookState::kSending, .attempts = due.attempts + 1};
  absl::Status sent;
  absl::StatusOr<std::string> body = describe_(due.job_id);
  // What the operator allowed when the job was made counts no longer.
  const absl::StatusOr<WebhookUrl> url = ParseWebhookUrl(due.url, options_.allow_private);
  if (!body.ok()) {
    sent = body.status();
  } else if (!url.ok()) {
    sent = absl::PermissionDeniedError(url.status().message());
  } else {
    const int64_t timestamp_s = absl::ToUnixSeconds(absl::Now());
    sent = PostWebhook(*url,
                       {.event_id = due.event_id,
                        .timestamp_s = timestamp_s,
                        .signature = SignWebhook(keys_, due.event_id, timestamp_s, *body),
                        .body = *body},
                       {.allow_private = options_.allow_private, .time_limit = options_.time_limit}, stop);
  }
  if (absl::IsCancelled(sent)) return true;  // the next start sends it
  if (sent.ok()) {
    now.state = WebhookState::kDelivered;
  } else {
    now.last_error = std::string(sent.message()).substr(0, kMaxErrorBytes);
    const bool over = now.attempts >= options_.max_attempts || absl::IsFailedPrecondition(sent);
    if (over) now.state = WebhookState::kGivenUp;
    if (!over) now.next_time = absl::Now() + PauseAfter(now.attempts);
  }
  const std::string state = now.state == WebhookState::kDelivered ? "delivered"
                            : now.state == WebhookState::kGivenUp ? "given up"
                                                                  : "to be sent again";
  Log(sent.ok() ? LogLevel::kInfo : LogLevel::kWarning, "webhook",
      {{"job", due.job_id},
       {"event", due.event_id},
       {"attempt", absl::StrCat(now.attempts)},
       {"state", state},
       {"error", now.last_error}});
  const absl::Status recorded = store_.RecordWebhook(due.event_id, now);
  // NotFound: the job was deleted or tried again meanwhile.
  if (recorded.ok() || absl::IsNotFound(recorded)) return true;
  LogError("cannot record a webhook", {{"job", due.job_id}, {"error", std::string(recorded.message())}});
  return false;
}

absl::Duration Webhooks::PauseAfter(int attempts) {
  const absl::Duration pause = std::min(options_.first_pause * std::pow(3.0, attempts - 1), options_.longest_pause);
  const std::lock_guard lock(mutex_);
  return pause * std::uniform_real_distribution(0.5, 1.5)(random_);
}

absl::Status CheckWebhook(const WebhookOptions& options, std::string_view url) {
  if (options.key_file.empty()) {
    return WithErrorInfo(absl::FailedPreconditionError(
                             "job.webhook: this server sends no webhooks, because it has no key to sign them with; its "
                             "operator starts it with --webhook-key, or leave the webhook out"),
                         {.reason = "NO_WEBHOOKS"});
  }
  ASSIGN_OR_RETURN(const WebhookUrl parsed, ParseWebhookUrl(url, options.allow_private));
  boost::system::error_code is_name;
  const boost::asio::ip::address address = boost::asio::ip::make_address(parsed.host, is_name);
  if (!is_name && !options.allow_private && !IsPublicAddress(address)) {
    return BadField("job.webhook.url", absl::StrCat("job.webhook.url must name a host of the public internet, and ",
                                                    parsed.host, " is none"));
  }
  return absl::OkStatus();
}

}  // namespace depthtween::server
