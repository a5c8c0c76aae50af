#include "server/store/backup.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string_view>
#include <system_error>
#include <tuple>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "proto/depthtween/sha256.h"
#include "server/store/checksums.h"
#include "server/store/data_directory.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/store/sqlite.h"

namespace depthtween::server {
namespace {

namespace backup_fs = std::filesystem;

constexpr char kManifest[] = "backup.sha256";
constexpr char kManifestTitle[] = "# depthtween backup 1";
constexpr int64_t kMaxManifestBytes = int64_t{2} << 30;  // 20 million files
constexpr size_t kCopyBytes = 1 << 20;
// Each is needed only if a recording or a job was deleted during the one before.
constexpr int kMaxDatabaseStates = 20;

// What tells whether a file is still the one that was copied.
struct FileFacts {
  ino_t inode = 0;
  int64_t size_bytes = 0;
  int64_t modified_ns = 0;
  bool operator==(const FileFacts&) const = default;
};

FileFacts FactsOf(const struct stat& info) {
  return {.inode = info.st_ino,
          .size_bytes = info.st_size,
          .modified_ns = int64_t{info.st_mtim.tv_sec} * 1'000'000'000 + info.st_mtim.tv_nsec};
}

struct CopiedFile {
  FileFacts source;
  int64_t wanted_bytes = 0;
  int64_t bytes = 0;
  std::string sha256;
  std::string blocks;  // as in FileChecksum; not of one that is linked
  bool linked = false;
};

constexpr int64_t kWhole = -1;

// Calls `sink` with the first `wanted_bytes` of an open file, or all of it, piece by piece. Returns how many there
// were. DataLoss where the disk does not give them.
absl::StatusOr<int64_t> ReadPieces(int fd, const std::string& name, int64_t wanted_bytes,
                                   const std::function<absl::Status(std::string_view)>& sink) {
  posix_fadvise(fd, 0, 0, POSIX_FADV_SEQUENTIAL);
  int64_t bytes = 0;
  std::vector<char> piece(kCopyBytes);
  while (wanted_bytes == kWhole || bytes < wanted_bytes) {
    const size_t most = wanted_bytes == kWhole
                            ? piece.size()
                            : static_cast<size_t>(std::min<int64_t>(wanted_bytes - bytes, kCopyBytes));
    const ssize_t got = read(fd, piece.data(), most);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return absl::DataLossError(std::string(ErrnoStatus(errno, "read " + name).message()));
    if (got == 0) break;
    RETURN_IF_ERROR(sink({piece.data(), static_cast<size_t>(got)}));
    bytes += got;
  }
  return bytes;
}

// Copies the first `wanted_bytes` of a file, or all of it, with its time. Not durable. NotFound or DataLoss if it
// cannot be read; other errors if it cannot be written.
absl::StatusOr<CopiedFile> CopyAndHash(const std::string& from, const std::string& to, int64_t wanted_bytes) {
  const int in = open(from.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (in < 0) return ErrnoStatus(errno, "open " + from);
  const absl::Cleanup close_in = [in] { close(in); };
  struct stat info {};
  if (fstat(in, &info) != 0) return ErrnoStatus(errno, "stat " + from);
  if (!S_ISREG(info.st_mode)) return absl::NotFoundError(from + " is not a regular file");
  const int out = open(to.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (out < 0) return ErrnoStatus(errno, "create " + to);
  const absl::Cleanup close_out = [out] { close(out); };
  CopiedFile copied = {.source = FactsOf(info), .wanted_bytes = wanted_bytes};
  Sha256 hash;
  BlockChecksums blocks;
  ASSIGN_OR_RETURN(copied.bytes, ReadPieces(in, from, wanted_bytes, [&](std::string_view left) -> absl::Status {
                     hash.Update(left);
                     blocks.Update(left);
                     while (!left.empty()) {
                       const ssize_t written = write(out, left.data(), left.size());
                       if (written < 0 && errno == EINTR) continue;
                       if (written < 0) return ErrnoStatus(errno, "write " + to);
                       left.remove_prefix(static_cast<size_t>(written));
                     }
                     return absl::OkStatus();
                   }));
  const std::array<timespec, 2> times = {info.st_atim, info.st_mtim};
  if (futimens(out, times.data()) != 0) return ErrnoStatus(errno, "set the time of " + to);
  copied.sha256 = Hex(hash.Finish());
  copied.blocks = blocks.Finish("").blocks;
  return copied;
}

// Of a file that stays where it is.
absl::StatusOr<CopiedFile> HashOf(const std::string& file) {
  const int fd = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  if (fd < 0) return ErrnoStatus(errno, "open " + file);
  const absl::Cleanup close_it = [fd] { close(fd); };
  CopiedFile hashed;
  Sha256 hash;
  ASSIGN_OR_RETURN(hashed.bytes, ReadPieces(fd, file, kWhole, [&hash](std::string_view bytes) {
                     hash.Update(bytes);
                     return absl::OkStatus();
                   }));
  hashed.sha256 = Hex(hash.Finish());
  return hashed;
}

absl::Status MakeFolderOf(const std::string& file) { return MakeFolder(file.substr(0, file.rfind('/'))); }

// Everything written to the file system of `folder` is durable when this returns.
absl::Status SyncAllUnder(const std::string& folder) {
  const int fd = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return ErrnoStatus(errno, "open " + folder);
  const absl::Cleanup close_it = [fd] { close(fd); };
  return syncfs(fd) == 0 ? absl::OkStatus() : ErrnoStatus(errno, "sync " + folder);
}

absl::Status CheckRoom(const std::string& folder, int64_t bytes) {
  struct statvfs space {};
  if (statvfs(folder.c_str(), &space) != 0) return ErrnoStatus(errno, "statvfs " + folder);
  const auto free_bytes = static_cast<int64_t>(space.f_bavail) * static_cast<int64_t>(space.f_frsize);
  if (bytes <= free_bytes) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat(folder, " has room for ", free_bytes, " bytes, ", bytes, " are needed"));
}

std::string AbsolutePath(const std::string& path) {
  std::error_code error;
  std::string absolute = backup_fs::weakly_canonical(path, error);
  if (error) absolute = backup_fs::absolute(path).lexically_normal();
  while (absolute.size() > 1 && absolute.back() == '/') absolute.pop_back();
  return absolute;
}

// ---- the list of a backup's files ----

struct Manifest {
  std::string folder_id;
  std::map<std::string, std::string> sha256_of;  // hexadecimal; by path relative to the backup
};

std::string ManifestText(const std::string& folder_id, const std::map<std::string, CopiedFile>& files) {
  std::string text = absl::StrCat(kManifestTitle, "\n# folder ", folder_id, "\n# made ",
                                  absl::FormatTime(absl::RFC3339_sec, absl::Now(), absl::UTCTimeZone()), "\n");
  for (const auto& [path, file] : files) absl::StrAppend(&text, file.sha256, "  ", path, "\n");
  absl::StrAppend(&text, "# end, ", files.size(), " files\n");
  return text;
}

absl::StatusOr<Manifest> ReadManifest(const std::string& backup) {
  const std::string file = absl::StrCat(backup, "/", kManifest);
  const absl::StatusOr<std::string> text = ReadWholeFile(file, kMaxManifestBytes);
  if (absl::IsNotFound(text.status())) {
    return absl::FailedPreconditionError(absl::StrCat(backup, " is no backup: it has no file ", kManifest));
  }
  RETURN_IF_ERROR(text.status());
  const auto damaged = [&file](absl::string_view why) {
    return absl::DataLossError(absl::StrCat(file, " is damaged: ", why));
  };
  Manifest manifest;
  bool ended = false, titled = false;
  for (const absl::string_view line : absl::StrSplit(*text, '\n', absl::SkipEmpty())) {
    if (!titled) {
      if (line != kManifestTitle) return damaged(absl::StrCat("its first line must be \"", kManifestTitle, "\""));
      titled = true;
    } else if (absl::string_view rest = line; absl::ConsumePrefix(&rest, "# folder ")) {
      manifest.folder_id = std::string(rest);
    } else if (absl::StartsWith(line, "# end, ")) {
      ended = line == absl::StrCat("# end, ", manifest.sha256_of.size(), " files");
    } else if (!absl::StartsWith(line, "#")) {
      const size_t gap = line.find("  ");
      const absl::string_view path = gap == absl::string_view::npos ? absl::string_view() : line.substr(gap + 2);
      // A path may not lead out of the folder that it is restored to.
      const std::vector<absl::string_view> parts = absl::StrSplit(path, '/');
      const bool inside = std::none_of(parts.begin(), parts.end(), [](absl::string_view part) {
        return part.empty() || part == "." || part == "..";
      });
      if (gap != 64 || !inside) return damaged(absl::StrCat("it has the line \"", line.substr(0, 300), "\""));
      manifest.sha256_of.emplace(path, line.substr(0, gap));
    }
  }
  if (!ended) return damaged("its last line does not count its files");
  return manifest;
}

// ---- what is to be copied ----

struct WantedFile {
  int64_t bytes = kWhole;
  std::optional<FileChecksum> checksum;
};

struct Contents {
  std::map<std::string, WantedFile> files;  // by path relative to the data folder
  int64_t bytes = 0;                        // at the moment; jobs grow
  int sequences = 0;
  int jobs = 0;
};

absl::Status AddSequences(Database& database, bool has_checksums, Contents& contents) {
  ASSIGN_OR_RETURN(const std::optional<int64_t> count, database.Number("SELECT count(*) FROM sequences"));
  contents.sequences = static_cast<int>(count.value_or(0));
  // The bytes of an upload follow one another in the order of its files: `start` is where a file's begin.
  const std::string sql = absl::StrCat(
      "SELECT s.id, f.path, f.size_bytes, ", has_checksums ? "f.checksums" : "NULL", ", u.committed_size, u.finished, ",
      "sum(f.size_bytes) OVER (PARTITION BY f.upload ORDER BY f.position) - f.size_bytes AS start "
      "FROM files f JOIN uploads u ON u.number = f.upload JOIN sequences s ON s.number = f.sequence");
  return database.Run(sql.c_str(), {}, [&contents](const SqlRow& row) {
    const int64_t size = row.Int64(2), committed = row.Int64(4), start = row.Int64(6);
    const bool begun = row.Int(5) != 0 || committed > start;
    if (!begun) return;
    WantedFile file = {.bytes = std::min(size, committed - start)};
    if (!row.IsNull(3)) file.checksum = {.path = row.Text(1), .size_bytes = size, .blocks = row.Text(3)};
    contents.bytes += file.bytes;
    contents.files.emplace(absl::StrCat("sequences/", row.Text(0), "/", row.Text(1)), std::move(file));
  });
}

absl::Status AddJobs(Database& database, const std::string& data_dir, bool has_checksums, Contents& contents) {
  std::vector<std::string> ids;
  RETURN_IF_ERROR(database.Run("SELECT id FROM jobs", {}, [&ids](const SqlRow& row) { ids.push_back(row.Text(0)); }));
  contents.jobs = static_cast<int>(ids.size());
  if (has_checksums) {
    RETURN_IF_ERROR(database.Run(
        "SELECT j.id, f.path, f.size_bytes, f.checksums FROM job_files f JOIN jobs j ON j.number = f.job", {},
        [&contents](const SqlRow& row) {
          contents.files[absl::StrCat("jobs/", row.Text(0), "/", row.Text(1))] = {
              .checksum = FileChecksum{.path = row.Text(1), .size_bytes = row.Int64(2), .blocks = row.Text(3)}};
        }));
  }
  // What is not recorded may be needed too: what a job that has not ended has left so far.
  for (const std::string& id : ids) {
    const std::string folder = absl::StrCat(data_dir, "/jobs/", id);
    std::error_code error, ignored;
    for (backup_fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      // A file that bears this ending is still being written.
      const bool whole = entry->path().extension() != ".tmp";
      if (!whole || !entry->is_regular_file(ignored) || entry->is_symlink(ignored)) continue;
      contents.files.try_emplace(entry->path().string().substr(data_dir.size() + 1));
      const auto size = entry->file_size(ignored);
      if (!ignored) contents.bytes += static_cast<int64_t>(size);
    }
    // No folder: the job has not begun, or it has just been deleted, and then nothing of it is recorded any more.
    if (error && error.value() != ENOENT) return ErrnoStatus(error.value(), "list " + folder);
  }
  return absl::OkStatus();
}

// One backup in the making.
class BackupMaker {
 public:
  BackupMaker(std::string data_dir, std::string partial, const BackupOptions& options)
      : data_dir_(std::move(data_dir)), partial_(std::move(partial)), options_(options) {}

  absl::Status Run(const std::string& folder_id);
  BackupSummary summary() const { return summary_; }

 private:
  // The database as it is now, and what it names.
  absl::StatusOr<Contents> TakeDatabase();
  // Copies what has not been copied yet, or has changed since. Returns the paths of those that could not be.
  absl::StatusOr<std::set<std::string>> CopyFiles(const Contents& contents);
  // True if the earlier backup has this file unchanged, and now this one too.
  bool LinkUnchanged(const std::string& path, int64_t wanted_bytes, const struct stat& source);
  absl::Status DropWhatIsNotIn(const Contents& contents);
  std::string Source(const std::string& path) const { return absl::StrCat(data_dir_, "/", path); }
  std::string Target(const std::string& path) const { return absl::StrCat(partial_, "/", path); }

  const std::string data_dir_;
  const std::string partial_;
  const BackupOptions options_;
  Manifest earlier_;
  std::map<std::string, CopiedFile> copied_;
  std::vector<std::string> faults_;  // of the last round
  BackupSummary summary_;
};

absl::StatusOr<Contents> BackupMaker::TakeDatabase() {
  absl::StatusOr<std::unique_ptr<Database>> source = Database::OpenToRead(Source(kDatabaseName));
  if (absl::IsNotFound(source.status())) {
    return absl::FailedPreconditionError(absl::StrCat(data_dir_, " has no database ", kDatabaseName));
  }
  RETURN_IF_ERROR(source.status());
  const std::string copy = Target(kDatabaseName);
  RETURN_IF_ERROR((*source)->CopyTo(copy));
  ++summary_.database_states;
  ASSIGN_OR_RETURN(const std::unique_ptr<Database> database, Database::OpenToRead(copy));
  std::string verdict;
  RETURN_IF_ERROR(
      database->Run("PRAGMA integrity_check(1)", {}, [&verdict](const SqlRow& row) { verdict = row.Text(0); }));
  if (verdict != "ok")
    return absl::DataLossError(absl::StrCat("the database of ", data_dir_, " is damaged: ", verdict));
  Contents contents;
  // A server that is about to be replaced by a newer one may have an older database.
  ASSIGN_OR_RETURN(const std::optional<int64_t> has_checksums,
                   database->Number("SELECT 1 FROM sqlite_schema WHERE name = 'job_files'"));
  RETURN_IF_ERROR(AddSequences(*database, has_checksums.has_value(), contents));
  RETURN_IF_ERROR(AddJobs(*database, data_dir_, has_checksums.has_value(), contents));
  return contents;
}

bool BackupMaker::LinkUnchanged(const std::string& path, int64_t wanted_bytes, const struct stat& source) {
  const auto known = earlier_.sha256_of.find(path);
  if (known == earlier_.sha256_of.end()) return false;
  const std::string file = absl::StrCat(options_.link_unchanged_from, "/", path);
  struct stat before {};
  if (lstat(file.c_str(), &before) != 0 || !S_ISREG(before.st_mode)) return false;
  FileFacts is = FactsOf(source), was = FactsOf(before);
  is.inode = was.inode;
  const bool whole = wanted_bytes == kWhole || wanted_bytes == is.size_bytes;
  if (!whole || is != was || link(file.c_str(), Target(path).c_str()) != 0) return false;
  copied_[path] = {.source = FactsOf(source),
                   .wanted_bytes = wanted_bytes,
                   .bytes = was.size_bytes,
                   .sha256 = known->second,
                   .linked = true};
  return true;
}

absl::StatusOr<std::set<std::string>> BackupMaker::CopyFiles(const Contents& contents) {
  std::set<std::string> failed;
  CopyProgress progress = {.files_total = static_cast<int64_t>(contents.files.size()), .bytes_total = contents.bytes};
  std::string folder;  // made last
  faults_.clear();
  for (const auto& [path, wanted] : contents.files) {
    const std::string from = Source(path), to = Target(path);
    if (const std::string of = to.substr(0, to.rfind('/')); of != folder) {
      RETURN_IF_ERROR(MakeFolder(of));
      folder = of;
    }
    struct stat info {};
    const bool there = lstat(from.c_str(), &info) == 0 && S_ISREG(info.st_mode);
    const auto before = copied_.find(path);
    const bool done = there && before != copied_.end() && before->second.source == FactsOf(info) &&
                      before->second.wanted_bytes == wanted.bytes;
    if (!done && before != copied_.end()) {
      // Never written over: it may be a second name of a file of the earlier backup.
      if (unlink(to.c_str()) != 0 && errno != ENOENT) return ErrnoStatus(errno, "replace " + to);
      copied_.erase(before);
    }
    if (!done && !(there && LinkUnchanged(path, wanted.bytes, info))) {
      absl::StatusOr<CopiedFile> made = CopyAndHash(from, to, wanted.bytes);
      if (absl::IsNotFound(made.status()) || absl::IsDataLoss(made.status())) {
        failed.insert(path);
        faults_.push_back(absl::StrCat(path, there ? " cannot be read" : " is missing"));
        if (unlink(to.c_str()) != 0 && errno != ENOENT) return ErrnoStatus(errno, "remove " + to);
        continue;
      }
      RETURN_IF_ERROR(made.status());
      copied_[path] = *std::move(made);
    }
    const CopiedFile& copied = copied_.at(path);
    if (wanted.bytes != kWhole && copied.bytes < wanted.bytes) {
      failed.insert(path);
      faults_.push_back(absl::StrCat(path, " has ", copied.bytes, " bytes, must have ", wanted.bytes));
    } else if (wanted.checksum && copied.bytes == wanted.checksum->size_bytes && !copied.linked &&
               copied.blocks != wanted.checksum->blocks) {
      failed.insert(path);
      faults_.push_back(absl::StrCat(path, " is damaged: its bytes are not those that were stored"));
    } else if (wanted.bytes == kWhole && wanted.checksum && copied.bytes != wanted.checksum->size_bytes) {
      failed.insert(path);
      faults_.push_back(
          absl::StrCat(path, " has ", copied.bytes, " bytes, ", wanted.checksum->size_bytes, " were stored"));
    }
    ++progress.files;
    progress.bytes += copied.bytes;
    if (options_.on_copied) options_.on_copied(progress);
  }
  return failed;
}

absl::Status BackupMaker::DropWhatIsNotIn(const Contents& contents) {
  for (auto file = copied_.begin(); file != copied_.end();) {
    if (contents.files.count(file->first) > 0) {
      ++file;
      continue;
    }
    if (unlink(Target(file->first).c_str()) != 0) return ErrnoStatus(errno, "remove " + Target(file->first));
    file = copied_.erase(file);
  }
  return absl::OkStatus();
}

absl::Status BackupMaker::Run(const std::string& folder_id) {
  if (!options_.link_unchanged_from.empty()) {
    ASSIGN_OR_RETURN(earlier_, ReadManifest(options_.link_unchanged_from));
    if (earlier_.folder_id != folder_id) {
      return absl::FailedPreconditionError(absl::StrCat(options_.link_unchanged_from, " is of another data folder: of ",
                                                        earlier_.folder_id, ", not of ", folder_id));
    }
  }
  std::set<std::string> failed_before;
  for (bool together = false; !together;) {
    if (summary_.database_states == kMaxDatabaseStates) {
      return absl::AbortedError(absl::StrCat("recordings and jobs were deleted while they were copied, ",
                                             kMaxDatabaseStates, " times; try again later"));
    }
    ASSIGN_OR_RETURN(const Contents contents, TakeDatabase());
    if (earlier_.sha256_of.empty() && copied_.empty()) RETURN_IF_ERROR(CheckRoom(partial_, contents.bytes));
    RETURN_IF_ERROR(DropWhatIsNotIn(contents));
    ASSIGN_OR_RETURN(const std::set<std::string> failed, CopyFiles(contents));
    // What was amiss before this state of the database was taken, and is named by it, was not deleted: it is lost.
    together = std::includes(failed_before.begin(), failed_before.end(), failed.begin(), failed.end());
    failed_before = failed;
    summary_.sequences = contents.sequences;
    summary_.jobs = contents.jobs;
  }
  ASSIGN_OR_RETURN(copied_[kDatabaseName], HashOf(Target(kDatabaseName)));
  ASSIGN_OR_RETURN(copied_[kFolderMarker], CopyAndHash(Source(kFolderMarker), Target(kFolderMarker), kWhole));
  for (const char* kind : {"sequences", "jobs"}) RETURN_IF_ERROR(MakeFolder(Target(kind)));
  RETURN_IF_ERROR(WriteScratchFile(Target(kManifest), ManifestText(folder_id, copied_)));
  RETURN_IF_ERROR(SyncAllUnder(partial_));
  for (const auto& [path, file] : copied_) {
    ++summary_.files;
    summary_.bytes += file.bytes;
    summary_.linked_files += file.linked ? 1 : 0;
  }
  summary_.faults = faults_;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<BackupSummary> MakeBackup(const std::string& data_dir, const std::string& to,
                                         const BackupOptions& options) {
  const std::string source = AbsolutePath(data_dir), target = AbsolutePath(to), partial = target + ".partial";
  const absl::StatusOr<std::string> id = ReadFolderId(source);
  if (absl::IsNotFound(id.status())) {
    return absl::FailedPreconditionError(
        absl::StrCat(source, " is not a data folder of a server: it has no file ", kFolderMarker));
  }
  RETURN_IF_ERROR(id.status());
  if (absl::StartsWith(target, source + "/")) {
    return absl::InvalidArgumentError(absl::StrCat(target, " lies in the data folder, must lie outside"));
  }
  std::error_code error;
  if (backup_fs::exists(backup_fs::symlink_status(target, error))) {
    return absl::AlreadyExistsError(absl::StrCat(target, " exists; name a folder that does not"));
  }
  RETURN_IF_ERROR(MakeFolderOf(target));
  if (mkdir(partial.c_str(), 0755) != 0) {
    if (errno != EEXIST) return ErrnoStatus(errno, "create " + partial);
    return absl::AlreadyExistsError(absl::StrCat(
        partial, " exists: another backup to this folder is being made, or was interrupted; then remove it"));
  }
  absl::Cleanup remove_partial = [&partial] {
    std::error_code ignored;
    backup_fs::remove_all(partial, ignored);
  };
  BackupMaker maker(source, partial, options);
  RETURN_IF_ERROR(maker.Run(*id));
  if (rename(partial.c_str(), target.c_str()) != 0) return ErrnoStatus(errno, "move " + partial + " to " + target);
  std::move(remove_partial).Cancel();
  RETURN_IF_ERROR(SyncFolder(target.substr(0, target.rfind('/')) + "/."));
  return maker.summary();
}

absl::StatusOr<RestoreSummary> RestoreBackup(const std::string& from, const std::string& data_dir,
                                             const OnCopied& on_copied) {
  const std::string source = AbsolutePath(from), target = AbsolutePath(data_dir);
  ASSIGN_OR_RETURN(const Manifest manifest, ReadManifest(source));
  ASSIGN_OR_RETURN(const std::string id, ReadFolderId(source));
  for (const char* needed : {kDatabaseName, kFolderMarker}) {
    if (manifest.sha256_of.count(needed) > 0) continue;
    return absl::DataLossError(absl::StrCat(source, "/", kManifest, " does not name ", needed));
  }
  std::error_code error;
  for (const std::string& name : NamesIn(target)) {
    if (name == "lost+found") continue;
    return absl::FailedPreconditionError(
        absl::StrCat(target, " is not empty: it holds ", name, ". Name a folder that is empty or missing"));
  }
  CopyProgress progress = {.files_total = static_cast<int64_t>(manifest.sha256_of.size())};
  for (const auto& [path, sha256] : manifest.sha256_of) {
    const auto size = backup_fs::file_size(absl::StrCat(source, "/", path), error);
    if (error) return absl::DataLossError(absl::StrCat("the backup is damaged: ", path, ": ", error.message()));
    progress.bytes_total += static_cast<int64_t>(size);
  }
  RETURN_IF_ERROR(MakeFolder(target));
  RETURN_IF_ERROR(CheckRoom(target, progress.bytes_total));
  absl::Cleanup remove_copies = [&target] {
    std::error_code ignored;
    for (const std::string& name : NamesIn(target)) {
      if (name != "lost+found") backup_fs::remove_all(absl::StrCat(target, "/", name), ignored);
    }
  };
  const std::string draft = absl::StrCat(target, "/", kFolderMarker, ".new");
  for (const auto& [path, sha256] : manifest.sha256_of) {
    const std::string to = path == kFolderMarker ? draft : absl::StrCat(target, "/", path);
    RETURN_IF_ERROR(MakeFolderOf(to));
    ASSIGN_OR_RETURN(const CopiedFile copied, CopyAndHash(absl::StrCat(source, "/", path), to, kWhole));
    if (copied.sha256 != sha256) {
      return absl::DataLossError(absl::StrCat("the backup is damaged: ", path, " has changed since it was made"));
    }
    ++progress.files;
    progress.bytes += copied.bytes;
    if (on_copied) on_copied(progress);
  }
  RETURN_IF_ERROR(SyncAllUnder(target));
  RETURN_IF_ERROR(MoveFile(draft, absl::StrCat(target, "/", kFolderMarker)));
  RETURN_IF_ERROR(SyncFolder(target));
  std::move(remove_copies).Cancel();
  return RestoreSummary{.files = progress.files, .bytes = progress.bytes, .folder_id = id};
}

}  // namespace depthtween::server
