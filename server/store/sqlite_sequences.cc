// Sequences and uploads.
#include <algorithm>
#include <set>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"
#include "proto/depthtween/sha256.h"
#include "server/store/error_info.h"
#include "server/store/path_rules.h"
#include "server/store/records_json.h"
#include "server/store/resource_names.h"
#include "server/store/sqlite_store_impl.h"

namespace depthtween::server {
namespace {

std::string SequenceScope(const Tenant& tenant) { return "sequence/" + tenant.name(); }

std::string UploadScope(std::string_view sequence_id) { return "upload/" + std::string(sequence_id); }

int64_t NowUs() { return absl::ToUnixMicros(absl::Now()); }

// Of arguments in an order that is fixed; lengths keep "ab","c" and "a","bc" apart.
std::string Fingerprint(const std::vector<UploadFile>& files, std::string_view metadata) {
  Sha256 hash;
  for (const UploadFile& file : files) {
    hash.Update(absl::StrCat(file.path.size(), ":", file.path, " ", file.size_bytes, " ", Hex(file.sha256), "\n"));
  }
  hash.Update(metadata);
  return Hex(hash.Finish());
}

std::string Fingerprint(std::string_view text) {
  Sha256 hash;
  hash.Update(text);
  return Hex(hash.Finish());
}

constexpr char kSequenceColumns[] =
    "SELECT id, display_name, state, create_time_us, update_time_us, size_bytes, file_count, validation, number, "
    "tenant, pinned FROM sequences ";

absl::StatusOr<SequenceRecord> ToSequence(const SqlRow& row) {
  SequenceRecord record = {.id = row.Text(0),
                           .display_name = row.Text(1),
                           .state = static_cast<SequenceState>(row.Int(2)),
                           .create_time = absl::FromUnixMicros(row.Int64(3)),
                           .update_time = absl::FromUnixMicros(row.Int64(4)),
                           .size_bytes = row.Int64(5),
                           .file_count = row.Int(6),
                           .tenant = row.Text(9),
                           .pinned = row.Int(10) != 0};
  if (!row.IsNull(7)) {
    ASSIGN_OR_RETURN(record.validation, ValidationResultFromJson(row.Text(7)));
  }
  return record;
}

}  // namespace

absl::StatusOr<int64_t> SqliteStore::SequenceNumber(const Tenant& tenant, std::string_view id) {
  ASSIGN_OR_RETURN(const std::optional<int64_t> number,
                   database_->Number("SELECT number FROM sequences WHERE id = ?1 AND (?2 = '' OR tenant = ?2)",
                                     {id, tenant.name()}));
  if (!number) return NoSuchResource("sequences/" + std::string(id));
  return *number;
}

absl::StatusOr<SequenceRecord> SqliteStore::ReadSequence(const Tenant& tenant, std::string_view id) {
  static const std::string sql = std::string(kSequenceColumns) + "WHERE id = ?1 AND (?2 = '' OR tenant = ?2)";
  absl::StatusOr<SequenceRecord> record = NoSuchResource("sequences/" + std::string(id));
  RETURN_IF_ERROR(
      database_->Run(sql.c_str(), {id, tenant.name()}, [&record](const SqlRow& row) { record = ToSequence(row); }));
  return record;
}

absl::Status SqliteStore::TouchSequence(int64_t number, SequenceState state) {
  return database_->Run("UPDATE sequences SET state = ?, update_time_us = ? WHERE number = ?",
                        {state, NowUs(), number});
}

absl::StatusOr<SequenceRecord> SqliteStore::CreateSequence(const Tenant& tenant, std::string_view display_name,
                                                           std::string_view request_id) {
  if (tenant.name().empty()) return absl::InternalError("CreateSequence needs a tenant");
  RETURN_IF_ERROR(CheckText("sequence.display_name", display_name, limits_.Get().max_display_name_bytes));
  const std::string fingerprint = Fingerprint(display_name);
  return Transact([&]() -> absl::StatusOr<SequenceRecord> {
    ASSIGN_OR_RETURN(const std::optional<std::string> made, MadeBefore(SequenceScope(tenant), request_id, fingerprint));
    if (made) return ReadSequence(tenant, *made);
    const std::string id = NewId();
    const int64_t now = NowUs();
    RETURN_IF_ERROR(
        database_->Run("INSERT INTO sequences (id, display_name, state, create_time_us, update_time_us, tenant) VALUES "
                       "(?, ?, ?, ?, ?, ?)",
                       {id, display_name, SequenceState::kUploading, now, now, tenant.name()}));
    RETURN_IF_ERROR(RememberRequest(SequenceScope(tenant), request_id, fingerprint, id));
    return ReadSequence(tenant, id);
  });
}

absl::StatusOr<SequenceRecord> SqliteStore::GetSequence(const Tenant& tenant, std::string_view id) {
  return Read([&] { return ReadSequence(tenant, id); });
}

absl::StatusOr<Page<SequenceRecord>> SqliteStore::ListSequences(const Tenant& tenant, const SequenceFilter& filter,
                                                                const PageRequest& page) {
  const int state = filter.state ? static_cast<int>(*filter.state) : 0;
  const std::string list = absl::StrCat("sequences of ", tenant.name(), " state=", state);
  ASSIGN_OR_RETURN(const int64_t before, ParsePageToken(page, list));
  ASSIGN_OR_RETURN(const int size, CheckPageSize(page, limits_.Get()));
  static const std::string sql =
      std::string(kSequenceColumns) +
      "WHERE number < ?1 AND (?2 = 0 OR state = ?2) AND (?4 = '' OR tenant = ?4) ORDER BY number DESC LIMIT ?3";
  return Read([&]() -> absl::StatusOr<Page<SequenceRecord>> {
    Page<SequenceRecord> result;
    absl::Status damage;
    int64_t last = 0;
    bool more = false;
    // One row beyond the page tells whether there is a next one.
    RETURN_IF_ERROR(database_->Run(sql.c_str(), {before, state, size + 1, tenant.name()}, [&](const SqlRow& row) {
      more = static_cast<int>(result.items.size()) == size;
      if (more) return;
      absl::StatusOr<SequenceRecord> record = ToSequence(row);
      damage.Update(record.status());
      if (record.ok()) result.items.push_back(*std::move(record));
      last = row.Int64(8);
    }));
    RETURN_IF_ERROR(damage);
    if (more) result.next_token = MakePageToken(last, list);
    return result;
  });
}

absl::Status SqliteStore::DeleteSequence(const Tenant& tenant, std::string_view id) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const SequenceRecord record, ReadSequence(tenant, id));
    std::string job;
    RETURN_IF_ERROR(database_->Run("SELECT id FROM jobs WHERE sequence_id = ? AND state IN (1, 2, 3) LIMIT 1", {id},
                                   [&job](const SqlRow& row) { job = row.Text(0); }));
    if (!job.empty()) {
      return WrongState(ToString(record.state),
                        absl::StrCat("jobs/", job, " still needs the sequence; cancel it first"));
    }
    return RemoveSequence(id);
  });
}

