// Files of sequences in memory, on a disk that fails when it is told to: a BlobStore with the faults of faulty_disk.h.
//
// What was written is durable after the next MakeDurable. One that fails loses what it was to write, in all files. At a
// power cut any of the writes that were not durable may have reached the disk. Threads: one at a time.
#ifndef DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_BLOBS_H_
#define DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_BLOBS_H_

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/blob_store.h"
#include "server/store/error_info.h"
#include "tests/server/store/faults/faulty_disk.h"

namespace depthtween::server {

class FaultyBlobs : public BlobStore {
 public:
  explicit FaultyBlobs(uint32_t seed) : random_(seed) {}

  // As FaultyDisk.
  void Arm(FaultKind kind, int64_t n, bool lasts = false) {
    kind_ = kind;
    left_ = n;
    lasts_ = lasts || kind == FaultKind::kPowerCut;
    struck_ = false;
  }
  bool struck() const { return struck_; }
  void Repair() { left_ = -1; }
  void CutPower() {
    Repair();
    for (auto& [path, file] : files_) {
      for (const FaultyDisk::Change& change : file.pending) {
        if (random_() % 2 == 0) Apply(change, file.durable);
      }
      file.pending.clear();
      file.now = file.durable;
    }
  }
  // What a reader sees; empty if there is no such file.
  std::string Content(const std::string& sequence_id, const std::string& path) const {
    const auto found = files_.find(absl::StrCat(sequence_id, "/", path));
    return found == files_.end() ? "" : found->second.now;
  }

  absl::Status Write(std::string_view sequence_id, std::string_view path, int64_t offset,
                     std::string_view bytes) override {
    FaultyDisk::File& file = files_[absl::StrCat(View(sequence_id), "/", View(path))];
    absl::Status status;
    if (Hits({FaultKind::kFull, FaultKind::kShortWrite, FaultKind::kWriteError, FaultKind::kPowerCut})) {
      if (kind_ == FaultKind::kWriteError || kind_ == FaultKind::kPowerCut) return ErrnoStatus(EIO, "write");
      bytes = bytes.substr(0, kind_ == FaultKind::kFull ? 0 : bytes.size() / 2);
      status = DiskFull("write");
    }
    for (const FaultyDisk::Change& change : {FaultyDisk::Change{.offset = offset, .cut = true},
                                             FaultyDisk::Change{.offset = offset, .bytes = std::string(bytes)}}) {
      Apply(change, file.now);
      file.pending.push_back(change);
    }
    return status;
  }

  absl::Status MakeDurable() override {
    const bool hit = Hits({FaultKind::kSyncError, FaultKind::kPowerCut});
    if (hit && kind_ == FaultKind::kPowerCut) return ErrnoStatus(EIO, "sync");
    for (auto& [path, file] : files_) {
      if (!hit) {
        for (const FaultyDisk::Change& change : file.pending) Apply(change, file.durable);
      }
      file.pending.clear();
    }
    if (hit) ++failed_syncs_;
    return hit ? ErrnoStatus(EIO, "sync") : absl::OkStatus();
  }
  int64_t FailedSyncs() const override { return failed_syncs_; }

  absl::Status Read(std::string_view sequence_id, std::string_view path, int64_t size,
                    const std::function<void(std::string_view)>& sink) override {
    if (Hits({FaultKind::kReadError})) return ErrnoStatus(EIO, "read");
    const std::string content = Content(std::string(sequence_id), std::string(path));
    if (static_cast<int64_t>(content.size()) < size) return absl::DataLossError("too short");
    sink(std::string_view(content).substr(0, static_cast<size_t>(size)));
    return absl::OkStatus();
  }

  absl::Status RemoveFile(std::string_view sequence_id, std::string_view path) override {
    if (Hits({FaultKind::kWriteError, FaultKind::kPowerCut})) return ErrnoStatus(EIO, "remove");
    files_.erase(absl::StrCat(View(sequence_id), "/", View(path)));
    return absl::OkStatus();
  }
  absl::Status Remove(std::string_view sequence_id) override {
    if (Hits({FaultKind::kWriteError, FaultKind::kPowerCut})) return ErrnoStatus(EIO, "remove");
    std::erase_if(files_, [&](const auto& entry) { return entry.first.starts_with(sequence_id); });
    return absl::OkStatus();
  }

  absl::StatusOr<int64_t> FreeBytes() override { return int64_t{1} << 40; }

 private:
  bool Hits(const std::vector<FaultKind>& kinds) {
    if (left_ < 0 || std::find(kinds.begin(), kinds.end(), kind_) == kinds.end()) return false;
    if (left_ > 0) {
      --left_;
      return false;
    }
    if (!lasts_) left_ = -1;
    return struck_ = true;
  }
  static void Apply(const FaultyDisk::Change& change, std::string& content) {
    const auto offset = static_cast<size_t>(change.offset);
    if (change.cut || content.size() < offset) content.resize(offset);
    content.replace(offset, change.bytes.size(), change.bytes);
  }

  std::minstd_rand random_;
  std::map<std::string, FaultyDisk::File> files_;
  FaultKind kind_ = FaultKind::kFull;
  int64_t left_ = -1;
  bool lasts_ = false;
  bool struck_ = false;
  int64_t failed_syncs_ = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_BLOBS_H_
