// A recording on this machine: which of its files are sent, and the hash that identifies it.
//
// A sequence folder holds rgb.txt and depth.txt ("timestamp filename" a line, # comments), camera.json and the frames
// that the lists name. Only those are sent: no ground truth beside them, nothing outside the folder. Or it is a zip
// archive of such a folder, which is sent as it is. The server checks what the files contain.
#ifndef DEPTHTWEEN_CLIENT_LIB_LOCAL_SEQUENCE_H_
#define DEPTHTWEEN_CLIENT_LIB_LOCAL_SEQUENCE_H_

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "client/lib/status.h"

namespace depthtween::client {

struct LocalFile {
  std::string path;  // relative to the folder, "/" between folders
  int64_t size_bytes = 0;
  std::string sha256;  // 32 bytes; empty until HashFiles
};

struct LocalSequence {
  std::string directory;     // that the files' paths are relative to
  std::string display_name;  // the folder's or the archive's own name, where a server takes it
  std::vector<LocalFile>
      files;  // camera.json, rgb.txt, depth.txt, then the frames in the order of the lists, each once
  int64_t size_bytes = 0;
  std::string fingerprint;  // hexadecimal SHA-256 over name and files; empty until HashFiles
};

// Lists the files of a recording without reading the frames. NotFound names every file that is missing; InvalidArgument
// a name that leads out of the folder.
absl::StatusOr<LocalSequence> FindSequence(const std::string& directory);

// Reads every file once and fills in the hashes. `on_bytes` is told how many bytes have been read; may be empty.
// Aborted if a file has become shorter since FindSequence.
absl::Status HashFiles(LocalSequence& sequence, const std::function<void(int64_t bytes_done)>& on_bytes);

// The bytes of several files, one after another, as one upload carries them.
class ConcatenatedFiles {
 public:
  // Both must outlive this.
  ConcatenatedFiles(const std::string& directory, std::span<const LocalFile> files);
  ~ConcatenatedFiles();
  ConcatenatedFiles(const ConcatenatedFiles&) = delete;
  ConcatenatedFiles& operator=(const ConcatenatedFiles&) = delete;

  int64_t size_bytes() const { return begins_.back(); }
  // `count` bytes from `offset` on; fewer only at the end. Aborted if a file has become shorter than it was.
  absl::StatusOr<std::string> Read(int64_t offset, int64_t count);

 private:
  absl::Status Open(size_t index);

  const std::string& directory_;
  const std::span<const LocalFile> files_;
  std::vector<int64_t> begins_;  // of every file, and the end of the last
  size_t open_index_;            // files_.size() when none is open
  int descriptor_ = -1;
};

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_LOCAL_SEQUENCE_H_
