// Any bytes as the headers Upload-Metadata and Upload-Checksum: an error about the header, or something that can be
// used.
#include "server/http/tus.h"

#include <algorithm>
#include <cstdlib>

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string_view header(reinterpret_cast<const char*>(data), size);
  const auto file = ReadTusFile(header);
  if (file.ok()) {
    if (file->path.empty() || (!file->sha256.empty() && file->sha256.size() != 32)) std::abort();
    const auto printable = [](char c) { return c >= ' ' && c <= '~'; };
    if (!std::all_of(file->path.begin(), file->path.end(), printable)) std::abort();
  } else if (!absl::IsInvalidArgument(file.status()) || file.status().message().size() > 1000) {
    std::abort();
  }
  const auto checksum = ParseUploadChecksum(header);
  if (checksum.ok() && Matches(*checksum, header)) std::abort();  // a header that holds its own hash
  return 0;
}
