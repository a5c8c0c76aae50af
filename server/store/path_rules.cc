#include "server/store/path_rules.h"

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "core/base/utf8.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr int kMaxFolders = 4;
constexpr size_t kMaxPartBytes = 255;
constexpr char kForeign[] = "\\:*?\"<>|";

// A name's characters, already known to be UTF-8: U+0080 to U+009F are control characters too.
bool HasControlCharacter(absl::string_view name) {
  for (size_t i = 0; i < name.size(); ++i) {
    const auto c = static_cast<unsigned char>(name[i]);
    if (c < 0x20 || c == 0x7F) return true;
    if (c == 0xC2 && static_cast<unsigned char>(name[i + 1]) < 0xA0) return true;
  }
  return false;
}

// The rule that a path breaks; empty when it breaks none.
std::string BrokenRule(std::string_view path) {
  if (path.empty()) return "is empty; name the file relative to the sequence folder";
  if (path.front() == '/') return "is absolute; name the file relative to the sequence folder";
  if (!IsUtf8(path)) return "is not UTF-8 text; rename the file";
  const std::vector<absl::string_view> parts = absl::StrSplit(View(path), '/');
  if (parts.size() > kMaxFolders + 1) return absl::StrCat("lies deeper than ", kMaxFolders, " folders");
  for (const absl::string_view part : parts) {
    if (part.empty()) return "has a part without a name; write single slashes between names";
    if (part.size() > kMaxPartBytes) return absl::StrCat("has a name longer than ", kMaxPartBytes, " bytes");
    if (part.front() == '.') return "has a name that begins with a dot; hidden files and \"..\" are refused";
    if (HasControlCharacter(part)) return "has a control character; rename the file";
    if (part.find_first_of(kForeign) != absl::string_view::npos)
      return absl::StrCat("has one of ", absl::string_view(kForeign),
                          " which other systems cannot have; rename the file");
  }
  return {};
}

// Printable whatever the path holds. A path of megabytes need not be repeated in full.
std::string Shown(std::string_view path) {
  const absl::string_view cut = View(path.substr(0, 300));
  const bool text = IsUtf8({cut.data(), cut.size()}) && !HasControlCharacter(cut);
  return absl::StrCat("\"", text ? absl::Utf8SafeCEscape(cut) : absl::CEscape(cut), "\"");
}

}  // namespace

absl::Status CheckRelativePath(std::string_view path) {
  const std::string rule = BrokenRule(path);
  if (rule.empty()) return absl::OkStatus();
  return BadField("upload.files.path", absl::StrCat("path ", Shown(path), " ", rule));
}

absl::Status CheckRelativePaths(const std::vector<std::string_view>& paths) {
  constexpr int kNamed = 10;
  int refused = 0;
  std::string named;
  for (const std::string_view path : paths) {
    const std::string rule = BrokenRule(path);
    if (rule.empty() || ++refused > kNamed) continue;
    absl::StrAppend(&named, refused == 1 ? "" : "; ", Shown(path), " ", rule);
  }
  if (refused == 0) return absl::OkStatus();
  if (refused > kNamed) absl::StrAppend(&named, "; and ", refused - kNamed, " more");
  return BadField("upload.files.path",
                  absl::StrCat(refused, " of ", paths.size(), " paths are refused: ", named,
                               ". A file that is renamed has its new name in rgb.txt or depth.txt too"));
}

bool IsArchiveName(std::string_view path) {
  const absl::string_view name(path.data(), path.size());
  return name.size() > 4 && absl::EndsWithIgnoreCase(name, ".zip") && name.find('/') == absl::string_view::npos;
}

}  // namespace depthtween::server
