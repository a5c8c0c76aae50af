#include "tests/server/store/faults/faulty_disk.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace depthtween::server {
namespace {

constexpr int64_t kSectorBytes = 512;  // that a disk writes wholly or not at all

void Apply(const FaultyDisk::Change& change, std::string& content) {
  const auto offset = static_cast<size_t>(change.offset);
  if (change.cut) {
    content.resize(offset);
    return;
  }
  if (content.size() < offset + change.bytes.size()) content.resize(offset + change.bytes.size());
  content.replace(offset, change.bytes.size(), change.bytes);
}

}  // namespace

std::string_view ToString(FaultKind kind) {
  switch (kind) {
    case FaultKind::kFull:
      return "full disk";
    case FaultKind::kShortWrite:
      return "short write";
    case FaultKind::kWriteError:
      return "write error";
    case FaultKind::kSyncError:
      return "sync error";
    case FaultKind::kReadError:
      return "read error";
    case FaultKind::kPowerCut:
      return "power cut";
  }
  return "unknown";
}

// The functions that SQLite calls.
struct Calls {
  // What SQLite holds of an open file; it gives the memory.
  struct Handle {
    sqlite3_file base;
    struct State {
      FaultyDisk* disk;
      std::shared_ptr<FaultyDisk::Node> node;
      bool keep_log = false;
      bool maps_memory = false;
    } * state;
  };
  static Handle::State& Of(sqlite3_file* file) { return *reinterpret_cast<Handle*>(file)->state; }
  static FaultyDisk& Of(sqlite3_vfs* vfs) { return *static_cast<FaultyDisk*>(vfs->pAppData); }
  static int Fail(FaultyDisk& disk, int error_number, int code) {
    disk.last_error_ = error_number;
    return code;
  }

  static int Close(sqlite3_file* file) {
    ShmUnmap(file, 0);
    delete &Of(file);
    return SQLITE_OK;
  }

  static int Read(sqlite3_file* file, void* to, int size, sqlite3_int64 offset) {
    auto& [disk, node, keep_log, maps] = Of(file);
    if (disk->Hits(FaultyDisk::Operation::kRead)) return Fail(*disk, EIO, SQLITE_IOERR_READ);
    const std::string& content = node->now;
    const int64_t there = std::clamp<int64_t>(static_cast<int64_t>(content.size()) - offset, 0, size);
    if (there > 0) std::memcpy(to, content.data() + offset, static_cast<size_t>(there));
    std::memset(static_cast<char*>(to) + there, 0, static_cast<size_t>(size - there));
    return there == size ? SQLITE_OK : SQLITE_IOERR_SHORT_READ;
  }

  static int Write(sqlite3_file* file, const void* from, int size, sqlite3_int64 offset) {
    auto& [disk, node, keep_log, maps] = Of(file);
    int code = SQLITE_OK;
    if (disk->Hits(FaultyDisk::Operation::kWrite)) {
      switch (disk->kind_) {
        case FaultKind::kFull:
          return Fail(*disk, ENOSPC, SQLITE_FULL);
        case FaultKind::kShortWrite:
          size /= 2;
          code = Fail(*disk, 0, SQLITE_FULL);
          break;
        default:
          return Fail(*disk, EIO, SQLITE_IOERR_WRITE);
      }
    }
    FaultyDisk::Change change = {.offset = offset,
                                 .bytes = std::string(static_cast<const char*>(from), static_cast<size_t>(size))};
    Apply(change, node->now);
    node->pending.push_back(std::move(change));
    return code;
  }

  static int Truncate(sqlite3_file* file, sqlite3_int64 size) {
    auto& [disk, node, keep_log, maps] = Of(file);
    if (disk->Hits(FaultyDisk::Operation::kCut)) return Fail(*disk, EIO, SQLITE_IOERR_TRUNCATE);
    FaultyDisk::Change change = {.offset = size, .cut = true};
    Apply(change, node->now);
    node->pending.push_back(std::move(change));
    return SQLITE_OK;
  }