absl::Status SqliteStore::RemoveSequence(std::string_view id) {
  RETURN_IF_ERROR(database_->Run("DELETE FROM requests WHERE made_id = ? OR scope = ?", {id, UploadScope(id)}));
  return database_->Run("DELETE FROM sequences WHERE id = ?", {id});
}

absl::Status SqliteStore::CheckNewFiles(int64_t sequence, const std::vector<UploadFile>& files) {
  const auto duplicate = [](const std::string& path, absl::string_view message) {
    return WithErrorInfo(absl::AlreadyExistsError(absl::StrCat("path \"", path, "\" ", message)),
                         {.reason = "DUPLICATE_PATH", .metadata = {{"path", path}}});
  };
  std::set<std::string_view> paths;
  for (const UploadFile& file : files) {
    if (!paths.insert(file.path).second) return duplicate(file.path, "is twice in the manifest; name each file once");
  }
  // A name cannot be a file and a folder.
  for (const UploadFile& file : files) {
    for (size_t slash = file.path.find('/'); slash != std::string::npos; slash = file.path.find('/', slash + 1)) {
      const std::string folder = file.path.substr(0, slash);
      ASSIGN_OR_RETURN(const std::optional<int64_t> is_file,
                       database_->Number("SELECT 1 FROM files WHERE sequence = ? AND path = ?", {sequence, folder}));
      if (is_file || paths.count(folder) > 0) return duplicate(folder, "would be both a file and a folder");
    }
    ASSIGN_OR_RETURN(const std::optional<int64_t> exists,
                     database_->Number("SELECT 1 FROM files WHERE sequence = ? AND path = ?", {sequence, file.path}));
    if (exists) return duplicate(file.path, "is already part of the sequence; resume the upload that carries it");
    // '0' is the character after '/': the range holds everything inside a folder of this name.
    ASSIGN_OR_RETURN(const std::optional<int64_t> is_folder,
                     database_->Number("SELECT 1 FROM files WHERE sequence = ? AND path > ? AND path < ? LIMIT 1",
                                       {sequence, file.path + "/", file.path + "0"}));
    if (is_folder) return duplicate(file.path, "would be both a file and a folder");
  }
  return absl::OkStatus();
}

