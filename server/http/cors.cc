#include "server/http/cors.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_join.h"

namespace depthtween::server {
namespace {

constexpr size_t kMaxRequestedHeaderBytes = 1024;

// What scripts may read beside the few headers that they always may.
constexpr char kExposedHeaders[] =
    "Content-Disposition, Content-Range, Content-Length, Accept-Ranges, ETag, Location, Retry-After, WWW-Authenticate, "
    "x-request-id, traceparent, grpc-status, grpc-message, grpc-status-details-bin, Tus-Resumable, Tus-Version, "
    "Tus-Extension, "
    "Tus-Max-Size, Tus-Checksum-Algorithm, Upload-Offset, Upload-Length, Upload-Expires, Upload-Metadata";

bool IsAllowedOrigin(const std::vector<std::string>& allowed_origins, const std::string& origin) {
  return std::any_of(allowed_origins.begin(), allowed_origins.end(),
                     [&origin](const std::string& allowed) { return allowed == "*" || allowed == origin; });
}

// A list of header names.
bool IsHeaderList(std::string_view text) {
  return text.size() <= kMaxRequestedHeaderBytes && std::all_of(text.begin(), text.end(), [](char c) {
           return absl::ascii_isalnum(c) || c == '-' || c == '_' || c == ',' || c == ' ';
         });
}

}  // namespace

bool IsOrigin(std::string_view text) {
  if (text == "*") return true;
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (text.substr(0, scheme.size()) != scheme) continue;
    const std::string_view host = text.substr(scheme.size());
    return !host.empty() && std::all_of(host.begin(), host.end(), [](char c) {
      return absl::ascii_isalnum(c) || c == '-' || c == '.' || c == ':' || c == '[' || c == ']';
    });
  }
  return false;
}

HttpHeaders CorsHeaders(const std::vector<std::string>& allowed_origins, const HttpRequest& request) {
  HttpHeaders headers;
  if (allowed_origins.empty()) return headers;
  // Whatever the answer: a cache must not give one origin's answer to another.
  headers.emplace_back("Vary", "Origin");
  const std::optional<std::string> origin = request.Header("Origin");
  if (!origin || !IsAllowedOrigin(allowed_origins, *origin)) return headers;
  headers.emplace_back("Access-Control-Allow-Origin", *origin);
  headers.emplace_back("Access-Control-Expose-Headers", kExposedHeaders);
  return headers;
}

std::optional<HttpResponse> PreflightResponse(const std::vector<std::string>& allowed_origins,
                                              const HttpRequest& request, const std::vector<std::string>& methods) {
  const std::optional<std::string> origin = request.Header("Origin");
  if (request.method != "OPTIONS" || !origin || !request.Header("Access-Control-Request-Method")) return std::nullopt;
  if (!IsAllowedOrigin(allowed_origins, *origin)) return HttpResponse{.status = 403};
  HttpResponse response{.status = 204};
  response.headers.emplace_back("Access-Control-Allow-Methods", absl::StrJoin(methods, ", "));
  const std::optional<std::string> wanted = request.Header("Access-Control-Request-Headers");
  if (wanted && IsHeaderList(*wanted)) response.headers.emplace_back("Access-Control-Allow-Headers", *wanted);
  response.headers.emplace_back("Access-Control-Max-Age", "600");
  return response;
}

bool IsCrossSiteWrite(const std::vector<std::string>& allowed_origins, const HttpRequest& request) {
  if (request.method == "GET" || request.method == "HEAD" || request.method == "OPTIONS") return false;
  const std::optional<std::string> origin = request.Header("Origin");
  if (!origin || IsAllowedOrigin(allowed_origins, *origin)) return false;
  const std::string host = request.Header("Host").value_or("");
  return *origin != "http://" + host && *origin != "https://" + host;
}

bool IsAllowedHost(const std::vector<std::string>& allowed_hosts, const HttpRequest& request) {
  if (allowed_hosts.empty()) return true;
  std::string host = request.Header("Host").value_or("");
  if (host.empty()) return true;  // HTTP/1.0, which no browser speaks
  // "[::1]:8080" has colons before its port.
  const size_t colon = host.find(':', host.front() == '[' ? host.find(']') : 0);
  host = host.substr(0, colon);
  return std::any_of(allowed_hosts.begin(), allowed_hosts.end(),
                     [&host](const std::string& allowed) { return absl::EqualsIgnoreCase(allowed, host); });
}

}  // namespace depthtween::server
