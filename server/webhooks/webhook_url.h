// Where a webhook may go: which addresses clients may name, and which of those that a name resolves to are used.
//
// A client that names an address lets the server speak for it, from where the server stands: behind firewalls, beside
// databases and the metadata service of a cloud. So it may reach the public internet alone, unless the operator says
// otherwise.
#ifndef DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOK_URL_H_
#define DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOK_URL_H_

#include <boost/asio/ip/address.hpp>
#include <string>
#include <string_view>

#include "core/base/status.h"

namespace depthtween::server {

inline constexpr size_t kMaxWebhookUrlBytes = 2000;

struct WebhookUrl {
  bool tls = true;
  std::string host;  // a name or an address, without brackets
  std::string port;
  std::string authority;  // as the Host header has it
  std::string target;     // path and query
};

// InvalidArgument (BAD_FIELD job.webhook.url): at most kMaxWebhookUrlBytes of plain characters; https://, and with
// `allow_private` http:// too; a host; neither user nor fragment.
absl::StatusOr<WebhookUrl> ParseWebhookUrl(std::string_view url, bool allow_private);

// Whether the address is one of the public internet: no loopback, private, link-local, shared or reserved one, no
// multicast, and none that leads to such a one through a translation.
bool IsPublicAddress(const boost::asio::ip::address& address);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_WEBHOOKS_WEBHOOK_URL_H_
