// One POST of a webhook.
#ifndef DEPTHTWEEN_SERVER_WEBHOOKS_POST_H_
#define DEPTHTWEEN_SERVER_WEBHOOKS_POST_H_

#include <cstdint>
#include <stop_token>
#include <string>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/webhooks/webhook_url.h"

namespace depthtween::server {

struct WebhookPost {
  std::string event_id;
  int64_t timestamp_s = 0;
  std::string signature;
  std::string body;  // JSON
};

struct PostOptions {
  bool allow_private = false;
  absl::Duration time_limit = absl::Seconds(15);  // from the name's lookup to the answer's head
};

// Resolves the host, connects to one of the addresses that IsPublicAddress allows, speaks TLS with a certificate that
// the system's authorities (or those of SSL_CERT_FILE) vouch for, and reads the head of the answer. Follows no redirect
// and reads no body. OK when the answer is 2xx. Errors, in words for the job's owner: FailedPrecondition when the
// receiver wants no more of it (410 Gone); PermissionDenied for an address that is not public; Cancelled when `stop`
// fires; else Unavailable. Threads: may be called concurrently; blocks.
absl::Status PostWebhook(const WebhookUrl& url, const WebhookPost& post, const PostOptions& options,
                         const std::stop_token& stop);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_WEBHOOKS_POST_H_
