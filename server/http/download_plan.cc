#include "server/http/download_plan.h"

#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

Precondition PreconditionOf(const HttpRequest& request, std::string_view etag) {
  return CheckPreconditions(request.Header("if-match").value_or(""), request.Header("if-none-match").value_or(""),
                            etag);
}

}  // namespace

bool WantsRange(const HttpRequest& request, std::string_view etag) {
  // RFC 9110, 14.2: Range means something to GET alone, and counts after the preconditions.
  return request.method == "GET" && request.Header("range").has_value() &&
         PreconditionOf(request, etag) == Precondition::kHolds &&
         IfRangeHolds(request.Header("if-range").value_or(""), etag);
}

DownloadPlan PlanDownload(const HttpRequest& request, const Representation& representation) {
  DownloadPlan plan;
  plan.headers = {
      {"ETag", representation.etag}, {"Cache-Control", representation.cache_control}, {"Accept-Ranges", "bytes"}};
  switch (PreconditionOf(request, representation.etag)) {
    case Precondition::kNotModified:
      plan.status = 304;
      return plan;
    case Precondition::kFailed:
      plan.status = 412;
      return plan;
    case Precondition::kHolds:
      break;
  }
  const std::optional<int64_t>& size_bytes = representation.size_bytes;
  if (size_bytes && WantsRange(request, representation.etag)) {
    const RangeChoice choice = ChooseRange(*request.Header("range"), *size_bytes);
    if (choice.kind == RangeChoice::Kind::kUnsatisfiable) {
      plan.status = 416;
      plan.headers.emplace_back("Content-Range", UnsatisfiedRange(*size_bytes));
      return plan;
    }
    if (choice.kind == RangeChoice::Kind::kPart) {
      plan.status = 206;
      plan.headers.emplace_back("Content-Range", ContentRange(choice.span, *size_bytes));
      plan.span = choice.span;
    }
  }
  plan.headers.emplace_back("Content-Type", representation.content_type);
  plan.headers.emplace_back("Content-Disposition", representation.disposition);
  if (plan.status == 200) plan.span = {0, size_bytes.value_or(0)};
  if (size_bytes) plan.content_length = plan.span.size;
  plan.sends_body = request.method == "GET";
  return plan;
}

std::string_view ContentTypeOf(std::string_view file_name) {
  static constexpr std::pair<std::string_view, std::string_view> kTypes[] = {
      {".png", "image/png"},         {".jpg", "image/jpeg"},
      {".json", "application/json"}, {".txt", "text/plain; charset=utf-8"},
      {".mp4", "video/mp4"},         {".mkv", "video/x-matroska"},
      {".zip", "application/zip"},
  };
  const size_t dot = file_name.rfind('.');
  if (dot != std::string_view::npos) {
    for (const auto& [extension, type] : kTypes) {
      if (file_name.substr(dot) == extension) return type;
    }
  }
  return "application/octet-stream";
}

std::string Disposition(std::string_view kind, std::string_view file_name) {
  std::string safe(file_name);
  for (char& c : safe) {
    if (!absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '_' && c != '-') c = '_';
  }
  return absl::StrCat(std::string(kind), "; filename=\"", safe, "\"");
}

}  // namespace depthtween::server
