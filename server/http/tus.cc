#include "server/http/tus.h"

#include <openssl/evp.h>

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace depthtween::server {
namespace {

constexpr size_t kSha1Bytes = 20, kSha256Bytes = 32;
constexpr size_t kShownBytes = 80;  // of what a client sent, in a message

absl::string_view Shown(std::string_view text) { return {text.data(), std::min(text.size(), kShownBytes)}; }

absl::Status BadHeader(std::string_view name, std::string_view value, std::string_view rule) {
  return absl::InvalidArgumentError(
      absl::StrCat(std::string(name), " = \"", absl::CHexEscape(Shown(value)), "\", must be ", std::string(rule)));
}

bool IsPrintable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

const EVP_MD* DigestOf(std::string_view algorithm) { return algorithm == "sha1" ? EVP_sha1() : EVP_sha256(); }

}  // namespace

absl::StatusOr<std::map<std::string, std::string>> ParseUploadMetadata(std::string_view header) {
  constexpr char kRule[] = "pairs \"key base64\" with commas between them, each key once";
  std::map<std::string, std::string> result;
  if (!IsPrintable(header)) return BadHeader("Upload-Metadata", header, kRule);
  for (absl::string_view pair : absl::StrSplit(absl::string_view(header.data(), header.size()), ',')) {
    pair = absl::StripAsciiWhitespace(pair);
    const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(pair, absl::MaxSplits(' ', 1));
    std::string value;
    // Abseil skips blanks in base64, which here would hide a pair that lacks its comma.
    const absl::string_view base64 = absl::StripAsciiWhitespace(parts.second);
    const bool readable = base64.find(' ') == absl::string_view::npos && absl::Base64Unescape(base64, &value);
    if (parts.first.empty() || !readable || !result.emplace(std::string(parts.first), std::move(value)).second) {
      return BadHeader("Upload-Metadata", header, kRule);
    }
  }
  return result;
}

absl::StatusOr<TusFile> ReadTusFile(std::string_view upload_metadata) {
  std::map<std::string, std::string> metadata;
  if (!upload_metadata.empty()) {
    ASSIGN_OR_RETURN(metadata, ParseUploadMetadata(upload_metadata));
  }
  TusFile file;
  file.path = metadata.count("path") > 0 ? metadata["path"] : metadata["filename"];
  file.request_id = metadata["request_id"];
  file.sha256 = metadata["sha256"];
  if (file.path.empty()) {
    return absl::InvalidArgumentError(
        "Upload-Metadata has no \"path\", must name the file relative to its sequence, such as rgb/000001.png");
  }
  // A string of protobuf must be UTF-8, and no path or id of ours has other letters.
  if (!IsPrintable(file.path) || !IsPrintable(file.request_id)) {
    return absl::InvalidArgumentError("Upload-Metadata: path and request_id must be printable ASCII");
  }
  const bool hexadecimal = file.sha256.size() == 2 * kSha256Bytes &&
                           std::all_of(file.sha256.begin(), file.sha256.end(),
                                       [](char c) { return absl::ascii_isxdigit(static_cast<unsigned char>(c)); });
  if (hexadecimal) file.sha256 = absl::HexStringToBytes(file.sha256);
  if (!file.sha256.empty() && file.sha256.size() != kSha256Bytes) {
    return BadHeader("Upload-Metadata sha256", file.sha256, "64 hexadecimal digits or 32 bytes");
  }
  return file;
}

std::string TusTime(absl::Time time) {
  return absl::FormatTime("%a, %d %b %Y %H:%M:%S GMT", time, absl::UTCTimeZone());
}

absl::StatusOr<UploadChecksum> ParseUploadChecksum(std::string_view header) {
  const std::pair<std::string, std::string> parts =
      absl::StrSplit(absl::string_view(header.data(), header.size()), absl::MaxSplits(' ', 1));
  UploadChecksum checksum = {.algorithm = parts.first, .digest = {}};
  if (checksum.algorithm != "sha1" && checksum.algorithm != "sha256") {
    return BadHeader("Upload-Checksum", header, absl::StrCat("of an algorithm among ", kTusChecksums));
  }
  const size_t size = checksum.algorithm == "sha1" ? kSha1Bytes : kSha256Bytes;
  if (!absl::Base64Unescape(absl::StripAsciiWhitespace(parts.second), &checksum.digest) ||
      checksum.digest.size() != size) {
    return BadHeader("Upload-Checksum", header,
                     absl::StrCat("\"", checksum.algorithm, " \" and ", size, " bytes as base64"));
  }
  return checksum;
}

bool Matches(const UploadChecksum& checksum, std::string_view bytes) {
  std::string digest(EVP_MAX_MD_SIZE, '\0');
  unsigned size = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(digest.data()), &size,
                 DigestOf(checksum.algorithm), nullptr) != 1) {
    throw std::bad_alloc();  // the only way it fails here
  }
  digest.resize(size);
  return digest == checksum.digest;
}

}  // namespace depthtween::server
