// Which web pages may use the server: headers of the Fetch standard's CORS protocol, for origins that are allowed.
#ifndef DEPTHTWEEN_SERVER_HTTP_CORS_H_
#define DEPTHTWEEN_SERVER_HTTP_CORS_H_

#include <optional>
#include <string>
#include <vector>

#include "server/http/exchange.h"

namespace depthtween::server {

// For every answer: none without an Origin, or for one that is not allowed. The allowed ones are compared as text; "*"
// allows all.
HttpHeaders CorsHeaders(const std::vector<std::string>& allowed_origins, const HttpRequest& request);

// The answer to a preflight (OPTIONS with Access-Control-Request-Method) for a path with these methods; nullopt for any
// other request. An origin that is not allowed gets 403.
std::optional<HttpResponse> PreflightResponse(const std::vector<std::string>& allowed_origins,
                                              const HttpRequest& request, const std::vector<std::string>& methods);

// A page of an origin that is neither allowed nor the server's own makes a request that changes something. Browsers
// send some of these without asking first, and a server that asks for no token must not take them.
bool IsCrossSiteWrite(const std::vector<std::string>& allowed_origins, const HttpRequest& request);

// Whether the request's Host, without its port, is one of these; of an empty list every one is. A page whose name leads
// to this machine (DNS rebinding) names its own host, so a server without tokens is safe from it.
bool IsAllowedHost(const std::vector<std::string>& allowed_hosts, const HttpRequest& request);

// Whether it can be the value of an Origin header: "https://example.org", "http://localhost:5173", or "*".
bool IsOrigin(std::string_view text);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_CORS_H_