absl::Status SqliteStore::CheckTenantBytes(const std::string& tenant, int64_t more_bytes) {
  const int64_t most = limits_.Get().max_tenant_bytes;
  if (most == 0) return absl::OkStatus();
  ASSIGN_OR_RETURN(const std::optional<int64_t> own_bytes,
                   database_->Number("SELECT sum(size_bytes) FROM sequences WHERE tenant = ?", {tenant}));
  if (more_bytes <= most - own_bytes.value_or(0)) return absl::OkStatus();
  return LimitExceeded("max_tenant_bytes", most,
                       absl::StrFormat("the recordings of the tenant %s would have %d bytes, at most %d are allowed; "
                                       "delete some",
                                       tenant, own_bytes.value_or(0) + more_bytes, most));
}

absl::StatusOr<UploadRecord> SqliteStore::CreateUpload(const Tenant& tenant, std::string_view sequence_id,
                                                       const std::vector<UploadFile>& files, int64_t room_bytes,
                                                       std::string_view request_id, std::string_view metadata) {
  const Limits limits = limits_.Get();
  RETURN_IF_ERROR(CheckText("upload.metadata", metadata, limits.max_upload_metadata_bytes));
  if (!std::all_of(metadata.begin(), metadata.end(), [](char c) { return c >= ' ' && c <= '~'; })) {
    return BadField("upload.metadata", "upload.metadata has a byte that is not printable ASCII; encode it as base64");
  }
  if (files.empty()) return BadField("upload.files", "upload.files is empty, must name at least one file");
  if (files.size() > static_cast<size_t>(limits.max_files_per_upload)) {
    return LimitExceeded("max_files_per_upload", limits.max_files_per_upload,
                         absl::StrFormat("upload.files has %d files, at most %d are allowed; use several uploads",
                                         files.size(), limits.max_files_per_upload));
  }
  std::vector<std::string_view> paths;
  paths.reserve(files.size());
  for (const UploadFile& file : files) paths.emplace_back(file.path);
  RETURN_IF_ERROR(CheckRelativePaths(paths));
  int64_t size_bytes = 0;
  for (const UploadFile& file : files) {
    if (file.size_bytes < 0) {
      return BadField("upload.files.size_bytes",
                      absl::StrFormat("%s: size_bytes = %d, must be >= 0", file.path, file.size_bytes));
    }
    if (!file.sha256.empty() && file.sha256.size() != 32) {
      return BadField("upload.files.sha256",
                      absl::StrFormat("%s: sha256 has %d bytes, must have 32, or none", file.path, file.sha256.size()));
    }
    // Compared before it is added, so that no sum can overflow.
    if (file.size_bytes > limits.max_sequence_bytes - size_bytes) {
      return LimitExceeded("max_sequence_bytes", limits.max_sequence_bytes,
                           absl::StrFormat("%s: with it the upload exceeds the %d bytes a sequence may have", file.path,
                                           limits.max_sequence_bytes));
    }
    size_bytes += file.size_bytes;
  }
  const std::string fingerprint = Fingerprint(files, metadata);
  return Transact([&]() -> absl::StatusOr<UploadRecord> {
    ASSIGN_OR_RETURN(const SequenceRecord sequence, ReadSequence(tenant, sequence_id));
    ASSIGN_OR_RETURN(const std::optional<std::string> made,
                     MadeBefore(UploadScope(sequence_id), request_id, fingerprint));
    if (made) return ReadUpload(tenant, *made);
    if (sequence.state != SequenceState::kUploading) {
      return WrongState(ToString(sequence.state), "the sequence is committed and takes no more files; create another");
    }
    if (size_bytes > limits.max_sequence_bytes - sequence.size_bytes) {
      return LimitExceeded("max_sequence_bytes", limits.max_sequence_bytes,
                           absl::StrFormat("the sequence would have %d bytes, at most %d are allowed",
                                           sequence.size_bytes + size_bytes, limits.max_sequence_bytes));
    }
    RETURN_IF_ERROR(CheckTenantBytes(sequence.tenant, size_bytes));
    const int64_t file_count = sequence.file_count + static_cast<int64_t>(files.size());
    if (file_count > limits.max_files_per_sequence) {
      return LimitExceeded("max_files_per_sequence", limits.max_files_per_sequence,
                           absl::StrFormat("the sequence would have %d files, at most %d are allowed", file_count,
                                           limits.max_files_per_sequence));
    }
    if (limits.max_tenant_uploads > 0) {
      ASSIGN_OR_RETURN(const std::optional<int64_t> begun,
                       database_->Number("SELECT count(*) FROM uploads u JOIN sequences s ON s.number = u.sequence "
                                         "WHERE u.finished = 0 AND s.tenant = ?",
                                         {sequence.tenant}));
      if (*begun >= limits.max_tenant_uploads) {
        return LimitExceeded("max_tenant_uploads", limits.max_tenant_uploads,
                             absl::StrFormat("%d uploads of the tenant %s are begun and not finished, which is its "
                                             "limit; finish one, or delete its recording",
                                             *begun, sequence.tenant));
      }
    }
    ASSIGN_OR_RETURN(const std::optional<int64_t> announced,
                     database_->Number("SELECT sum(size_bytes - committed_size) FROM uploads WHERE finished = 0"));
    const int64_t room_left = std::max<int64_t>(0, room_bytes - announced.value_or(0));
    if (size_bytes > room_left) {
      return DiskFull(absl::StrFormat(
          "the upload needs %d bytes, there is room for %d beside the uploads that have begun", size_bytes, room_left));
    }
    ASSIGN_OR_RETURN(const int64_t number, SequenceNumber(tenant, sequence_id));
    RETURN_IF_ERROR(CheckNewFiles(number, files));
    const std::string id = NewId();
    RETURN_IF_ERROR(
        database_->Run("INSERT INTO uploads (id, sequence, size_bytes, create_time_us, progress_time_us, metadata) "
                       "VALUES (?1, ?2, ?3, "
                       "?4, ?4, ?5)",
                       {id, number, size_bytes, NowUs(), metadata}));
    const int64_t upload = database_->LastInsertedRow();
    for (size_t position = 0; position < files.size(); ++position) {
      const UploadFile& file = files[position];
      RETURN_IF_ERROR(database_->Run(
          "INSERT INTO files (sequence, path, upload, position, size_bytes, sha256) VALUES (?, ?, ?, ?, ?, ?)",
          {number, file.path, upload, position, file.size_bytes, SqlValue::Blob{file.sha256}}));
    }
    RETURN_IF_ERROR(
        database_->Run("UPDATE sequences SET size_bytes = size_bytes + ?, file_count = file_count + ?, update_time_us "
                       "= ? WHERE number = ?",
                       {size_bytes, files.size(), NowUs(), number}));
    RETURN_IF_ERROR(RememberRequest(UploadScope(sequence_id), request_id, fingerprint, id));
    return ReadUpload(tenant, id);
  });
}

