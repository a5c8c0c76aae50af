#include "server/http/frame_archive.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/http/file_route.h"

namespace depthtween::server {

int64_t ArchiveLayout::memory_bytes() const {
  return index.memory_bytes() + static_cast<int64_t>(frames.capacity() * sizeof(int));
}

absl::StatusOr<ArchiveBuilder::Piece> ArchiveBuilder::Add(const v1::FrameChunk& chunk) {
  Piece piece;
  if (chunk.has_header()) {
    if (open_) return absl::DataLossError(absl::StrFormat("%s ends before its last byte", name_));
    const v1::FrameHeader& header = chunk.header();
    name_ = absl::StrCat(folder_, "/", header.stem(), std::string(ExtensionOf(header.encoding())));
    size_bytes_ = header.size_bytes();
    received_bytes_ = 0;
    crc32_ = 0;
    open_ = true;
    if (size_bytes_ > 0) piece.before = ZipIndex::LocalHeader(name_, size_bytes_);
  }
  if (!open_ || chunk.offset() != received_bytes_) {
    return absl::DataLossError(absl::StrFormat("frame %d does not come in order", chunk.frame()));
  }
  piece.data = chunk.data();
  crc32_ = ExtendZipCrc32(crc32_, piece.data);
  received_bytes_ += static_cast<int64_t>(piece.data.size());
  if (chunk.has_next_frame()) {
    if (received_bytes_ != size_bytes_) {
      return absl::DataLossError(
          absl::StrFormat("%s has %d bytes, %d were announced", name_, received_bytes_, size_bytes_));
    }
    if (size_bytes_ > 0) {
      piece.after = ZipIndex::Descriptor(size_bytes_, crc32_);
      layout_.index.Add(std::move(name_), size_bytes_, crc32_);
      layout_.frames.push_back(chunk.frame());
    }
    layout_.next_frame = chunk.next_frame();
    open_ = false;
  }
  return piece;
}

std::string_view ByteWindow::Cut(std::string_view bytes) {
  const auto skipped = static_cast<size_t>(std::min(skip_, static_cast<int64_t>(bytes.size())));
  skip_ -= static_cast<int64_t>(skipped);
  bytes.remove_prefix(skipped);
  bytes = bytes.substr(0, static_cast<size_t>(std::min(left_, static_cast<int64_t>(bytes.size()))));
  left_ -= static_cast<int64_t>(bytes.size());
  return bytes;
}

std::shared_ptr<const ArchiveLayout> ArchiveLayouts::Find(std::string_view etag) {
  const std::lock_guard lock(mutex_);
  const auto found =
      std::find_if(layouts_.begin(), layouts_.end(), [&](const auto& entry) { return entry.first == etag; });
  if (found == layouts_.end()) return nullptr;
  layouts_.splice(layouts_.begin(), layouts_, found);
  return layouts_.front().second;
}

void ArchiveLayouts::Keep(std::string_view etag, std::shared_ptr<const ArchiveLayout> layout) {
  const std::lock_guard lock(mutex_);
  layouts_.remove_if([&](const auto& entry) {
    if (entry.first != etag) return false;
    bytes_ -= entry.second->memory_bytes();
    return true;
  });
  bytes_ += layout->memory_bytes();
  layouts_.emplace_front(etag, std::move(layout));
  while (bytes_ > limit_bytes_) {
    bytes_ -= layouts_.back().second->memory_bytes();
    layouts_.pop_back();
  }
}

}  // namespace depthtween::server
