#include "core/session/clear_output.h"

#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "core/io/file.h"

namespace depthtween {

namespace fs = std::filesystem;

absl::Status ClearOutput(const std::string& out, bool force, const std::string& replaces,
                         std::initializer_list<const char*> parts) {
  std::error_code error;
  if (!fs::exists(out, error) || (fs::is_directory(out, error) && fs::is_empty(out, error))) return absl::OkStatus();
  if (!fs::is_directory(out, error)) return absl::InvalidArgumentError(absl::StrCat(out, " is not a folder"));
  if (!force)
    return absl::AlreadyExistsError(
        absl::StrCat(out, " is not empty: name another folder, or use --force to replace ", replaces, " in it"));
  for (const char* part : parts) {
    const fs::path path = fs::path(out) / part;
    fs::remove_all(path, error);
    if (error) return ErrnoStatus(error.value(), "removing " + path.string());
  }
  return absl::OkStatus();
}

absl::Status ClearResult(const std::string& out, bool force, std::initializer_list<const char*> parts) {
  // A result lists no colour; a folder that does is somebody's recording.
  if (FileExists(JoinPath(out, "rgb.txt")))
    return absl::InvalidArgumentError(
        absl::StrCat(out, " holds a recording (rgb.txt), which a result must not be mixed with: name another folder"));
  return ClearOutput(out, force, "an earlier result", parts);
}

}  // namespace depthtween
