#include "server/http/zip_index.h"

#include <zlib.h>

#include <algorithm>
#include <utility>

namespace depthtween::server {
namespace {

constexpr int64_t kMax32 = 0xFFFFFFFF;  // from here on a 32-bit field says "look into the zip64 record"
constexpr size_t kMax16 = 0xFFFF;
constexpr uint16_t kVersion = 20, kVersionZip64 = 45;  // of the format, times ten, that a reader must know
constexpr uint16_t kMadeByUnix = 3 << 8;
constexpr uint16_t kSizesFollow = 1 << 3;                  // the flag: CRC-32 and sizes stand behind the file
constexpr uint32_t kPlainFile = uint32_t{0100644U} << 16;  // the mode of stat(2), readable by all
constexpr uint32_t kFirstOf1980 = (1U << 5 | 1U) << 16;    // MS-DOS date, then time, as one number

// Numbers as zip has them: little-endian.
class ZipRecord {
 public:
  ZipRecord& U16(uint64_t value) { return Put(value, 2); }
  ZipRecord& U32(uint64_t value) { return Put(value, 4); }
  ZipRecord& U64(uint64_t value) { return Put(value, 8); }
  ZipRecord& Text(std::string_view text) {
    bytes_.append(text);
    return *this;
  }
  std::string Take() { return std::move(bytes_); }

 private:
  ZipRecord& Put(uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) bytes_.push_back(static_cast<char>(value >> (8 * i)));
    return *this;
  }
  std::string bytes_;
};

bool IsLarge(int64_t value) { return value >= kMax32; }
uint64_t Short(int64_t value) { return static_cast<uint64_t>(std::min(value, kMax32)); }

// Of a central header: the 64-bit values of the fields that are too large for theirs, in this order.
std::string CentralExtra(const ZipIndex::Entry& entry) {
  ZipRecord values;
  if (IsLarge(entry.size_bytes)) values.U64(entry.size_bytes).U64(entry.size_bytes);
  if (IsLarge(entry.offset)) values.U64(entry.offset);
  const std::string bytes = values.Take();
  return bytes.empty() ? "" : ZipRecord().U16(1).U16(bytes.size()).Text(bytes).Take();
}

}  // namespace

uint32_t ExtendZipCrc32(uint32_t crc, std::string_view bytes) {
  return static_cast<uint32_t>(crc32_z(crc, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string ZipIndex::LocalHeader(std::string_view name, int64_t size_bytes) {
  const bool large = IsLarge(size_bytes);
  ZipRecord record;
  record.U32(0x04034B50).U16(large ? kVersionZip64 : kVersion).U16(kSizesFollow).U16(/*stored*/ 0).U32(kFirstOf1980);
  // CRC-32 and both sizes are in the descriptor; those of a large file have 64 bits there, and this record says so.
  record.U32(0).U32(large ? kMax32 : 0).U32(large ? kMax32 : 0).U16(name.size()).U16(large ? 20 : 0).Text(name);
  if (large) record.U16(1).U16(16).U64(0).U64(0);
  return record.Take();
}

std::string ZipIndex::Descriptor(int64_t size_bytes, uint32_t crc32) {
  ZipRecord record;
  record.U32(0x08074B50).U32(crc32);
  if (IsLarge(size_bytes)) {
    record.U64(size_bytes).U64(size_bytes);
  } else {
    record.U32(size_bytes).U32(size_bytes);
  }
  return record.Take();
}

void ZipIndex::Add(std::string name, int64_t size_bytes, uint32_t crc32) {
  const int64_t around = static_cast<int64_t>(LocalHeader(name, size_bytes).size() + Descriptor(size_bytes, 0).size());
  name_bytes_ += static_cast<int64_t>(name.size());
  entries_.push_back({.name = std::move(name), .size_bytes = size_bytes, .crc32 = crc32, .offset = directory_offset_});
  directory_offset_ += around + size_bytes;
  directory_bytes_ += static_cast<int64_t>(CentralHeader(entries_.back()).size());
}

size_t ZipIndex::EntryAt(int64_t offset) const {
  if (offset >= directory_offset_) return entries_.size();
  const auto after = std::upper_bound(entries_.begin(), entries_.end(), offset,
                                      [](int64_t at, const Entry& entry) { return at < entry.offset; });
  return static_cast<size_t>(after - entries_.begin()) - 1;
}

std::string ZipIndex::CentralHeader(const Entry& entry) const {
  const std::string extra = CentralExtra(entry);
  const uint16_t version = extra.empty() ? kVersion : kVersionZip64;
  ZipRecord record;
  record.U32(0x02014B50).U16(kMadeByUnix | version).U16(version).U16(kSizesFollow).U16(/*stored*/ 0).U32(kFirstOf1980);
  record.U32(entry.crc32).U32(Short(entry.size_bytes)).U32(Short(entry.size_bytes));
  record.U16(entry.name.size()).U16(extra.size()).U16(/*comment*/ 0).U16(/*disk*/ 0).U16(/*binary*/ 0);
  record.U32(kPlainFile).U32(Short(entry.offset)).Text(entry.name).Text(extra);
  return record.Take();
}

std::string ZipIndex::End() const {
  const int64_t count = static_cast<int64_t>(entries_.size());
  ZipRecord record;
  if (entries_.size() >= kMax16 || IsLarge(directory_offset_) || IsLarge(directory_bytes_)) {
    record.U32(0x06064B50).U64(/*bytes that follow in this record*/ 44).U16(kMadeByUnix | kVersionZip64);
    record.U16(kVersionZip64).U32(/*disk*/ 0).U32(0).U64(count).U64(count).U64(directory_bytes_).U64(directory_offset_);
    record.U32(0x07064B50).U32(/*disk*/ 0).U64(directory_offset_ + directory_bytes_).U32(/*disks*/ 1);
  }
  const uint64_t short_count = std::min(entries_.size(), kMax16);
  record.U32(0x06054B50).U16(/*disk*/ 0).U16(0).U16(short_count).U16(short_count);
  record.U32(Short(directory_bytes_)).U32(Short(directory_offset_)).U16(/*comment*/ 0);
  return record.Take();
}

int64_t ZipIndex::size_bytes() const {
  return directory_offset_ + directory_bytes_ + static_cast<int64_t>(End().size());
}

int64_t ZipIndex::memory_bytes() const {
  return static_cast<int64_t>(entries_.capacity() * sizeof(Entry)) + name_bytes_;
}

}  // namespace depthtween::server