absl::StatusOr<UploadRecord> SqliteStore::ReadUpload(const Tenant& tenant, std::string_view id) {
  const absl::Duration keep = limits_.Get().keep_uploads;
  absl::StatusOr<UploadRecord> record = NoSuchResource("uploads/" + std::string(id));
  RETURN_IF_ERROR(database_->Run(
      "SELECT u.id, s.id, u.size_bytes, u.committed_size, u.finished, u.create_time_us, "
      "max(u.progress_time_us, s.update_time_us), u.metadata "
      "FROM uploads u JOIN sequences s ON s.number = u.sequence WHERE u.id = ?1 AND (?2 = '' OR s.tenant = ?2)",
      {id, tenant.name()}, [&record, keep](const SqlRow& row) {
        record = UploadRecord{.id = row.Text(0),
                              .sequence_id = row.Text(1),
                              .size_bytes = row.Int64(2),
                              .committed_size = row.Int64(3),
                              .finished = row.Int(4) != 0,
                              .create_time = absl::FromUnixMicros(row.Int64(5)),
                              .metadata = row.Text(7)};
        if (!record->finished && keep > absl::ZeroDuration()) {
          record->expire_time = absl::FromUnixMicros(row.Int64(6)) + keep;
        }
      }));
  return record;
}

absl::StatusOr<UploadRecord> SqliteStore::ReadUploadOf(const Tenant& tenant, std::string_view sequence_id,
                                                       std::string_view upload_id) {
  absl::StatusOr<UploadRecord> record = ReadUpload(tenant, upload_id);
  if (absl::IsNotFound(record.status()) || (record.ok() && record->sequence_id != sequence_id)) {
    return NoSuchResource(absl::StrFormat("sequences/%s/uploads/%s", std::string(sequence_id), std::string(upload_id)));
  }
  return record;
}