  static int Sync(sqlite3_file* file, int /*flags*/) {
    auto& [disk, node, keep_log, maps] = Of(file);
    const bool hit = disk->Hits(FaultyDisk::Operation::kSync);
    if (hit && disk->kind_ == FaultKind::kPowerCut) return Fail(*disk, EIO, SQLITE_IOERR_FSYNC);
    if (!hit) {
      for (const FaultyDisk::Change& change : node->pending) Apply(change, node->durable);
    }
    node->pending.clear();
    if (hit) return Fail(*disk, EIO, SQLITE_IOERR_FSYNC);
    if (node->journal && !node->name_durable) disk->SyncNames();
    return SQLITE_OK;
  }

  static int FileSize(sqlite3_file* file, sqlite3_int64* size) {
    *size = static_cast<sqlite3_int64>(Of(file).node->now.size());
    return SQLITE_OK;
  }

  // There is one connection at a time, and no other process.
  static int Lock(sqlite3_file* /*file*/, int /*level*/) { return SQLITE_OK; }
  static int CheckReservedLock(sqlite3_file* /*file*/, int* locked) {
    *locked = 0;
    return SQLITE_OK;
  }

  static int FileControl(sqlite3_file* file, int operation, void* argument) {
    if (operation != SQLITE_FCNTL_PERSIST_WAL) return SQLITE_NOTFOUND;
    int& keep = *static_cast<int*>(argument);
    if (keep < 0) {
      keep = Of(file).keep_log ? 1 : 0;
    } else {
      Of(file).keep_log = keep != 0;
    }
    return SQLITE_OK;
  }
  static int SectorSize(sqlite3_file* /*file*/) { return 4096; }
  // As SQLite takes it of Linux: a write changes no byte outside of it.
  static int Characteristics(sqlite3_file* /*file*/) { return SQLITE_IOCAP_POWERSAFE_OVERWRITE; }

  static int ShmMap(sqlite3_file* file, int region, int size, int extend, void volatile** memory) {
    auto& [disk, node, keep_log, maps] = Of(file);
    if (!std::exchange(maps, true)) ++node->shared_users;
    auto& regions = node->shared_memory;
    while (extend != 0 && static_cast<int>(regions.size()) <= region) {
      regions.push_back(std::make_unique<char[]>(static_cast<size_t>(size)));
    }
    *memory = region < static_cast<int>(regions.size()) ? regions[static_cast<size_t>(region)].get() : nullptr;
    return SQLITE_OK;
  }
  static int ShmLock(sqlite3_file* /*file*/, int /*offset*/, int /*count*/, int /*flags*/) { return SQLITE_OK; }
  static void ShmBarrier(sqlite3_file* /*file*/) {}
  // Nothing of it outlives the last user: who comes next reads the log.
  static int ShmUnmap(sqlite3_file* file, int /*remove*/) {
    auto& [disk, node, keep_log, maps] = Of(file);
    if (std::exchange(maps, false) && --node->shared_users == 0) node->shared_memory.clear();
    return SQLITE_OK;
  }

