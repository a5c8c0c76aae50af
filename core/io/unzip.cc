#include "core/io/unzip.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "core/io/file.h"

namespace depthtween {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie in the file");

constexpr uint32_t kLocalSignature = 0x04034b50, kCentralSignature = 0x02014b50, kEndSignature = 0x06054b50;
constexpr uint32_t kEnd64Signature = 0x06064b50, kLocator64Signature = 0x07064b50;
constexpr size_t kLocalBytes = 30, kCentralBytes = 46, kEndBytes = 22, kLocator64Bytes = 20, kEnd64Bytes = 56;
constexpr size_t kMaxCommentBytes = 0xffff;
constexpr uint16_t kZip64Field = 1;
constexpr uint32_t kSaturated32 = 0xffffffff;
constexpr uint16_t kStored = 0, kDeflated = 8;
constexpr uint16_t kEncryptedFlags = 1 << 0 | 1 << 6 | 1 << 13;
constexpr int kUnixHost = 3, kDarwinHost = 19;

// A folder on top may be left out, so these are wider than what a recording needs.
constexpr size_t kMaxPathBytes = 2048, kMaxPartBytes = 255;
constexpr int kMaxFolders = 16;  // bounds the work that a name can ask for
// Folders and what is left out are entries too.
constexpr int64_t kMoreEntries = 1000;
constexpr size_t kMaxViolations = 100;

constexpr size_t kPieceBytes = 256 << 10;
constexpr int64_t kProgressBytes = 4 << 20;
constexpr int64_t kProgressEntries = 1000;

struct Entry {
  std::string name;  // in the archive
  std::string path;  // in the folder
  uint16_t method = kStored;
  uint32_t crc32 = 0;
  int64_t packed_bytes = 0, bytes = 0;
  int64_t local_offset = 0;
};

template <typename T>
T LoadAt(std::string_view bytes, size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

absl::Status NotAnArchive(absl::string_view why) {
  return absl::InvalidArgumentError(absl::StrCat("is no zip archive that can be read: ", why));
}

// Names of strangers in messages.
std::string Shown(std::string_view name) {
  return absl::CHexEscape(absl::string_view(name.data(), std::min<size_t>(name.size(), 300)));
}

class File {
 public:
  static absl::StatusOr<std::unique_ptr<File>> Open(const std::string& path) {
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
    if (fd < 0) return ErrnoStatus(errno, "open " + path);
    auto file = std::unique_ptr<File>(new File(fd, path));
    struct stat information = {};
    if (fstat(fd, &information) != 0) return ErrnoStatus(errno, "look at " + path);
    if (!S_ISREG(information.st_mode)) return absl::InvalidArgumentError(path + " is not a regular file");
    file->size_ = information.st_size;
    return file;
  }
  ~File() { close(fd_); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  int64_t size() const { return size_; }
  // All of them; DataLoss if the file ends before.
  absl::Status ReadAt(int64_t offset, char* data, size_t size) const {
    while (size > 0) {
      const ssize_t got = pread(fd_, data, size, offset);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return ErrnoStatus(errno, "read " + path_);
      if (got == 0) return absl::DataLossError(path_ + " has become shorter");
      data += got;
      offset += got;
      size -= static_cast<size_t>(got);
    }
    return absl::OkStatus();
  }
  absl::StatusOr<std::string> ReadAt(int64_t offset, size_t size) const {
    std::string bytes(size, '\0');
    RETURN_IF_ERROR(ReadAt(offset, bytes.data(), size));
    return bytes;
  }

 private:
  File(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  const int fd_;
  const std::string path_;
  int64_t size_ = 0;
};

// Part of a file from front to back.
class Reader {
 public:
  Reader(const File& file, int64_t begin, int64_t end) : file_(file), at_(begin), end_(end) {}

  // DataLoss if there are fewer.
  absl::Status Read(size_t size, std::string& bytes) {
    bytes.clear();
    while (bytes.size() < size) {
      if (taken_ == buffer_.size()) {
        const int64_t more = std::min<int64_t>(end_ - at_, kPieceBytes);
        if (more <= 0) return absl::DataLossError("its directory ends too early");
        buffer_.resize(static_cast<size_t>(more));
        RETURN_IF_ERROR(file_.ReadAt(at_, buffer_.data(), buffer_.size()));
        at_ += more;
        taken_ = 0;
      }
      const size_t count = std::min(size - bytes.size(), buffer_.size() - taken_);
      bytes.append(buffer_, taken_, count);
      taken_ += count;
    }
    return absl::OkStatus();
  }

 private:
  const File& file_;
  int64_t at_;
  const int64_t end_;
  std::string buffer_;
  size_t taken_ = 0;
};

// Where the list of entries lies.
struct Directory {
  int64_t offset = 0, bytes = 0, entries = 0;
};

absl::StatusOr<Directory> FindDirectory(const File& file) {
  if (file.size() < static_cast<int64_t>(kEndBytes)) return NotAnArchive("it is too short");
  const auto tail_bytes = static_cast<size_t>(std::min<int64_t>(file.size(), kEndBytes + kMaxCommentBytes));
  const int64_t tail_offset = file.size() - static_cast<int64_t>(tail_bytes);
  ASSIGN_OR_RETURN(const std::string tail, file.ReadAt(tail_offset, tail_bytes));
  std::optional<size_t> end;
  // The record that ends with the file: its comment is as long as it says.
  for (size_t at = tail_bytes - kEndBytes + 1; at-- > 0 && !end;) {
    const bool fits =
        LoadAt<uint32_t>(tail, at) == kEndSignature && at + kEndBytes + LoadAt<uint16_t>(tail, at + 20) == tail_bytes;
    if (fits) end = at;
  }
  if (!end) return NotAnArchive("its end is missing");
  const std::string_view record = std::string_view(tail).substr(*end);
  int64_t end_offset = tail_offset + static_cast<int64_t>(*end);
  Directory directory = {.offset = LoadAt<uint32_t>(record, 16),
                         .bytes = LoadAt<uint32_t>(record, 12),
                         .entries = LoadAt<uint16_t>(record, 10)};
  uint32_t disks = LoadAt<uint16_t>(record, 4) | LoadAt<uint16_t>(record, 6);
  const bool wide = directory.offset == kSaturated32 || directory.bytes == kSaturated32 || directory.entries == 0xffff;
  if (wide && end_offset >= static_cast<int64_t>(kLocator64Bytes)) {
    ASSIGN_OR_RETURN(const std::string locator,
                     file.ReadAt(end_offset - static_cast<int64_t>(kLocator64Bytes), kLocator64Bytes));
    if (LoadAt<uint32_t>(locator, 0) == kLocator64Signature) {
      const auto offset = LoadAt<uint64_t>(locator, 8);
      if (offset > static_cast<uint64_t>(end_offset) || end_offset - offset < kLocator64Bytes + kEnd64Bytes) {
        return NotAnArchive("its zip64 end is not where it should be");
      }
      end_offset = static_cast<int64_t>(offset);
      ASSIGN_OR_RETURN(const std::string end64, file.ReadAt(end_offset, kEnd64Bytes));
      if (LoadAt<uint32_t>(end64, 0) != kEnd64Signature) return NotAnArchive("its zip64 end is missing");
      disks = LoadAt<uint32_t>(end64, 16) | LoadAt<uint32_t>(end64, 20);
      const auto entries = LoadAt<uint64_t>(end64, 32), bytes = LoadAt<uint64_t>(end64, 40),
                 begin = LoadAt<uint64_t>(end64, 48);
      const auto most = static_cast<uint64_t>(end_offset);
      if (entries > most || bytes > most || begin > most)
        return NotAnArchive("its directory is not where it should be");
      directory = {.offset = static_cast<int64_t>(begin),
                   .bytes = static_cast<int64_t>(bytes),
                   .entries = static_cast<int64_t>(entries)};
    }
  }
  if (disks != 0) return NotAnArchive("it is one of several parts; make one archive");
  if (directory.offset + directory.bytes > end_offset) return NotAnArchive("its directory is not where it should be");
  return directory;
}

// What the systems of those who pack add unasked.
bool IsUnasked(std::string_view name) {
  for (const absl::string_view part : absl::StrSplit(absl::string_view(name.data(), name.size()), '/')) {
    if (part == "__MACOSX" || part == ".DS_Store" || absl::StartsWith(part, "._")) return true;
    if (absl::EqualsIgnoreCase(part, "Thumbs.db") || absl::EqualsIgnoreCase(part, "desktop.ini")) return true;
  }
  return false;
}

absl::Status CheckName(std::string_view name) {
  const auto bad = [](absl::string_view rule) { return absl::InvalidArgumentError(rule); };
  if (name.empty()) return bad("has no name");
  if (name.size() > kMaxPathBytes) return bad(absl::StrCat("has a name longer than ", kMaxPathBytes, " bytes"));
  const bool plain = std::none_of(name.begin(), name.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; });
  if (!plain) return bad("has a control character in its name");
  if (name.find('\\') != std::string_view::npos) return bad("has a backslash in its name; folders are parted by /");
  if (name.front() == '/' || (name.size() > 1 && name[1] == ':')) return bad("has an absolute name");
  int folders = -1;
  for (const absl::string_view part : absl::StrSplit(absl::string_view(name.data(), name.size()), '/')) {
    if (part == "..") return bad("leads out of its folder");
    if (part.empty() || part == ".") return bad("has a part without a name");
    if (part.size() > kMaxPartBytes) return bad(absl::StrCat("has a part longer than ", kMaxPartBytes, " bytes"));
    ++folders;
  }
  if (folders > kMaxFolders) return bad(absl::StrCat("lies deeper than ", kMaxFolders, " folders"));
  return absl::OkStatus();
}

// The fields of `extra` that hold what 32 bits cannot. False if they are not there.
bool TakeWide(std::string_view extra, uint64_t& bytes, uint64_t& packed_bytes, uint64_t& offset) {
  uint64_t* const wanted[] = {bytes == kSaturated32 ? &bytes : nullptr,
                              packed_bytes == kSaturated32 ? &packed_bytes : nullptr,
                              offset == kSaturated32 ? &offset : nullptr};
  if (std::all_of(std::begin(wanted), std::end(wanted), [](const uint64_t* w) { return w == nullptr; })) return true;
  while (extra.size() >= 4) {
    const auto id = LoadAt<uint16_t>(extra, 0), size = LoadAt<uint16_t>(extra, 2);
    extra.remove_prefix(4);
    if (size > extra.size()) return false;
    if (id == kZip64Field) {
      std::string_view field = extra.substr(0, size);
      for (uint64_t* value : wanted) {
        if (value == nullptr) continue;
        if (field.size() < sizeof *value) return false;
        *value = LoadAt<uint64_t>(field, 0);
        field.remove_prefix(sizeof *value);
      }
      return true;
    }
    extra.remove_prefix(size);
  }
  return false;
}

class Unzipper {
 public:
  Unzipper(const File& file, std::string archive, const UnzipLimits& limits, const std::stop_token& stop,
           const std::function<void(int, int)>& on_progress)
      : file_(file), archive_(std::move(archive)), limits_(limits), stop_(stop), on_progress_(on_progress) {}

  absl::StatusOr<UnzipSummary> Run(const std::string& folder) {
    RETURN_IF_ERROR(ReadDirectory());
    if (violations_.empty()) PlacePaths();
    if (violations_.empty()) RETURN_IF_ERROR(WriteFiles(folder));
    return UnzipSummary{
        .files = static_cast<int>(entries_.size()), .bytes = all_bytes_, .violations = violations_.PerFile()};
  }

 private:
  void AddViolation(std::string_view name, const absl::Status& status) {
    if (++violation_count_ <= kMaxViolations) violations_.Add(Shown(name), status);
  }
  bool ToldEnough() const { return violation_count_ >= kMaxViolations; }
  void Progress() {
    if (on_progress_) on_progress_(written_files_, static_cast<int>(entries_.size()));
  }

  // Errors are those of reading; what is wrong with the archive is a violation.
  absl::Status ReadDirectory() {
    const absl::StatusOr<Directory> found = FindDirectory(file_);
    if (absl::IsInvalidArgument(found.status())) {
      AddViolation(archive_, found.status());
      return absl::OkStatus();
    }
    RETURN_IF_ERROR(found.status());
    directory_ = *found;
    // Before any of them is looked at: an archive can have as many as it has bytes.
    if (directory_.entries > 2 * int64_t{limits_.max_files} + kMoreEntries) return TooManyFiles(directory_.entries);
    Reader reader(file_, directory_.offset, directory_.offset + directory_.bytes);
    for (int64_t i = 0; i < directory_.entries && !ToldEnough(); ++i) {
      if (stop_.stop_requested()) return absl::CancelledError("unpacking was stopped");
      if (i % kProgressEntries == 0) Progress();
      const absl::Status read = ReadEntry(reader);
      if (absl::IsDataLoss(read) || absl::IsInvalidArgument(read)) {
        AddViolation(archive_, NotAnArchive(read.message()));
        return absl::OkStatus();
      }
      RETURN_IF_ERROR(read);
      if (static_cast<int64_t>(entries_.size()) > limits_.max_files) return TooManyFiles(directory_.entries);
    }
    if (entries_.empty() && violations_.empty()) {
      AddViolation(archive_, absl::InvalidArgumentError("has no files"));
    }
    return absl::OkStatus();
  }

  absl::Status TooManyFiles(int64_t entries) {
    AddViolation(archive_, absl::ResourceExhaustedError(absl::StrFormat("has %d entries, at most %d files are allowed",
                                                                        entries, limits_.max_files)));
    return absl::OkStatus();
  }

  absl::Status ReadEntry(Reader& reader) {
    RETURN_IF_ERROR(reader.Read(kCentralBytes, head_));
    if (LoadAt<uint32_t>(head_, 0) != kCentralSignature) return absl::DataLossError("its directory is damaged");
    const auto name_bytes = LoadAt<uint16_t>(head_, 28), extra_bytes = LoadAt<uint16_t>(head_, 30),
               comment_bytes = LoadAt<uint16_t>(head_, 32);
    Entry entry = {.method = LoadAt<uint16_t>(head_, 10), .crc32 = LoadAt<uint32_t>(head_, 16)};
    RETURN_IF_ERROR(reader.Read(name_bytes, entry.name));
    RETURN_IF_ERROR(reader.Read(extra_bytes, extra_));
    RETURN_IF_ERROR(reader.Read(comment_bytes, comment_));
    const bool has_mode = head_[5] == kUnixHost || head_[5] == kDarwinHost;
    const mode_t type = has_mode ? LoadAt<uint32_t>(head_, 38) >> 16 & S_IFMT : 0;
    if (IsUnasked(entry.name) || absl::EndsWith(entry.name, "/") || type == S_IFDIR) return absl::OkStatus();

    const auto bad = [&](const absl::Status& status) {
      AddViolation(entry.name, status);
      return absl::OkStatus();
    };
    if (const absl::Status named = CheckName(entry.name); !named.ok()) return bad(named);
    if (type == S_IFLNK) return bad(absl::InvalidArgumentError("is a symbolic link; pack the file that it leads to"));
    if (type != 0 && type != S_IFREG) return bad(absl::InvalidArgumentError("is not a file"));
    if ((LoadAt<uint16_t>(head_, 8) & kEncryptedFlags) != 0) {
      return bad(absl::InvalidArgumentError("is encrypted; pack it without a password"));
    }
    if (entry.method != kStored && entry.method != kDeflated) {
      return bad(absl::InvalidArgumentError(
          absl::StrFormat("is compressed by method %d, must be deflated or stored", entry.method)));
    }
    uint64_t bytes = LoadAt<uint32_t>(head_, 24), packed_bytes = LoadAt<uint32_t>(head_, 20),
             offset = LoadAt<uint32_t>(head_, 42);
    const auto end = static_cast<uint64_t>(directory_.offset);
    const bool lies_inside = TakeWide(extra_, bytes, packed_bytes, offset) && offset <= end && packed_bytes <= end &&
                             offset + kLocalBytes + packed_bytes <= end;
    if (!lies_inside || (entry.method == kStored && bytes != packed_bytes)) return bad(Damage("its sizes contradict"));
    // Compared before it is added, so that no sum can overflow.
    if (bytes > static_cast<uint64_t>(limits_.max_bytes - all_bytes_)) {
      AddViolation(archive_, absl::ResourceExhaustedError(absl::StrFormat(
                                 "would unpack to more than the %d bytes that are allowed", limits_.max_bytes)));
      violation_count_ = kMaxViolations;  // enough is known
      return absl::OkStatus();
    }
    entry.bytes = static_cast<int64_t>(bytes);
    entry.packed_bytes = static_cast<int64_t>(packed_bytes);
    entry.local_offset = static_cast<int64_t>(offset);
    all_bytes_ += entry.bytes;
    entries_.push_back(std::move(entry));
    return absl::OkStatus();
  }

  static absl::Status Damage(absl::string_view why) { return absl::DataLossError(absl::StrCat("is damaged: ", why)); }

  // Leaves out a folder on top, and sees to it that no two names are one: on some disks, case is no difference.
  void PlacePaths() {
    const size_t slash = entries_.front().name.find('/');
    const std::string top = slash == std::string::npos ? "" : entries_.front().name.substr(0, slash + 1);
    const bool common = !top.empty() && std::all_of(entries_.begin(), entries_.end(),
                                                    [&top](const Entry& e) { return e.name.starts_with(top); });
    std::unordered_set<std::string> files;
    std::unordered_map<std::string, std::string> folders;  // by their lower case
    for (Entry& entry : entries_) {
      entry.path = common ? entry.name.substr(top.size()) : entry.name;
      const std::string lower = absl::AsciiStrToLower(entry.path);
      if (!files.insert(lower).second) {
        AddViolation(entry.name, absl::InvalidArgumentError("is twice in the archive, or differs from another name in "
                                                            "upper and lower case alone"));
      }
      for (size_t at = entry.path.find('/'); at != std::string::npos; at = entry.path.find('/', at + 1)) {
        const std::string folder = entry.path.substr(0, at);
        if (folders.emplace(lower.substr(0, at), folder).first->second != folder) {
          AddViolation(entry.name, absl::InvalidArgumentError("lies in a folder whose name differs from another one's "
                                                              "in upper and lower case alone"));
        }
      }
    }
    for (const Entry& entry : entries_) {
      if (folders.contains(absl::AsciiStrToLower(entry.path))) {
        AddViolation(entry.name, absl::InvalidArgumentError("would be both a file and a folder"));
      }
    }
  }

  absl::Status WriteFiles(const std::string& folder) {
    std::string made;  // the last folder
    for (const Entry& entry : entries_) {
      const std::string path = JoinPath(folder, entry.path);
      if (const std::string parent = path.substr(0, path.rfind('/')); parent != made) {
        RETURN_IF_ERROR(MakeFolder(parent));
        made = parent;
      }
      const absl::Status written = WriteEntry(entry, path);
      if (absl::IsDataLoss(written)) {
        AddViolation(entry.name, written);
        if (ToldEnough()) return absl::OkStatus();
      } else {
        RETURN_IF_ERROR(written);
      }
      ++written_files_;
      Progress();
    }
    return absl::OkStatus();
  }

  // DataLoss: the entry is damaged.
  absl::Status WriteEntry(const Entry& entry, const std::string& path) {
    ASSIGN_OR_RETURN(const std::string local, file_.ReadAt(entry.local_offset, kLocalBytes));
    if (LoadAt<uint32_t>(local, 0) != kLocalSignature) return Damage("it is not where the directory says");
    int64_t at = entry.local_offset + static_cast<int64_t>(kLocalBytes) + LoadAt<uint16_t>(local, 26) +
                 LoadAt<uint16_t>(local, 28);
    if (at + entry.packed_bytes > directory_.offset) return Damage("it reaches into the directory");
    const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0644);
    if (fd < 0) return ErrnoStatus(errno, "create " + path);
    const absl::Cleanup close_file = [fd] { close(fd); };

    z_stream inflater = {};
    if (entry.method == kDeflated && inflateInit2(&inflater, -MAX_WBITS) != Z_OK) throw std::bad_alloc();
    const absl::Cleanup end_inflater = [&] { inflateEnd(&inflater); };
    int64_t left = entry.packed_bytes, written = 0, told = 0;
    uLong crc = ::crc32(0, nullptr, 0);
    const auto write_out = [&](std::string_view bytes) -> absl::Status {
      written += static_cast<int64_t>(bytes.size());
      if (written > entry.bytes) return Damage("it is longer than the directory says");
      crc = ::crc32_z(crc, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size());
      while (!bytes.empty()) {
        const ssize_t count = write(fd, bytes.data(), bytes.size());
        if (count < 0 && errno == EINTR) continue;
        if (count < 0) return ErrnoStatus(errno, "write " + path);
        bytes.remove_prefix(static_cast<size_t>(count));
      }
      if (stop_.stop_requested()) return absl::CancelledError("unpacking was stopped");
      if (written - told >= kProgressBytes) {
        told = written;
        Progress();
      }
      return absl::OkStatus();
    };

    bool ended = entry.method == kStored;
    while (left > 0) {
      packed_.resize(static_cast<size_t>(std::min<int64_t>(left, kPieceBytes)));
      RETURN_IF_ERROR(file_.ReadAt(at, packed_.data(), packed_.size()));
      at += static_cast<int64_t>(packed_.size());
      left -= static_cast<int64_t>(packed_.size());
      if (entry.method == kStored) {
        RETURN_IF_ERROR(write_out(packed_));
        continue;
      }
      inflater.next_in = reinterpret_cast<Bytef*>(packed_.data());
      inflater.avail_in = static_cast<uInt>(packed_.size());
      bool more = true;
      while (more) {
        if (ended) return Damage("something follows its end");
        unpacked_.resize(kPieceBytes);
        inflater.next_out = reinterpret_cast<Bytef*>(unpacked_.data());
        inflater.avail_out = static_cast<uInt>(unpacked_.size());
        const int result = inflate(&inflater, Z_NO_FLUSH);
        if (result == Z_MEM_ERROR) throw std::bad_alloc();
        // Z_BUF_ERROR: there was nothing to do; it asks for more.
        if (result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR) return Damage("it cannot be inflated");
        ended = result == Z_STREAM_END;
        RETURN_IF_ERROR(write_out(std::string_view(unpacked_).substr(0, unpacked_.size() - inflater.avail_out)));
        more = inflater.avail_in > 0 || (inflater.avail_out == 0 && !ended);
      }
    }
    if (!ended || written != entry.bytes) return Damage("it is shorter than the directory says");
    if (crc != entry.crc32) return Damage("its CRC-32 does not match");
    return absl::OkStatus();
  }

  const File& file_;
  const std::string archive_;  // its name
  const UnzipLimits limits_;
  const std::stop_token& stop_;
  const std::function<void(int, int)>& on_progress_;
  Directory directory_;
  std::vector<Entry> entries_;
  int64_t all_bytes_ = 0;
  int written_files_ = 0;
  ViolationList violations_;
  size_t violation_count_ = 0;
  std::string head_, extra_, comment_, packed_, unpacked_;  // scratch
};

}  // namespace

absl::StatusOr<UnzipSummary> Unzip(const std::string& archive, const std::string& folder, const UnzipLimits& limits,
                                   const std::stop_token& stop,
                                   const std::function<void(int done, int of)>& on_progress) {
  ASSIGN_OR_RETURN(const std::unique_ptr<File> file, File::Open(archive));
  return Unzipper(*file, archive.substr(archive.rfind('/') + 1), limits, stop, on_progress).Run(folder);
}

}  // namespace depthtween