absl::StatusOr<UploadRecord> SqliteStore::GetUpload(const Tenant& tenant, std::string_view sequence_id,
                                                    std::string_view upload_id) {
  return Read([&] { return ReadUploadOf(tenant, sequence_id, upload_id); });
}

absl::StatusOr<std::vector<UploadFile>> SqliteStore::UploadFiles(std::string_view upload_id) {
  return Read([&]() -> absl::StatusOr<std::vector<UploadFile>> {
    std::vector<UploadFile> files;
    RETURN_IF_ERROR(
        database_->Run("SELECT path, f.size_bytes, sha256 FROM files f JOIN uploads u ON u.number = f.upload WHERE "
                       "u.id = ? ORDER BY position",
                       {upload_id}, [&files](const SqlRow& row) {
                         files.push_back({.path = row.Text(0), .size_bytes = row.Int64(1), .sha256 = row.Text(2)});
                       }));
    if (files.empty()) return NoSuchResource("uploads/" + std::string(upload_id));
    return files;
  });
}

absl::Status SqliteStore::SetCommittedSize(std::string_view upload_id, int64_t committed_size,
                                           const std::vector<FileChecksum>& complete) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const UploadRecord upload, ReadUpload(Tenant::Everyone(), upload_id));
    if (upload.finished) return WrongState("FINISHED", "the upload is finished and takes no more bytes");
    if (committed_size < 0 || committed_size > upload.size_bytes) {
      return absl::InternalError(
          absl::StrFormat("committed_size = %d, must be 0 to %d", committed_size, upload.size_bytes));
    }
    for (const FileChecksum& file : complete) {
      RETURN_IF_ERROR(
          database_->Run("UPDATE files SET checksums = ? WHERE path = ? AND sequence = (SELECT number FROM "
                         "sequences WHERE id = ?) AND size_bytes = ?",
                         {SqlValue::Blob{file.blocks}, file.path, upload.sequence_id, file.size_bytes}));
    }
    return database_->Run("UPDATE uploads SET committed_size = ?, progress_time_us = ? WHERE id = ?",
                          {committed_size, NowUs(), upload_id});
  });
}

