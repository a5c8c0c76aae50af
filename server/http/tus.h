// The headers of tus 1.0 (https://tus.io/protocols/resumable-upload): what they say, and whether it may be.
//
// Errors are InvalidArgument that name the header and the rule.
// Threads: pure functions.
#ifndef DEPTHTWEEN_SERVER_HTTP_TUS_H_
#define DEPTHTWEEN_SERVER_HTTP_TUS_H_

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "absl/time/time.h"
#include "core/base/status.h"

namespace depthtween::server {

inline constexpr char kTusVersion[] = "1.0.0";
inline constexpr char kTusExtensions[] = "creation,creation-with-upload,checksum,expiration,termination";
inline constexpr char kTusChecksums[] = "sha1,sha256";
inline constexpr char kTusContentType[] = "application/offset+octet-stream";
// "The chunk must be discarded": the status that tus has for bytes that do not match their checksum.
inline constexpr int kTusChecksumMismatch = 460;

// "filename d29ybGQ=,flag": keys with the values that their base64 says. All is printable ASCII.
absl::StatusOr<std::map<std::string, std::string>> ParseUploadMetadata(std::string_view header);

// What a creation makes of the metadata it knows; all other keys are ignored.
struct TusFile {
  std::string path;        // "path", or "filename", which clients send by themselves
  std::string sha256;      // "sha256", as 64 hexadecimal digits or as 32 bytes; empty without
  std::string request_id;  // "request_id"; empty without
};
absl::StatusOr<TusFile> ReadTusFile(std::string_view upload_metadata);

// As Upload-Expires has it: "Wed, 25 Jun 2014 16:00:00 GMT".
std::string TusTime(absl::Time time);

// "sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=".
struct UploadChecksum {
  std::string algorithm;  // one of kTusChecksums
  std::string digest;     // of its length
};
absl::StatusOr<UploadChecksum> ParseUploadChecksum(std::string_view header);
// Whether the bytes have it.
bool Matches(const UploadChecksum& checksum, std::string_view bytes);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_TUS_H_
