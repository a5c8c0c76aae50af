#include "server/webhooks/webhook_url.h"

#include <algorithm>
#include <array>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

absl::Status BadUrl(std::string_view rule) {
  return BadField("job.webhook.url", absl::StrCat("job.webhook.url must ", View(rule)));
}

struct Range4 {
  uint32_t first;
  int bits;
};
constexpr uint32_t Ip4(uint32_t a, uint32_t b, uint32_t c, uint32_t d) { return a << 24 | b << 16 | c << 8 | d; }
// IANA's registry of special-purpose addresses, and multicast.
constexpr std::array kNotPublic4 = {
    Range4{Ip4(0, 0, 0, 0), 8},      Range4{Ip4(10, 0, 0, 0), 8},     Range4{Ip4(100, 64, 0, 0), 10},
    Range4{Ip4(127, 0, 0, 0), 8},    Range4{Ip4(169, 254, 0, 0), 16}, Range4{Ip4(172, 16, 0, 0), 12},
    Range4{Ip4(192, 0, 0, 0), 24},   Range4{Ip4(192, 0, 2, 0), 24},   Range4{Ip4(192, 88, 99, 0), 24},
    Range4{Ip4(192, 168, 0, 0), 16}, Range4{Ip4(198, 18, 0, 0), 15},  Range4{Ip4(198, 51, 100, 0), 24},
    Range4{Ip4(203, 0, 113, 0), 24}, Range4{Ip4(224, 0, 0, 0), 4},    Range4{Ip4(240, 0, 0, 0), 4},
};

}  // namespace

absl::StatusOr<WebhookUrl> ParseWebhookUrl(std::string_view url, bool allow_private) {
  if (url.size() > kMaxWebhookUrlBytes) {
    return BadUrl(absl::StrCat("have at most ", kMaxWebhookUrlBytes, " bytes, and has ", url.size()));
  }
  // A blank or a line break would end the request line that it becomes part of.
  if (!std::all_of(url.begin(), url.end(), [](char c) { return c > ' ' && c < 0x7F && c != '\\' && c != '"'; })) {
    return BadUrl("be of printable ASCII characters; write others as %XX");
  }
  WebhookUrl parsed;
  absl::string_view rest(url.data(), url.size());
  if (absl::ConsumePrefix(&rest, "http://")) {
    if (!allow_private) return BadUrl("begin with https://; this server sends nothing in clear");
    parsed.tls = false;
  } else if (!absl::ConsumePrefix(&rest, "https://")) {
    return BadUrl("begin with https://");
  }
  if (absl::StrContains(rest, "#")) return BadUrl("have no fragment (\"#...\")");
  const size_t authority_end = std::min(rest.find_first_of("/?"), rest.size());
  const absl::string_view authority = rest.substr(0, authority_end);
  if (absl::StrContains(authority, "@")) return BadUrl("have no user or password; the signature tells who sends it");
  parsed.authority = std::string(authority);
  const absl::string_view target = rest.substr(authority_end);
  parsed.target = absl::StrCat(absl::StartsWith(target, "/") ? "" : "/", target);

  absl::string_view host = authority, port;
  if (absl::StartsWith(authority, "[")) {
    const size_t end = authority.find(']');
    if (end == absl::string_view::npos) return BadUrl("close the bracket of its address");
    host = authority.substr(1, end - 1);
    port = authority.substr(end + 1);
  } else {
    host = authority.substr(0, authority.find(':'));
    port = authority.substr(host.size());
  }
  if (host.empty()) return BadUrl("name a host");
  uint32_t number = parsed.tls ? 443 : 80;
  if (!port.empty() && (!absl::ConsumePrefix(&port, ":") || port.empty() || !absl::SimpleAtoi(port, &number) ||
                        number < 1 || number > 65535)) {
    return BadUrl("have a port from 1 to 65535, or none");
  }
  parsed.host = std::string(host);
  parsed.port = absl::StrCat(number);
  return parsed;
}

bool IsPublicAddress(const boost::asio::ip::address& address) {
  if (address.is_v4()) {
    const uint32_t number = address.to_v4().to_uint();
    return std::none_of(kNotPublic4.begin(), kNotPublic4.end(),
                        [number](const Range4& range) { return (number ^ range.first) >> (32 - range.bits) == 0; });
  }
  // Of IPv6 only global unicast (2000::/3), without Teredo (2001::/32), 6to4 (2002::/16) and documentation
  // (2001:db8::/32, 3fff::/20). Mapped and translated IPv4 addresses lie elsewhere.
  const auto bytes = address.to_v6().to_bytes();
  const uint32_t front = Ip4(bytes[0], bytes[1], bytes[2], bytes[3]);
  return front >> 29 == 1 && front != 0x20010000 && front != 0x20010DB8 && front >> 16 != 0x2002 &&
         front >> 12 != 0x3FFF0;
}

}  // namespace depthtween::server