absl::StatusOr<UploadRecord> SqliteStore::FinishUpload(std::string_view upload_id) {
  return Transact([&]() -> absl::StatusOr<UploadRecord> {
    ASSIGN_OR_RETURN(const UploadRecord upload, ReadUpload(Tenant::Everyone(), upload_id));
    if (upload.finished) return upload;
    if (upload.committed_size != upload.size_bytes) {
      return WrongState("RECEIVING", absl::StrFormat("the upload has %d of %d bytes; send the rest before finish",
                                                     upload.committed_size, upload.size_bytes));
    }
    RETURN_IF_ERROR(
        database_->Run("UPDATE uploads SET finished = 1, progress_time_us = ? WHERE id = ?", {NowUs(), upload_id}));
    return ReadUpload(Tenant::Everyone(), upload_id);
  });
}

absl::StatusOr<UploadRecord> SqliteStore::UnfinishedUpload(const Tenant& tenant, std::string_view sequence_id,
                                                           std::string_view upload_id) {
  ASSIGN_OR_RETURN(UploadRecord upload, ReadUploadOf(tenant, sequence_id, upload_id));
  if (!upload.finished) return upload;
  return WrongState("FINISHED", "the upload is finished: its files are part of the sequence; delete that");
}

absl::Status SqliteStore::RewindUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) {
  return Transact([&]() -> absl::Status {
    RETURN_IF_ERROR(UnfinishedUpload(tenant, sequence_id, upload_id).status());
    RETURN_IF_ERROR(database_->Run(
        "UPDATE files SET checksums = NULL WHERE upload = (SELECT number FROM uploads WHERE id = ?)", {upload_id}));
    return database_->Run("UPDATE uploads SET committed_size = 0 WHERE id = ?", {upload_id});
  });
}

absl::Status SqliteStore::DeleteUpload(const Tenant& tenant, std::string_view sequence_id, std::string_view upload_id) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const UploadRecord upload, UnfinishedUpload(tenant, sequence_id, upload_id));
    RETURN_IF_ERROR(database_->Run(
        "UPDATE sequences SET size_bytes = size_bytes - ?1, update_time_us = ?2, file_count = file_count - (SELECT "
        "count(*) FROM files f JOIN uploads u ON u.number = f.upload WHERE u.id = ?3) WHERE id = ?4",
        {upload.size_bytes, NowUs(), upload_id, sequence_id}));
    RETURN_IF_ERROR(database_->Run("DELETE FROM requests WHERE made_id = ?", {upload_id}));
    return database_->Run("DELETE FROM uploads WHERE id = ?", {upload_id});
  });
}

absl::StatusOr<SequenceRecord> SqliteStore::CommitSequence(const Tenant& tenant, std::string_view id) {
  return Transact([&]() -> absl::StatusOr<SequenceRecord> {
    ASSIGN_OR_RETURN(const SequenceRecord record, ReadSequence(tenant, id));
    if (record.state != SequenceState::kUploading) return record;
    if (record.file_count == 0)
      return WrongState("UPLOADING", "the sequence has no files; upload some before the commit");
    ASSIGN_OR_RETURN(const int64_t number, SequenceNumber(tenant, id));
    std::string unfinished;
    RETURN_IF_ERROR(
        database_->Run("SELECT id, committed_size, size_bytes FROM uploads WHERE sequence = ? AND finished = 0 LIMIT 1",
                       {number}, [&](const SqlRow& row) {
                         unfinished = absl::StrFormat("sequences/%s/uploads/%s has %d of %d bytes and is not finished",
                                                      std::string(id), row.Text(0), row.Int64(1), row.Int64(2));
                       }));
    if (!unfinished.empty()) return WrongState("UPLOADING", unfinished);
    RETURN_IF_ERROR(TouchSequence(number, SequenceState::kValidating));
    RETURN_IF_ERROR(AddTask(TaskKind::kValidate, number, /*failures=*/0));
    return ReadSequence(tenant, id);
  });
}

