// What is known of files at rest.
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {
namespace {

constexpr char kRoundOver[] = "end";

FileChecksum ToChecksum(const SqlRow& row, int path_column) {
  return {.path = row.Text(path_column), .size_bytes = row.Int64(path_column + 1), .blocks = row.Text(path_column + 2)};
}

// A place in the order of all files: those of sequences, then those of jobs, by owner and path. As text "s 12
// rgb/0.png" or "j 7 out/report.json"; what is empty comes first.
struct Place {
  bool of_job = false;
  int64_t owner = 0;
  std::string path;
};

std::string ToText(const Place& place) {
  return absl::StrCat(place.of_job ? "j " : "s ", place.owner, " ", place.path);
}

Place PlaceOf(const std::string& text) {
  const std::vector<std::string> parts = absl::StrSplit(text, absl::MaxSplits(' ', 2));
  Place place;
  if (parts.size() != 3 || !absl::SimpleAtoi(parts[1], &place.owner)) return {};
  place.of_job = parts[0] == "j";
  place.path = parts[2];
  return place;
}

}  // namespace

absl::Status SqliteStore::KeepJobFiles(int64_t job, const std::vector<FileChecksum>& files) {
  for (const FileChecksum& file : files) {
    RETURN_IF_ERROR(
        database_->Run("INSERT OR REPLACE INTO job_files (job, path, size_bytes, checksums) VALUES (?, ?, ?, ?)",
                       {job, file.path, file.size_bytes, SqlValue::Blob{file.blocks}}));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::optional<FileChecksum>> SqliteStore::JobFile(std::string_view job_id, std::string_view path) {
  return Read([&]() -> absl::StatusOr<std::optional<FileChecksum>> {
    std::optional<FileChecksum> found;
    RETURN_IF_ERROR(
        database_->Run("SELECT f.path, f.size_bytes, f.checksums FROM job_files f "
                       "JOIN jobs j ON j.number = f.job WHERE j.id = ? AND f.path = ?",
                       {job_id, path}, [&found](const SqlRow& row) { found = ToChecksum(row, 0); }));
    return found;
  });
}

absl::StatusOr<std::vector<FileChecksum>> SqliteStore::JobFiles(std::string_view job_id) {
  return Read([&]() -> absl::StatusOr<std::vector<FileChecksum>> {
    std::vector<FileChecksum> files;
    RETURN_IF_ERROR(
        database_->Run("SELECT f.path, f.size_bytes, f.checksums FROM job_files f JOIN jobs j ON j.number = f.job "
                       "WHERE j.id = ? ORDER BY f.path",
                       {job_id}, [&files](const SqlRow& row) { files.push_back(ToChecksum(row, 0)); }));
    return files;
  });
}

absl::StatusOr<std::vector<FileChecksum>> SqliteStore::SequenceFiles(std::string_view sequence_id) {
  return Read([&]() -> absl::StatusOr<std::vector<FileChecksum>> {
    std::vector<FileChecksum> files;
    RETURN_IF_ERROR(database_->Run(
        "SELECT f.path, f.size_bytes, f.checksums FROM files f JOIN sequences s ON s.number = f.sequence "
        "WHERE s.id = ? AND f.checksums IS NOT NULL ORDER BY f.path",
        {sequence_id}, [&files](const SqlRow& row) { files.push_back(ToChecksum(row, 0)); }));
    return files;
  });
}

absl::StatusOr<Page<StoredFile>> SqliteStore::StoredFiles(const PageRequest& page) {
  ASSIGN_OR_RETURN(const int size, CheckPageSize(page, limits_.Get()));
  return Read([&]() -> absl::StatusOr<Page<StoredFile>> {
    Page<StoredFile> result;
    Place last = PlaceOf(page.token);
    // Both give: owner, its id, path, size, checksums.
    const auto list = [&](const char* sql, bool of_job) {
      const Place from = last.of_job == of_job ? last : Place{.of_job = of_job};
      const int left = size - static_cast<int>(result.items.size());
      return database_->Run(sql, {from.owner, from.path, left}, [&](const SqlRow& row) {
        last = {.of_job = of_job, .owner = row.Int64(0), .path = row.Text(2)};
        StoredFile file = {.resource = (of_job ? "jobs/" : "sequences/") + row.Text(1)};
        file.path = absl::StrCat(file.resource, "/", last.path);
        if (!row.IsNull(4)) file.checksum = ToChecksum(row, 2);
        result.items.push_back(std::move(file));
      });
    };
    if (!last.of_job) {
      // Of an upload that is not finished, the files that are complete have checksums.
      RETURN_IF_ERROR(
          list("SELECT f.sequence, s.id, f.path, f.size_bytes, f.checksums FROM files f "
               "JOIN sequences s ON s.number = f.sequence JOIN uploads u ON u.number = f.upload "
               "WHERE (f.sequence, f.path) > (?, ?) AND (f.checksums IS NOT NULL OR u.finished = 1) "
               "ORDER BY f.sequence, f.path LIMIT ?",
               /*of_job=*/false));
    }
    if (static_cast<int>(result.items.size()) < size) {
      RETURN_IF_ERROR(
          list("SELECT f.job, j.id, f.path, f.size_bytes, f.checksums FROM job_files f "
               "JOIN jobs j ON j.number = f.job WHERE (f.job, f.path) > (?, ?) "
               "ORDER BY f.job, f.path LIMIT ?",
               /*of_job=*/true));
    }
    if (static_cast<int>(result.items.size()) == size) result.next_token = ToText(last);
    return result;
  });
}

absl::StatusOr<int64_t> SqliteStore::StoredBytes() {
  return Read([&]() -> absl::StatusOr<int64_t> {
    ASSIGN_OR_RETURN(const std::optional<int64_t> uploaded,
                     database_->Number("SELECT sum(size_bytes) FROM files WHERE checksums IS NOT NULL"));
    ASSIGN_OR_RETURN(const std::optional<int64_t> made, database_->Number("SELECT sum(size_bytes) FROM job_files"));
    return uploaded.value_or(0) + made.value_or(0);
  });
}

absl::StatusOr<ScrubRecord> SqliteStore::GetScrub() {
  return Read([&]() -> absl::StatusOr<ScrubRecord> {
    ScrubRecord record;
    RETURN_IF_ERROR(database_->Run("SELECT start_time_us, cursor FROM scrub", {}, [&record](const SqlRow& row) {
      record.start_time = absl::FromUnixMicros(row.Int64(0));
      record.over = row.Text(1) == kRoundOver;
      if (!record.over) record.cursor = row.Text(1);
    }));
    return record;
  });
}

absl::Status SqliteStore::SetScrub(const ScrubRecord& scrub) {
  return Transact([&]() -> absl::Status {
    RETURN_IF_ERROR(database_->Run("DELETE FROM scrub"));
    return database_->Run("INSERT INTO scrub (start_time_us, cursor) VALUES (?, ?)",
                          {absl::ToUnixMicros(scrub.start_time), scrub.over ? kRoundOver : scrub.cursor});
  });
}

}  // namespace depthtween::server
