// BlobStore in a folder: sequences/<id>/<path>, so that child processes read a sequence as the folder it is.
#ifndef DEPTHTWEEN_SERVER_STORE_FOLDER_BLOB_STORE_H_
#define DEPTHTWEEN_SERVER_STORE_FOLDER_BLOB_STORE_H_

#include <memory>

#include "server/store/blob_store.h"
#include "server/store/data_directory.h"

namespace depthtween::server {

// Borrows `directory`.
std::unique_ptr<BlobStore> MakeFolderBlobStore(DataDirectory& directory);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_FOLDER_BLOB_STORE_H_