absl::StatusOr<std::optional<SequenceArchive>> SqliteStore::GetArchive(std::string_view sequence_id) {
  return Read([&]() -> absl::StatusOr<std::optional<SequenceArchive>> {
    std::optional<SequenceArchive> archive;
    RETURN_IF_ERROR(
        database_->Run("SELECT s.archive, (SELECT path FROM files WHERE sequence = s.number AND s.file_count = 1) FROM "
                       "sequences s WHERE s.id = ?",
                       {sequence_id}, [&archive](const SqlRow& row) {
                         if (const std::string was = row.Text(0); !was.empty()) {
                           archive = {.path = was, .unpacked = true};
                         } else if (!row.IsNull(1) && IsArchiveName(row.Text(1))) {
                           archive = {.path = row.Text(1)};
                         }
                       }));
    return archive;
  });
}

absl::Status SqliteStore::FinishUnpacking(int64_t task, const SequenceArchive& archive,
                                          const std::vector<FileChecksum>& files) {
  const Limits limits = limits_.Get();
  int64_t size_bytes = 0;
  for (const FileChecksum& file : files) size_bytes += file.size_bytes;
  if (size_bytes > limits.max_sequence_bytes) {
    return LimitExceeded("max_sequence_bytes", limits.max_sequence_bytes,
                         absl::StrFormat("the sequence would have %d bytes, at most %d are allowed", size_bytes,
                                         limits.max_sequence_bytes));
  }
  if (static_cast<int64_t>(files.size()) > limits.max_files_per_sequence) {
    return LimitExceeded("max_files_per_sequence", limits.max_files_per_sequence,
                         absl::StrFormat("the sequence would have %d files, at most %d are allowed", files.size(),
                                         limits.max_files_per_sequence));
  }
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    int64_t upload = 0, archive_bytes = 0;
    std::string tenant;
    RETURN_IF_ERROR(
        database_->Run("SELECT f.upload, f.size_bytes, s.tenant FROM files f JOIN sequences s ON s.number = f.sequence "
                       "WHERE s.number = ? AND f.path = ? AND s.archive = ''",
                       {row.sequence, archive.path}, [&](const SqlRow& found) {
                         upload = found.Int64(0);
                         archive_bytes = found.Int64(1);
                         tenant = found.Text(2);
                       }));
    if (upload == 0) return absl::InternalError(absl::StrCat("there is no archive ", archive.path, " to be unpacked"));
    RETURN_IF_ERROR(CheckTenantBytes(tenant, size_bytes - archive_bytes));
    RETURN_IF_ERROR(database_->Run("DELETE FROM files WHERE sequence = ?", {row.sequence}));
    for (size_t position = 0; position < files.size(); ++position) {
      const FileChecksum& file = files[position];
      RETURN_IF_ERROR(database_->Run(
          "INSERT INTO files (sequence, path, upload, position, size_bytes, sha256, checksums) VALUES (?, ?, ?, ?, ?, "
          "?, ?)",
          {row.sequence, file.path, upload, position, file.size_bytes, SqlValue::Blob{""},
           SqlValue::Blob{file.blocks}}));
    }
    return database_->Run(
        "UPDATE sequences SET archive = ?, size_bytes = ?, file_count = ?, update_time_us = ? WHERE number = ?",
        {archive.path, size_bytes, files.size(), NowUs(), row.sequence});
  });
}

absl::Status SqliteStore::FinishValidation(int64_t task, const ValidationResult& result) {
  return Transact([&]() -> absl::Status {
    ASSIGN_OR_RETURN(const TaskRow row, RunningTask(task));
    RETURN_IF_ERROR(
        database_->Run("UPDATE sequences SET validation = ? WHERE number = ?", {ToJson(result), row.sequence}));
    RETURN_IF_ERROR(TouchSequence(row.sequence, result.recording ? SequenceState::kReady : SequenceState::kInvalid));
    return RemoveTask(task);
  });
}

}  // namespace depthtween::server
