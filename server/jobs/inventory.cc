#include "server/jobs/inventory.h"

#include <optional>

#include "absl/strings/str_cat.h"
#include "server/store/files.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

absl::Status QuarantineOne(DataDirectory& directory, const std::string& folder, const std::string& kind,
                           const std::string& id) {
  ASSIGN_OR_RETURN(const std::string to, directory.Quarantine(folder, absl::StrCat(kind, "-", id)));
  LogWarning("quarantined", {{"what", absl::StrCat(kind, "/", id)},
                             {"to", to},
                             {"why", "the database has no record of it; it is deleted after --quarantine-days"}});
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckStoreIsOfFolder(const DataDirectory& directory, Store& store, bool accept_new_store) {
  ASSIGN_OR_RETURN(const std::optional<std::string> id, store.FolderId());
  if (id == directory.id()) return absl::OkStatus();
  if (id) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory.DatabaseFile(), " belongs to another data folder, whose id is ", *id, "; the id of ",
                     directory.path(), " is ", directory.id(), ". Put this folder's own database back"));
  }
  const size_t sequences = NamesIn(directory.SequencesFolder()).size(), jobs = NamesIn(directory.JobsFolder()).size();
  if (sequences + jobs > 0 && !accept_new_store) {
    return absl::FailedPreconditionError(absl::StrCat(
        directory.path(), " has ", sequences, " recordings and ", jobs, " jobs, but its database, ",
        directory.DatabaseFile(), ", was missing or empty. Put the database back, or start with --new-database: that ",
        "moves them to ", directory.QuarantineFolder(), ", where they are kept for --quarantine-days"));
  }
  return store.SetFolderId(directory.id());
}

absl::Status QuarantineWhatHasNoRecord(DataDirectory& directory, Store& store) {
  for (const std::string& id : NamesIn(directory.JobsFolder())) {
    if (absl::IsNotFound(store.GetJob(Tenant::Everyone(), id).status())) {
      RETURN_IF_ERROR(QuarantineOne(directory, directory.JobFolder(id), "jobs", id));
    }
  }
  for (const std::string& id : NamesIn(directory.SequencesFolder())) {
    if (absl::IsNotFound(store.GetSequence(Tenant::Everyone(), id).status())) {
      RETURN_IF_ERROR(QuarantineOne(directory, directory.SequenceFolder(id), "sequences", id));
    }
  }
  return absl::OkStatus();
}

}  // namespace depthtween::server
