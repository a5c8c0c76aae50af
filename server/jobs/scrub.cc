#include "server/jobs/scrub.h"

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/store/data_directory.h"
#include "server/store/sqlite_store.h"

namespace depthtween::server {
namespace {

constexpr int kFilesAtOnce = 256;

// Makes its caller wait so that no more than so many bytes pass in a second.
class Throttle {
 public:
  Throttle(int64_t bytes_per_second, const std::stop_token& stop) : bytes_per_second_(bytes_per_second), stop_(stop) {}

  // False once it is to stop.
  bool Pass(int64_t bytes) {
    if (bytes_per_second_ > 0) {
      next_ = std::max(next_, absl::Now()) +
              absl::Seconds(static_cast<double>(bytes) / static_cast<double>(bytes_per_second_));
      std::unique_lock lock(mutex_);
      woken_.wait_until(lock, stop_, absl::ToChronoTime(next_), [] { return false; });
    }
    return !stop_.stop_requested();
  }

 private:
  const int64_t bytes_per_second_;
  const std::stop_token stop_;
  absl::Time next_ = absl::InfinitePast();
  std::mutex mutex_;
  std::condition_variable_any woken_;  // by `stop_` alone
};

// What the store has of the file now; nullopt if it has been deleted.
absl::StatusOr<std::optional<FileChecksum>> Recorded(Store& store, const StoredFile& file) {
  const std::string id = file.resource.substr(file.resource.find('/') + 1);
  if (file.resource.rfind("jobs/", 0) == 0) return store.JobFile(id, file.checksum->path);
  ASSIGN_OR_RETURN(const std::vector<FileChecksum> files, store.SequenceFiles(id));
  const auto found = std::find_if(files.begin(), files.end(),
                                  [&](const FileChecksum& other) { return other.path == file.checksum->path; });
  return found == files.end() ? std::nullopt : std::optional<FileChecksum>(*found);
}

}  // namespace

absl::StatusOr<std::string> ScrubSome(Store& store, const std::string& data_dir, const std::string& cursor, int count,
                                      int64_t bytes_per_second, const std::stop_token& stop, ScrubSummary& summary) {
  ASSIGN_OR_RETURN(const Page<StoredFile> page, store.StoredFiles({.size = count, .token = cursor}));
  Throttle throttle(bytes_per_second, stop);
  const auto pace = [&](int64_t bytes) {
    summary.bytes += bytes;
    return throttle.Pass(bytes);
  };
  for (const StoredFile& file : page.items) {
    if (!file.checksum) {
      ++summary.unknown_files;
      continue;
    }
    const std::string path = absl::StrCat(data_dir, "/", file.path);
    absl::Status checked = CheckFile(path, *file.checksum, pace, /*cold=*/true);
    if (absl::IsDataLoss(checked) || absl::IsNotFound(checked)) {
      // It may have been deleted, or made anew, since it was listed.
      ASSIGN_OR_RETURN(const std::optional<FileChecksum> now, Recorded(store, file));
      checked = now ? CheckFile(path, *now, pace, /*cold=*/true) : absl::OkStatus();
    }
    if (absl::IsCancelled(checked)) return checked;
    ++summary.files;
    if (absl::IsNotFound(checked)) {
      summary.faults.push_back({.path = file.path, .what = "it is missing"});
    } else if (!checked.ok()) {
      summary.faults.push_back({.path = file.path, .what = std::string(checked.message())});
    }
  }
  return page.next_token;
}

absl::StatusOr<ScrubSummary> ScrubFolder(const std::string& data_dir, const ScrubOptions& options) {
  RETURN_IF_ERROR(ReadFolderId(data_dir).status());
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store,
                   OpenSqliteStoreToRead(absl::StrCat(data_dir, "/", kDatabaseName)));
  ScrubSummary summary;
  std::string cursor;
  do {
    ASSIGN_OR_RETURN(cursor, ScrubSome(*store, data_dir, cursor, kFilesAtOnce, options.bytes_per_second,
                                       std::stop_token(), summary));
    if (options.on_files) options.on_files(summary);
  } while (!cursor.empty());
  return summary;
}

}  // namespace depthtween::server
