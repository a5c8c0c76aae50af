// An output's frames as one zip archive, made of the chunks of StreamFrames as they come.
//
// What Range needs, the place and the CRC-32 of every frame, is known once all frames have been read: sizes stand
// nowhere else, and the checksum of StreamFrames is another one. So a whole archive leaves at once and without a
// length, and the first request for a part of it reads all frames before it is answered; then the layout is kept for a
// while.
#ifndef DEPTHTWEEN_SERVER_HTTP_FRAME_ARCHIVE_H_
#define DEPTHTWEEN_SERVER_HTTP_FRAME_ARCHIVE_H_

#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/status.h"
#include "depthtween/v1/output.pb.h"
#include "server/http/zip_index.h"

namespace depthtween::server {

// Which files the archive holds, and the frames that they are.
struct ArchiveLayout {
  ZipIndex index;
  std::vector<int> frames;  // of the entries
  int next_frame = 0;       // the first one that is not in it

  int64_t memory_bytes() const;
};

// Chunks in, archive out. A frame that has nothing to give has no file.
//
// Threads: one at a time.
class ArchiveBuilder {
 public:
  // `folder` is Output.file_name. Of an archive that begins later than with its first file, the offsets of the layout
  // count from there.
  explicit ArchiveBuilder(std::string folder) : folder_(std::move(folder)) {}

  // What a chunk adds to the archive: bytes before its data, the data, bytes behind. Valid until the next call.
  struct Piece {
    std::string before;
    std::string_view data;
    std::string after;
  };
  // Errors: DataLoss if the chunks do not fit together.
  absl::StatusOr<Piece> Add(const v1::FrameChunk& chunk);

  // Of what was added.
  const ArchiveLayout& layout() const { return layout_; }
  ArchiveLayout TakeLayout() { return std::move(layout_); }

 private:
  const std::string folder_;
  ArchiveLayout layout_;
  // The frame that is being added.
  std::string name_;
  int64_t size_bytes_ = 0;
  int64_t received_bytes_ = 0;
  uint32_t crc32_ = 0;
  bool open_ = false;
};

// The part of a stream of bytes that is wanted: skips, then lets through, then is full.
class ByteWindow {
 public:
  ByteWindow(int64_t skip_bytes, int64_t size_bytes) : skip_(skip_bytes), left_(size_bytes) {}
  // Of the next `bytes` of the stream, those that are wanted.
  std::string_view Cut(std::string_view bytes);
  bool full() const { return left_ == 0; }

 private:
  int64_t skip_;
  int64_t left_;
};

// Layouts of archives that were read before, by their ETag; the least recently used go first.
//
// Threads: all methods may be called concurrently.
class ArchiveLayouts {
 public:
  explicit ArchiveLayouts(int64_t limit_bytes) : limit_bytes_(limit_bytes) {}
  // nullptr if it is not there.
  std::shared_ptr<const ArchiveLayout> Find(std::string_view etag);
  void Keep(std::string_view etag, std::shared_ptr<const ArchiveLayout> layout);

 private:
  const int64_t limit_bytes_;
  std::mutex mutex_;
  std::list<std::pair<std::string, std::shared_ptr<const ArchiveLayout>>> layouts_;  // guarded by mutex_; newest first
  int64_t bytes_ = 0;                                                                // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_FRAME_ARCHIVE_H_