  static int Open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags) {
    static const sqlite3_io_methods methods = {.iVersion = 2,
                                               .xClose = Close,
                                               .xRead = Read,
                                               .xWrite = Write,
                                               .xTruncate = Truncate,
                                               .xSync = Sync,
                                               .xFileSize = FileSize,
                                               .xLock = Lock,
                                               .xUnlock = Lock,
                                               .xCheckReservedLock = CheckReservedLock,
                                               .xFileControl = FileControl,
                                               .xSectorSize = SectorSize,
                                               .xDeviceCharacteristics = Characteristics,
                                               .xShmMap = ShmMap,
                                               .xShmLock = ShmLock,
                                               .xShmBarrier = ShmBarrier,
                                               .xShmUnmap = ShmUnmap,
                                               .xFetch = nullptr,
                                               .xUnfetch = nullptr};
    FaultyDisk& disk = Of(vfs);
    file->pMethods = nullptr;
    std::shared_ptr<FaultyDisk::Node> node;
    if (name == nullptr) {
      node = std::make_shared<FaultyDisk::Node>();  // a temporary file, which has no name
    } else if (const auto found = disk.names_.find(name); found != disk.names_.end()) {
      node = found->second;
    } else {
      if ((flags & SQLITE_OPEN_CREATE) == 0) return Fail(disk, ENOENT, SQLITE_CANTOPEN);
      if (disk.Hits(FaultyDisk::Operation::kCreate)) {
        return Fail(disk, disk.kind_ == FaultKind::kFull ? ENOSPC : EIO, SQLITE_CANTOPEN);
      }
      node = std::make_shared<FaultyDisk::Node>();
      node->journal = (flags & (SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_SUPER_JOURNAL)) != 0;
      disk.names_[name] = node;
    }
    reinterpret_cast<Handle*>(file)->state = new Handle::State{.disk = &disk, .node = std::move(node)};
    file->pMethods = &methods;
    if (out_flags != nullptr) *out_flags = flags;
    return SQLITE_OK;
  }

  static int Delete(sqlite3_vfs* vfs, const char* name, int sync_folder) {
    FaultyDisk& disk = Of(vfs);
    const auto found = disk.names_.find(name);
    if (found == disk.names_.end()) return Fail(disk, ENOENT, SQLITE_IOERR_DELETE_NOENT);
    if (disk.Hits(FaultyDisk::Operation::kDelete)) return Fail(disk, EIO, SQLITE_IOERR_DELETE);
    if (found->second->name_durable) disk.deleted_[name] = found->second;
    disk.names_.erase(found);
    if (sync_folder != 0) disk.SyncNames();
    return SQLITE_OK;
  }

  static int Access(sqlite3_vfs* vfs, const char* name, int /*flags*/, int* there) {
    *there = Of(vfs).names_.count(name) > 0 ? 1 : 0;
    return SQLITE_OK;
  }
  static int FullPathname(sqlite3_vfs* /*vfs*/, const char* name, int size, char* full) {
    sqlite3_snprintf(size, full, "%s", name);
    return SQLITE_OK;
  }
  static int Randomness(sqlite3_vfs* vfs, int size, char* to) { return Real(vfs).xRandomness(&Real(vfs), size, to); }
  static int Sleep(sqlite3_vfs* vfs, int us) { return Real(vfs).xSleep(&Real(vfs), us); }
  static int CurrentTime(sqlite3_vfs* vfs, double* time) { return Real(vfs).xCurrentTime(&Real(vfs), time); }
  static int GetLastError(sqlite3_vfs* vfs, int /*size*/, char* /*text*/) { return Of(vfs).last_error_; }
  static sqlite3_vfs& Real(sqlite3_vfs* vfs) { return *Of(vfs).real_; }
};

FaultyDisk::FaultyDisk(uint32_t seed) : real_(sqlite3_vfs_find(nullptr)), random_(seed) {
  vfs_.iVersion = 1;
  vfs_.szOsFile = sizeof(Calls::Handle);
  vfs_.mxPathname = 512;
  vfs_.zName = "faulty_disk";
  vfs_.pAppData = this;
  vfs_.xOpen = Calls::Open;
  vfs_.xDelete = Calls::Delete;
  vfs_.xAccess = Calls::Access;
  vfs_.xFullPathname = Calls::FullPathname;
  vfs_.xRandomness = Calls::Randomness;
  vfs_.xSleep = Calls::Sleep;
  vfs_.xCurrentTime = Calls::CurrentTime;
  vfs_.xGetLastError = Calls::GetLastError;
  sqlite3_vfs_register(&vfs_, /*makeDflt=*/1);
}

FaultyDisk::~FaultyDisk() {
  sqlite3_vfs_unregister(&vfs_);
  sqlite3_vfs_register(real_, /*makeDflt=*/1);
}

