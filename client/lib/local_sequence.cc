#include "client/lib/local_sequence.h"

#include <fcntl.h>
#include <google/protobuf/stubs/common.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <set>
#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "proto/depthtween/sha256.h"

namespace depthtween::client {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kReadBytes = 1 << 20;
constexpr size_t kNamedInMessage = 10;  // more missing files than this are counted, not named

// The file names of a list such as rgb.txt. Lines without a name are left for the server to reject.
absl::StatusOr<std::vector<std::string>> ReadList(const fs::path& list) {
  std::ifstream in(list);
  if (!in) return ErrnoStatus(errno, "reading " + list.string());
  std::vector<std::string> names;
  std::string line;
  for (bool first = true; std::getline(in, line); first = false) {
    absl::string_view text = line;
    if (first) absl::ConsumePrefix(&text, "\xEF\xBB\xBF");  // a byte-order mark
    text = absl::StripAsciiWhitespace(text);
    if (text.empty() || text.front() == '#') continue;
    const size_t blank = text.find_first_of(" \t");
    if (blank != absl::string_view::npos) names.emplace_back(absl::StripLeadingAsciiWhitespace(text.substr(blank)));
  }
  return names;
}

// What protobuf can carry as text.
bool IsUtf8(const std::string& text) {
  return google::protobuf::internal::IsStructurallyValidUTF8(text.data(), static_cast<int>(text.size()));
}

// A display name of at most 200 bytes, the server's limit.
std::string DisplayName(const std::string& folder_name) {
  const bool fits = folder_name.size() <= 200 && IsUtf8(folder_name);
  return fits ? folder_name : absl::CHexEscape(folder_name).substr(0, 200);
}

absl::Status MissingFiles(const std::string& directory, const std::vector<std::string>& missing) {
  std::string named = absl::StrJoin(
      missing.begin(), missing.begin() + static_cast<int64_t>(std::min(missing.size(), kNamedInMessage)), ", ");
  if (missing.size() > kNamedInMessage) absl::StrAppend(&named, " and ", missing.size() - kNamedInMessage, " more");
  return absl::NotFoundError(absl::StrFormat(
      "%s lacks %d file%s: %s. A sequence folder holds rgb.txt, depth.txt, camera.json and every frame the "
      "lists name; `depthtween-core upsample %s -o OUT` says how to make them from other layouts",
      directory, missing.size(), missing.size() == 1 ? "" : "s", named, directory));
}

}  // namespace

absl::StatusOr<LocalSequence> FindSequence(const std::string& directory) {
  std::error_code error;
  const fs::path root = fs::canonical(directory, error);
  if (error) return ErrnoStatus(error.value(), "opening the sequence folder " + directory);
  if (!fs::is_directory(root)) {
    const std::string name = root.filename().string();
    if (!absl::EndsWithIgnoreCase(name, ".zip") || !fs::is_regular_file(root)) {
      return absl::InvalidArgumentError(directory +
                                        " is a file; name the folder that holds rgb.txt and depth.txt, or a "
                                        "zip archive of it");
    }
    const auto size_bytes = static_cast<int64_t>(fs::file_size(root, error));
    if (error) return ErrnoStatus(error.value(), "looking at " + directory);
    return LocalSequence{.directory = root.parent_path().string(),
                         .display_name = DisplayName(name),
                         .files = {{.path = name, .size_bytes = size_bytes}},
                         .size_bytes = size_bytes};
  }
  LocalSequence sequence{.directory = root.string(), .display_name = DisplayName(root.filename().string())};
  std::vector<std::string> missing;
  std::set<std::string> seen;
  const auto add = [&](const std::string& path) {
    if (!seen.insert(path).second) return;
    struct stat info;
    if (stat((root / path).c_str(), &info) != 0 || !S_ISREG(info.st_mode)) {
      missing.push_back(path);
      return;
    }
    sequence.files.push_back({.path = path, .size_bytes = info.st_size});
    sequence.size_bytes += info.st_size;
  };

  const char* const lists[] = {"rgb.txt", "depth.txt"};
  add("camera.json");
  for (const char* list : lists) add(list);
  for (const char* list : lists) {
    if (!fs::exists(root / list, error)) continue;
    ASSIGN_OR_RETURN(const std::vector<std::string> names, ReadList(root / list));
    for (const std::string& name : names) {
      if (!IsUtf8(name)) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: the file name '%s' is not UTF-8 text; rename the file", list, absl::CHexEscape(name)));
      }
      const fs::path path = fs::path(name).lexically_normal();
      if (path.is_absolute() || *path.begin() == "..") {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: '%s' leads out of the sequence folder; frames must be named relative to it and lie inside", list,
            name));
      }
      add(path.generic_string());
    }
  }
  if (!missing.empty()) return MissingFiles(directory, missing);
  return sequence;
}

