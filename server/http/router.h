// Which handler answers a request: path templates as google.api.http has them.
//
//   Template = "/" Segments [ ":" Verb ]      Segment  = "*" | LITERAL | Variable
//   Segments = Segment { "/" Segment }        Variable = "{" FieldPath [ "=" Segments ] "}"
//
// "*" is any one segment, "{name}" is "{name=*}". A verb belongs to the last segment; a template without one matches no
// segment that has a ":", so that a mistyped verb is not taken for a name. "/" alone is the root.
#ifndef DEPTHTWEEN_SERVER_HTTP_ROUTER_H_
#define DEPTHTWEEN_SERVER_HTTP_ROUTER_H_

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/status.h"
#include "server/http/exchange.h"

namespace depthtween::server {

class PathTemplate {
 public:
  // InvalidArgument: not a template.
  static absl::StatusOr<PathTemplate> Parse(std::string_view text);

  // The values of the variables, or nullopt.
  std::optional<std::map<std::string, std::string>> Match(const std::vector<std::string>& segments) const;

  // As it was given.
  const std::string& text() const { return text_; }
  // Names of the variables, in order.
  std::vector<std::string> variables() const;
  // For people and for OpenAPI: each variable's stars named, "/v1/jobs/{job}:cancel" for "/v1/{name=jobs/*}:cancel".
  std::string Readable() const;
  // The names that Readable() gives to the stars, in order.
  std::vector<std::string> StarNames() const;

 private:
  struct Segment {
    std::string literal;  // empty: any
  };
  struct Variable {
    std::string field;
    size_t begin = 0, end = 0;  // its segments
  };

  absl::Status ParseSegments(std::string_view text);

  std::string text_;
  std::vector<Segment> segments_;
  std::vector<Variable> variables_;
  std::string verb_;
};

class Router {
 public:
  struct Found {
    const HttpHandler* handler = nullptr;
    const std::string* path = nullptr;  // of the route's template: a name of the route with few values
    std::map<std::string, std::string> path_values;
  };

  // A path may be added once for each method. Earlier routes win. A template that is none ends the program: routes are
  // written by us.
  void Add(std::string_view method, std::string_view path, HttpHandler handler);

  // nullopt: no route for this method. "HEAD" finds what "GET" does, where it has no route of its own.
  std::optional<Found> Find(std::string_view method, const std::vector<std::string>& segments) const;
  // The methods that this path has, sorted; with GET also HEAD, and if it has any OPTIONS. Empty: no such path.
  std::vector<std::string> Methods(const std::vector<std::string>& segments) const;

 private:
  struct Route {
    std::string method;
    PathTemplate path;
    HttpHandler handler;
  };
  std::vector<Route> routes_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_ROUTER_H_
