#include "server/http/file_route.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/http/byte_range.h"

namespace depthtween::server {
namespace {

constexpr std::pair<std::string_view, v1::Encoding> kExtensions[] = {
    {".png", v1::ENCODING_PNG}, {".jpg", v1::ENCODING_JPEG}, {".npz", v1::ENCODING_NPZ},
    {".flo", v1::ENCODING_FLO}, {".pfm", v1::ENCODING_PFM},
};

// Takes `suffix` off the end of `text`.
bool TakeSuffix(std::string_view& text, std::string_view suffix) {
  if (text.size() <= suffix.size() || text.substr(text.size() - suffix.size()) != suffix) return false;
  text.remove_suffix(suffix.size());
  return true;
}

std::optional<FileRoute> MatchFrame(std::string resource, std::string_view file) {
  for (const auto& [extension, encoding] : kExtensions) {
    std::string_view number = file;
    if (!TakeSuffix(number, extension)) continue;
    const std::optional<int64_t> frame = ParseByteCount(number);
    // The last int is left out, because the end of the range of frames lies one behind.
    if (!frame || *frame >= std::numeric_limits<int>::max()) return std::nullopt;
    return FileRoute{.kind = FileRoute::Kind::kFrame,
                     .resource = std::move(resource),
                     .frame = static_cast<int>(*frame),
                     .encoding = encoding};
  }
  return std::nullopt;
}

}  // namespace

std::optional<FileRoute> MatchFileRoute(const std::vector<std::string>& segments) {
  using Kind = FileRoute::Kind;
  const size_t count = segments.size();
  if (count < 4 || segments[0] != "v1") return std::nullopt;
  // No id has other letters, and a string of protobuf must be UTF-8.
  for (const std::string& segment : segments) {
    if (!std::all_of(segment.begin(), segment.end(), [](char c) { return c > ' ' && c <= '~'; })) return std::nullopt;
  }
  std::string_view last = segments.back();
  const std::string parent = absl::StrCat(segments[1], "/", segments[2]);
  if (segments[1] == "jobs" && segments[3] == "outputs") {
    const std::string outputs = absl::StrCat(parent, "/outputs/");
    if (count == 7 && segments[5] == "frames") return MatchFrame(absl::StrCat(outputs, segments[4]), last);
    if (count != 5) return std::nullopt;
    if (TakeSuffix(last, ".zip")) {
      return FileRoute{.kind = Kind::kArchive, .resource = absl::StrCat(outputs, std::string(last))};
    }
    if (TakeSuffix(last, ":download")) {
      return FileRoute{.kind = Kind::kFile, .resource = absl::StrCat(outputs, std::string(last))};
    }
    return std::nullopt;
  }
  if (segments[1] != "sequences") return std::nullopt;
  if (count == 4 && last == "uploads:tus") return FileRoute{.kind = Kind::kTusCreation, .resource = parent};
  if (count != 5 || segments[3] != "uploads") return std::nullopt;
  if (TakeSuffix(last, ":tus")) {
    return FileRoute{.kind = Kind::kTusUpload, .resource = absl::StrCat(parent, "/uploads/", std::string(last))};
  }
  if (last.find(':') != std::string_view::npos) return std::nullopt;  // a verb of the bridge
  return FileRoute{.kind = Kind::kUpload, .resource = absl::StrCat(parent, "/uploads/", std::string(last))};
}

std::vector<std::string_view> MethodsOf(FileRoute::Kind kind) {
  switch (kind) {
    case FileRoute::Kind::kFrame:
    case FileRoute::Kind::kArchive:
    case FileRoute::Kind::kFile:
      return {"GET", "HEAD"};
    case FileRoute::Kind::kTusCreation:
      return {"OPTIONS", "POST"};
    case FileRoute::Kind::kTusUpload:
      return {"DELETE", "HEAD", "OPTIONS", "PATCH", "POST"};
    case FileRoute::Kind::kUpload:
      return {"PUT"};
  }
  return {};
}

std::string_view ExtensionOf(v1::Encoding encoding) {
  for (const auto& [extension, known] : kExtensions) {
    if (known == encoding) return extension;
  }
  return ".bin";
}

}  // namespace depthtween::server
