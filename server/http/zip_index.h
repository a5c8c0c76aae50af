// The parts of a zip archive around the bytes of its files, which are stored as they are.
//
// An archive is   (LocalHeader file Descriptor)* CentralHeader* End   and is made from front to back without knowing
// what comes: a file's CRC-32 stands behind it. So the same files make the same bytes, whether the archive is sent
// whole or a part of it is computed later. Readers that need the checksum before the file (Java's ZipInputStream)
// cannot read it; all that look at the directory at the end can.
//
// Shapes:   any number of files of any size; zip64 records where 4 GiB or 65,534 files are exceeded. Every file's time
// is
//           1980-01-01, so that the bytes depend on nothing but names and content.
// Threads:  one at a time.
// Source:   PKWARE, APPNOTE.TXT 6.3.10, sections 4.3 to 4.5.
#ifndef DEPTHTWEEN_SERVER_HTTP_ZIP_INDEX_H_
#define DEPTHTWEEN_SERVER_HTTP_ZIP_INDEX_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace depthtween::server {

// The CRC-32 of zip (of IEEE 802.3, which is not CRC-32C) of A followed by `bytes`; `crc` is that of A, 0 for an empty
// A.
uint32_t ExtendZipCrc32(uint32_t crc, std::string_view bytes);

class ZipIndex {
 public:
  struct Entry {
    std::string name;  // ASCII, "/" between folders; at most 65,535 bytes
    int64_t size_bytes = 0;
    uint32_t crc32 = 0;
    int64_t offset = 0;  // of its local header in the archive
  };

  // What stands before and behind the bytes of a file.
  static std::string LocalHeader(std::string_view name, int64_t size_bytes);
  static std::string Descriptor(int64_t size_bytes, uint32_t crc32);

  // The file that comes next in the archive.
  void Add(std::string name, int64_t size_bytes, uint32_t crc32);
  const std::vector<Entry>& entries() const { return entries_; }
  // The entry whose header, bytes or descriptor hold the byte at `offset`; entries().size() if none does.
  size_t EntryAt(int64_t offset) const;

  std::string CentralHeader(const Entry& entry) const;
  std::string End() const;
  // Where the directory begins, and the size of the archive, if no further file is added.
  int64_t directory_offset() const { return directory_offset_; }
  int64_t size_bytes() const;
  // What it takes, for those who keep some.
  int64_t memory_bytes() const;

 private:
  std::vector<Entry> entries_;
  int64_t directory_offset_ = 0;
  int64_t directory_bytes_ = 0;
  int64_t name_bytes_ = 0;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_ZIP_INDEX_H_
