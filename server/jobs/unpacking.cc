#include "server/jobs/unpacking.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/base/utf8.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/store/path_rules.h"

namespace depthtween::server {
namespace {

namespace fs = std::filesystem;

absl::Status FileSystemError(const std::error_code& error, const std::string& what) {
  return error ? ErrnoStatus(error.value(), what) : absl::OkStatus();
}

}  // namespace

absl::Status CleanSequence(const std::string& folder, const SequenceArchive& archive) {
  for (const std::string& name : NamesIn(folder)) {
    if ((name == archive.path) != archive.unpacked) continue;
    std::error_code error;
    fs::remove_all(fs::path(folder) / name, error);
    RETURN_IF_ERROR(FileSystemError(error, absl::StrCat("remove ", folder, "/", name)));
  }
  return absl::OkStatus();
}

absl::StatusOr<UnpackedFiles> ListUnpacked(const std::string& folder, const SequenceArchive& archive, int max_files,
                                           int64_t max_bytes, const std::stop_token& stop) {
  UnpackedFiles unpacked;
  int64_t bytes = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (stop.stop_requested()) return absl::CancelledError("unpacking was stopped");
    std::error_code look;
    const fs::file_type type = entry->symlink_status(look).type();
    if (type == fs::file_type::directory) continue;
    std::string path = entry->path().lexically_relative(folder).string();
    if (type != fs::file_type::regular) {
      return absl::InternalError("depthtween-core unpacked something that is neither file nor folder");
    }
    if (absl::Status named = CheckRelativePath(path); !named.ok()) {
      unpacked.violations.push_back({.file = IsUtf8(path) ? path : absl::CHexEscape(path), .status = std::move(named)});
      continue;
    }
    if (path == archive.path) {
      unpacked.violations.push_back({.file = path, .status = absl::InvalidArgumentError("has the archive's own name")});
      continue;
    }
    if (static_cast<int64_t>(unpacked.files.size()) == max_files) {
      return absl::ResourceExhaustedError(absl::StrFormat("depthtween-core unpacked more than %d files", max_files));
    }
    ASSIGN_OR_RETURN(FileChecksum checksum, ChecksumOf(entry->path(), std::move(path)));
    if (checksum.size_bytes > max_bytes - bytes) {
      return absl::ResourceExhaustedError(absl::StrFormat("depthtween-core unpacked more than %d bytes", max_bytes));
    }
    bytes += checksum.size_bytes;
    unpacked.files.push_back(std::move(checksum));
  }
  RETURN_IF_ERROR(FileSystemError(error, absl::StrCat("list ", folder)));
  std::sort(unpacked.files.begin(), unpacked.files.end(),
            [](const FileChecksum& a, const FileChecksum& b) { return a.path < b.path; });
  return unpacked;
}

absl::Status MoveUnpacked(const std::string& from, const std::string& to) {
  for (const std::string& name : NamesIn(from)) {
    if (std::rename(absl::StrCat(from, "/", name).c_str(), absl::StrCat(to, "/", name).c_str()) != 0) {
      return ErrnoStatus(errno, absl::StrCat("move ", name, " to ", to));
    }
  }
  return SyncDisk(to);
}

}  // namespace depthtween::server
