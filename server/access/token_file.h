// The file of bearer tokens: who may call, with which scopes, until when.
//
// JSON, made by `depthtween-server token new`. It holds SHA-256 hashes, never a secret: a secret has 256 random bits,
// so that its hash tells nothing and needs no salt. Changes are written whole and durable, one writer at a time, and
// the file is its owner's alone to read.
#ifndef DEPTHTWEEN_SERVER_ACCESS_TOKEN_FILE_H_
#define DEPTHTWEEN_SERVER_ACCESS_TOKEN_FILE_H_

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/access/caller.h"

namespace depthtween::server {

struct Token {
  std::string id;      // 16 hexadecimal digits; in lists and logs
  std::string sha256;  // of the secret: 64 hexadecimal digits
  std::string tenant;
  std::set<Scope> scopes;  // at least one
  absl::Time create_time;
  absl::Time expire_time = absl::InfiniteFuture();
};

// Errors name the file and what is wrong with it: NotFound if there is none; InvalidArgument if it is not one of ours,
// or if others can write to it.
absl::StatusOr<std::vector<Token>> ReadTokenFile(const std::string& path);
// The same of the file's text.
absl::StatusOr<std::vector<Token>> ParseTokens(std::string_view text);

struct NewToken {
  std::string tenant = kDefaultTenant;
  std::set<Scope> scopes;
  absl::Duration lifetime = absl::InfiniteDuration();
};
// Adds a token, making the file if there is none. Returns the secret, which is stored nowhere. InvalidArgument for a
// tenant against CheckTenantName, no scopes, or a lifetime that is not positive.
absl::StatusOr<std::string> AddToken(const std::string& path, const NewToken& token);
// Removes a token: calls with it are refused from then on. NotFound if there is none with that id.
absl::Status RevokeToken(const std::string& path, std::string_view id);

// "30d", "12h", "45m" -> the duration; InvalidArgument otherwise.
absl::StatusOr<absl::Duration> ParseLifetime(std::string_view text);

// What the file keeps of a secret.
std::string HashOfSecret(std::string_view secret);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_TOKEN_FILE_H_