void FaultyDisk::Arm(FaultKind kind, int64_t n, bool lasts) {
  kind_ = kind;
  left_ = n;
  lasts_ = lasts || kind == FaultKind::kPowerCut;
  struck_ = false;
  operations_ = 0;
}

void FaultyDisk::Repair() { left_ = -1; }

bool FaultyDisk::Hits(Operation operation) {
  if (left_ < 0) return false;
  bool can_hit = false;
  switch (kind_) {
    case FaultKind::kFull:
      can_hit = operation == Operation::kWrite || operation == Operation::kCreate;
      break;
    case FaultKind::kShortWrite:
      can_hit = operation == Operation::kWrite;
      break;
    case FaultKind::kWriteError:
      can_hit = operation == Operation::kWrite || operation == Operation::kCut || operation == Operation::kDelete;
      break;
    case FaultKind::kSyncError:
      can_hit = operation == Operation::kSync;
      break;
    case FaultKind::kReadError:
      can_hit = operation == Operation::kRead;
      break;
    case FaultKind::kPowerCut:
      can_hit = operation != Operation::kRead;
      break;
  }
  if (!can_hit) return false;
  ++operations_;
  if (left_ > 0) {
    --left_;
    return false;
  }
  if (!lasts_) left_ = -1;
  struck_ = true;
  return true;
}

void FaultyDisk::SyncNames() {
  for (auto& [name, node] : names_) node->name_durable = true;
  deleted_.clear();
}

void FaultyDisk::CutPower() {
  Repair();
  // Of what was not synced: nothing, everything, or each sector as chance has it.
  const double share = std::discrete_distribution<int>({1, 1, 2})(random_) * 0.5;
  std::bernoulli_distribution survives(share == 1.0 ? 0.5 : share == 0.5 ? 1.0 : 0.0);
  for (auto& [name, node] : deleted_) {
    if (!survives(random_)) names_.try_emplace(name, node);  // the deletion did not reach the disk
  }
  deleted_.clear();
  std::map<std::string, std::shared_ptr<Node>> left;
  for (const auto& [name, node] : names_) {
    if (!node->name_durable && !survives(random_)) continue;
    auto file = std::make_shared<Node>();
    file->durable = node->durable;
    file->name_durable = true;
    file->journal = node->journal;
    for (const Change& change : node->pending) {
      if (change.cut) {
        if (survives(random_)) Apply(change, file->durable);
        continue;
      }
      const int64_t end = change.offset + static_cast<int64_t>(change.bytes.size());
      for (int64_t from = change.offset; from < end;) {
        const int64_t to = std::min(end, (from / kSectorBytes + 1) * kSectorBytes);
        if (survives(random_)) {
          Apply(
              {.offset = from,
               .bytes = change.bytes.substr(static_cast<size_t>(from - change.offset), static_cast<size_t>(to - from))},
              file->durable);
        }
        from = to;
      }
    }
    file->now = file->durable;
    left[name] = std::move(file);
  }
  names_ = std::move(left);
}

FaultyDisk::Image FaultyDisk::Copy() const {
  Image image;
  for (const auto& [name, node] : names_) image[name] = *node;
  return image;
}

void FaultyDisk::PutBack(const Image& image) {
  names_.clear();
  deleted_.clear();
  for (const auto& [name, file] : image) {
    auto node = std::make_shared<Node>();
    static_cast<File&>(*node) = file;
    names_[name] = std::move(node);
  }
}

bool FaultyDisk::FlipBit(const std::string& path) {
  const auto found = names_.find(path);
  if (found == names_.end() || found->second->now.empty()) return false;
  Node& node = *found->second;
  for (const Change& change : node.pending) Apply(change, node.durable);
  node.pending.clear();
  const size_t byte = std::uniform_int_distribution<size_t>(0, node.now.size() - 1)(random_);
  node.now[byte] = static_cast<char>(node.now[byte] ^ (1 << std::uniform_int_distribution(0, 7)(random_)));
  node.durable = node.now;
  return true;
}

}  // namespace depthtween::server
