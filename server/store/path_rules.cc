#include "server/store/path_rules.h"

#include <algorithm>
#include <string>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_split.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr int kMaxFolders = 4;
constexpr size_t kMaxPartBytes = 255;

bool Allowed(char c) { return absl::ascii_isalnum(c) || c == '.' || c == '_' || c == '-' || c == '+' || c == ' '; }

}  // namespace

absl::Status CheckRelativePath(std::string_view path) {
  const auto bad = [path](absl::string_view rule) {
    // A path of megabytes need not be repeated in full.
    const std::string shown = absl::CEscape(absl::string_view(path.data(), std::min<size_t>(path.size(), 300)));
    return BadField("upload.files.path", absl::StrCat("path \"", shown, "\" ", rule));
  };
  if (path.empty()) return bad("is empty; name the file relative to the sequence folder");
  if (path.front() == '/') return bad("is absolute; name the file relative to the sequence folder");
  const std::vector<absl::string_view> parts = absl::StrSplit(absl::string_view(path.data(), path.size()), '/');
  if (parts.size() > kMaxFolders + 1) return bad(absl::StrCat("lies deeper than ", kMaxFolders, " folders"));
  for (const absl::string_view part : parts) {
    if (part.empty()) return bad("has a part without a name; write single slashes between names");
    if (part.size() > kMaxPartBytes) return bad(absl::StrCat("has a name longer than ", kMaxPartBytes, " bytes"));
    if (part.front() == '.') return bad("has a name that begins with a dot; hidden files and \"..\" are refused");
    if (!std::all_of(part.begin(), part.end(), Allowed)) {
      return bad("has a character other than letters, digits and \"._-+ \"; rename the file");
    }
  }
  return absl::OkStatus();
}

}  // namespace depthtween::server
