// What a server looks at before it starts to work: whether its data folder and its database belong together, and what
// lies in the folder without a record. A database that was lost, emptied or restored from a backup must cost no files.
#ifndef DEPTHTWEEN_SERVER_JOBS_INVENTORY_H_
#define DEPTHTWEEN_SERVER_JOBS_INVENTORY_H_

#include "core/base/status.h"
#include "server/store/data_directory.h"
#include "server/store/store.h"

namespace depthtween::server {

// Ties a new store to a folder without recordings and jobs. FailedPrecondition if the store is of another folder, or is
// new although the folder has recordings or jobs; `accept_new_store` ties it all the same, to go on after a loss.
absl::Status CheckStoreIsOfFolder(const DataDirectory& directory, Store& store, bool accept_new_store);

// Moves recordings and jobs that the store has no record of into quarantine, and logs each. A server that died while it
// deleted leaves such folders, too.
absl::Status QuarantineWhatHasNoRecord(DataDirectory& directory, Store& store);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_INVENTORY_H_
