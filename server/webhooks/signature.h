// The signature by which a receiver knows that a webhook is of this server, as Standard Webhooks has it
// (https://www.standardwebhooks.com): HMAC-SHA256 over "id.timestamp.body".
#ifndef DEPTHTWEEN_SERVER_WEBHOOKS_SIGNATURE_H_
#define DEPTHTWEEN_SERVER_WEBHOOKS_SIGNATURE_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"

namespace depthtween::server {

// The secrets of a key file: one "whsec_" and base64 of 24 to 64 bytes a line; lines that are empty or begin with "#"
// say nothing. While a key is replaced there are two, and receivers may know either. InvalidArgument names the line.
absl::StatusOr<std::vector<std::string>> ParseWebhookKeys(std::string_view text);
// Of a file. NotFound, PermissionDenied; InvalidArgument names file and line.
absl::StatusOr<std::vector<std::string>> ReadWebhookKeys(const std::string& file);

// The header webhook-signature: "v1,BASE64" for each key, with blanks between.
std::string SignWebhook(const std::vector<std::string>& keys, std::string_view id, int64_t timestamp_s,
                        std::string_view body);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_WEBHOOKS_SIGNATURE_H_