absl::Status HashFiles(LocalSequence& sequence, const std::function<void(int64_t bytes_done)>& on_bytes) {
  ConcatenatedFiles bytes(sequence.directory, sequence.files);
  Sha256 whole;
  whole.Update(absl::StrCat(sequence.display_name, "\n"));
  int64_t offset = 0;
  for (LocalFile& file : sequence.files) {
    Sha256 hash;
    for (const int64_t end = offset + file.size_bytes; offset < end;) {
      ASSIGN_OR_RETURN(const std::string chunk, bytes.Read(offset, std::min(kReadBytes, end - offset)));
      hash.Update(chunk);
      offset += static_cast<int64_t>(chunk.size());
      if (on_bytes) on_bytes(offset);
    }
    file.sha256 = hash.Finish();
    whole.Update(absl::StrCat(file.path, "\n", file.size_bytes, "\n", Hex(file.sha256), "\n"));
  }
  sequence.fingerprint = Hex(whole.Finish());
  return absl::OkStatus();
}

ConcatenatedFiles::ConcatenatedFiles(const std::string& directory, std::span<const LocalFile> files)
    : directory_(directory), files_(files), begins_{0}, open_index_(files.size()) {
  for (const LocalFile& file : files) begins_.push_back(begins_.back() + file.size_bytes);
}

ConcatenatedFiles::~ConcatenatedFiles() {
  if (descriptor_ >= 0) close(descriptor_);
}

absl::Status ConcatenatedFiles::Open(size_t index) {
  if (index == open_index_) return absl::OkStatus();
  if (descriptor_ >= 0) close(descriptor_);
  open_index_ = files_.size();
  const std::string path = absl::StrCat(directory_, "/", files_[index].path);
  descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0) return ErrnoStatus(errno, "reading " + path);
  open_index_ = index;
  return absl::OkStatus();
}

absl::StatusOr<std::string> ConcatenatedFiles::Read(int64_t offset, int64_t count) {
  std::string bytes(static_cast<size_t>(std::clamp<int64_t>(size_bytes() - offset, 0, count)), '\0');
  for (size_t filled = 0; filled < bytes.size();) {
    const int64_t position = offset + static_cast<int64_t>(filled);
    // The last file that begins at or before `position`: empty files at the same place come before it.
    const size_t index = std::upper_bound(begins_.begin(), begins_.end(), position) - begins_.begin() - 1;
    RETURN_IF_ERROR(Open(index));
    const size_t wanted = std::min<size_t>(bytes.size() - filled, begins_[index + 1] - position);
    const ssize_t got = pread(descriptor_, bytes.data() + filled, wanted, position - begins_[index]);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return ErrnoStatus(errno, absl::StrCat("reading ", directory_, "/", files_[index].path));
    if (got == 0) {
      return absl::AbortedError(
          absl::StrFormat("%s/%s became shorter while it was being read; leave the folder as it is "
                          "until the upload is done, then run the command again",
                          directory_, files_[index].path));
    }
    filled += static_cast<size_t>(got);
  }
  return bytes;
}

}  // namespace depthtween::client
