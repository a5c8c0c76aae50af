#include "server/http/router.h"

#include <algorithm>
#include <cstdlib>
#include <set>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

absl::Status NoTemplate(std::string_view text, std::string_view why) {
  return absl::InvalidArgumentError(absl::StrFormat("path template \"%s\": %s", std::string(text), std::string(why)));
}

// "sequences" -> "sequence": how a collection names its members.
std::string Singular(std::string_view collection) {
  if (collection.empty() || collection.back() != 's') return std::string(collection);
  return std::string(collection.substr(0, collection.size() - 1));
}

}  // namespace

absl::StatusOr<PathTemplate> PathTemplate::Parse(std::string_view text) {
  PathTemplate result;
  result.text_ = std::string(text);
  if (text.empty() || text.front() != '/') return NoTemplate(text, "must begin with /");
  if (text == "/") return result;
  text.remove_prefix(1);
  // A colon inside of braces does not occur: field paths and segments have none.
  const size_t colon = text.rfind(':');
  if (colon != std::string_view::npos) {
    result.verb_ = std::string(text.substr(colon + 1));
    if (result.verb_.empty()) return NoTemplate(result.text_, "has an empty verb");
    text = text.substr(0, colon);
  }
  RETURN_IF_ERROR(result.ParseSegments(text));
  return result;
}

absl::Status PathTemplate::ParseSegments(std::string_view text) {
  while (true) {
    std::string_view piece;
    if (!text.empty() && text.front() == '{') {
      const size_t close = text.find('}');
      if (close == std::string_view::npos) return NoTemplate(text_, "has a { without }");
      const std::string_view inner = text.substr(1, close - 1);
      const size_t equals = inner.find('=');
      Variable variable{.field = std::string(inner.substr(0, equals)), .begin = segments_.size()};
      if (variable.field.empty() || variable.field.find_first_of("{}/*") != std::string::npos) {
        return NoTemplate(text_, "has a variable without a name");
      }
      if (equals == std::string_view::npos) {
        segments_.emplace_back();
      } else {
        const std::string_view pattern = inner.substr(equals + 1);
        if (pattern.find('{') != std::string_view::npos) return NoTemplate(text_, "has a variable inside of another");
        RETURN_IF_ERROR(ParseSegments(pattern));
      }
      variable.end = segments_.size();
      variables_.push_back(std::move(variable));
      text.remove_prefix(close + 1);
      piece = "{}";
    } else {
      piece = text.substr(0, text.find('/'));
      text.remove_prefix(piece.size());
      if (piece.empty()) return NoTemplate(text_, "has an empty segment");
      if (piece == "*") {
        segments_.emplace_back();
      } else if (piece.find_first_of("{}*") != std::string_view::npos) {
        return NoTemplate(text_, "has a segment that is neither * nor a variable nor plain text");
      } else {
        segments_.push_back({.literal = std::string(piece)});
      }
    }
    if (text.empty()) return absl::OkStatus();
    if (text.front() != '/') return NoTemplate(text_, "has text right after a }");
    text.remove_prefix(1);
  }
}

std::optional<std::map<std::string, std::string>> PathTemplate::Match(const std::vector<std::string>& segments) const {
  if (segments.size() != segments_.size()) return std::nullopt;
  std::map<std::string, std::string> values;
  if (segments.empty()) return values;
  std::string_view last = segments.back();
  const size_t colon = last.rfind(':');
  const bool has_verb = colon != std::string_view::npos;
  if (has_verb != !verb_.empty() || (has_verb && last.substr(colon + 1) != verb_)) return std::nullopt;
  last = last.substr(0, colon);
  if (last.empty()) return std::nullopt;

  const auto segment = [&](size_t i) { return i + 1 == segments.size() ? last : std::string_view(segments[i]); };
  for (size_t i = 0; i < segments.size(); ++i) {
    if (!segments_[i].literal.empty() && segments_[i].literal != segment(i)) return std::nullopt;
  }
  for (const Variable& variable : variables_) {
    std::string& value = values[variable.field];
    for (size_t i = variable.begin; i < variable.end; ++i) {
      if (i > variable.begin) value.push_back('/');
      value.append(segment(i));
    }
  }
  return values;
}

std::vector<std::string> PathTemplate::variables() const {
  std::vector<std::string> names;
  for (const Variable& variable : variables_) names.push_back(variable.field);
  return names;
}

std::vector<std::string> PathTemplate::StarNames() const {
  std::vector<std::string> names;
  for (size_t i = 0; i < segments_.size(); ++i) {
    if (!segments_[i].literal.empty()) continue;
    std::string name;
    for (const Variable& variable : variables_) {
      if (variable.begin == i && variable.end == i + 1) name = variable.field;
    }
    if (name.empty()) name = i == 0 ? "name" : Singular(segments_[i - 1].literal);
    names.push_back(name);
  }
  return names;
}

std::string PathTemplate::Readable() const {
  std::string result;
  const std::vector<std::string> names = StarNames();
  size_t star = 0;
  for (const Segment& segment : segments_) {
    absl::StrAppend(&result, "/", segment.literal.empty() ? absl::StrCat("{", names[star++], "}") : segment.literal);
  }
  if (result.empty()) return "/";
  return verb_.empty() ? result : absl::StrCat(result, ":", verb_);
}

void Router::Add(std::string_view method, std::string_view path, HttpHandler handler) {
  absl::StatusOr<PathTemplate> parsed = PathTemplate::Parse(path);
  if (!parsed.ok()) {
    LogError("bad_route", {{"path", std::string(path)}, {"why", std::string(parsed.status().message())}});
    std::abort();
  }
  routes_.push_back({.method = std::string(method), .path = *std::move(parsed), .handler = std::move(handler)});
}

std::optional<Router::Found> Router::Find(std::string_view method, const std::vector<std::string>& segments) const {
  for (const Route& route : routes_) {
    if (route.method != method) continue;
    if (auto values = route.path.Match(segments)) {
      return Found{.handler = &route.handler, .path = &route.path.text(), .path_values = *std::move(values)};
    }
  }
  if (method == "HEAD") return Find("GET", segments);
  return std::nullopt;
}

std::vector<std::string> Router::Methods(const std::vector<std::string>& segments) const {
  std::set<std::string> methods;
  for (const Route& route : routes_) {
    if (route.path.Match(segments)) methods.insert(route.method);
  }
  if (methods.count("GET") != 0) methods.insert("HEAD");
  if (!methods.empty()) methods.insert("OPTIONS");
  return {methods.begin(), methods.end()};
}

}  // namespace depthtween::server
