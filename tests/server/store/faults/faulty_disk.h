// A disk in memory under SQLite, which fails when it is told to, and as real disks do.
//
// It keeps apart what a reader sees and what would be there after a power cut. A write becomes durable with the next
// sync of its file; at a power cut any sectors of what was not synced may have reached the disk, in any order. A sync
// that fails loses what it was to write, as Linux does: the bytes are still read, but no later sync writes them. The
// name of a new file is durable once a journal or a log of SQLite was synced for the first time, which is when SQLite
// syncs the folder.
//
// While one lives it is SQLite's default file system, so that a program opens databases on it without knowing. Threads:
// one at a time.
#ifndef DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_DISK_H_
#define DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_DISK_H_

#include <sqlite3.h>

#include <cstdint>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace depthtween::server {

enum class FaultKind {
  kFull,        // nothing is written: ENOSPC, also for a new file
  kShortWrite,  // a part is written, then the disk is full
  kWriteError,  // EIO, also when a file is cut or deleted
  kSyncError,   // EIO, and what was to be made durable never is
  kReadError,   // EIO
  kPowerCut     // from here on nothing reaches the disk, until CutPower
};
inline constexpr FaultKind kFaultKinds[] = {FaultKind::kFull,      FaultKind::kShortWrite, FaultKind::kWriteError,
                                            FaultKind::kSyncError, FaultKind::kReadError,  FaultKind::kPowerCut};
std::string_view ToString(FaultKind kind);

class FaultyDisk {
 public:
  explicit FaultyDisk(uint32_t seed);
  ~FaultyDisk();
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  // The n-th operation from now on (0 first) that a fault of this kind can hit fails; with `lasts` all after it, too.
  void Arm(FaultKind kind, int64_t n, bool lasts = false);
  // Whether that has happened.
  bool struck() const { return struck_; }
  // How many such operations there were since Arm.
  int64_t operations() const { return operations_; }
  // Nothing fails any more.
  void Repair();
  // What a power cut leaves. Databases that are open must be closed without using them further.
  void CutPower();

  // All files as they are, with what is durable of them. Putting them back is what a killed program leaves: files that
  // are open meanwhile become those of nobody.
  struct File;
  using Image = std::map<std::string, File>;
  Image Copy() const;
  void PutBack(const Image& image);
  // Turns one bit over, durably. False if there is no such file or it is empty.
  bool FlipBit(const std::string& path);

  struct Change {
    int64_t offset = 0;
    std::string bytes;
    bool cut = false;  // the file ends at `offset`
  };
  struct File {
    std::string now;
    std::string durable;
    std::vector<Change> pending;  // since the last sync
    bool name_durable = false;
    bool journal = false;  // or log: its first sync is one of the folder
  };

 private:
  friend struct Calls;  // SQLite's view of it
  // A file that is open outlives its name.
  struct Node : File {
    int shared_users = 0;
    std::vector<std::unique_ptr<char[]>> shared_memory;
  };
  enum class Operation { kRead, kWrite, kCut, kSync, kCreate, kDelete };
  // Whether the armed fault hits this operation.
  bool Hits(Operation operation);
  void SyncNames();

  sqlite3_vfs vfs_ = {};
  sqlite3_vfs* const real_;
  std::minstd_rand random_;
  std::map<std::string, std::shared_ptr<Node>> names_;
  std::map<std::string, std::shared_ptr<Node>> deleted_;  // whose names may come back at a power cut
  FaultKind kind_ = FaultKind::kFull;
  int64_t left_ = -1;  // operations before the fault; -1: none is armed
  bool lasts_ = false;
  bool struck_ = false;
  int64_t operations_ = 0;
  int last_error_ = 0;  // errno of the last failure
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_STORE_FAULTS_FAULTY_DISK_H_
