// The one guard: every call, over gRPC or HTTP, passes through here before anything else happens.
//
// Without a token file everybody may do everything, as the tenant "default"; the server then listens where only this
// machine can reach it, unless told otherwise (listen_address.h). With one, a call needs a bearer token that is known,
// not expired, and has the scope that the method asks for, or a signed link to the one resource that it reads.
#ifndef DEPTHTWEEN_SERVER_ACCESS_GUARD_H_
#define DEPTHTWEEN_SERVER_ACCESS_GUARD_H_

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/access/caller.h"
#include "server/access/token_file.h"

namespace depthtween::server {

struct GuardOptions {
  std::string token_file;           // empty: no tokens
  double max_calls_per_second = 0;  // of one tenant, over a few seconds; 0: no limit
};

// What a call says of itself.
struct Credentials {
  std::string authorization;  // "Bearer SECRET"; the header as it came, or empty
  std::string link;           // of a signed link, or empty
};

// What a method asks for.
struct Needs {
  Scope scope = Scope::kAdmin;
  bool link_opens = false;  // a signed link is enough
};

// How long a signed link may live.
inline constexpr absl::Duration kMaxLinkLife = absl::Hours(24);

class Guard {
 public:
  // Reads the token file. Errors as ReadTokenFile; InvalidArgument for a file without tokens.
  static absl::StatusOr<std::unique_ptr<Guard>> Open(const GuardOptions& options);

  bool asks_for_tokens() const { return !options_.token_file.empty(); }

  // Of GuardOptions; it may be changed at any time. InvalidArgument (BAD_FIELD) if below 0.
  double max_calls_per_second() const { return max_calls_per_second_; }
  absl::Status SetMaxCallsPerSecond(double calls);

  // Who calls. `resource` is the name of the resource that the call is about.
  // Unauthenticated (reasons NO_TOKEN, BAD_TOKEN, EXPIRED_TOKEN, BAD_LINK); PermissionDenied (WRONG_SCOPE) with the
  // scope that is missing, also for a link where none is enough; ResourceExhausted (LIMIT_EXCEEDED,
  // max_calls_per_second) when the tenant calls too often.
  //
  // The token file is read again when it has changed, at most once a second. A changed file that cannot be read is
  // logged, and the tokens known before stay valid.
  // Threads: may be called concurrently. Secrets are compared in constant time.
  absl::StatusOr<Caller> Admit(const Credentials& credentials, const Needs& needs, std::string_view resource);

  // The text that opens `resource`, and what there is to say of the job that it belongs to, for `life` to anybody who
  // has it. Links are signed with a key that lives as long as the guard: a restart of the server ends them.
  std::string SignLink(const Tenant& tenant, std::string_view resource, absl::Duration life) const;

 private:
  // The tokens and limits of one moment, so that calls hold no lock while they compare.
  using Tokens = std::shared_ptr<const std::vector<Token>>;
  // Calls that a tenant may make at once, and when that was counted.
  struct Bucket {
    double calls = 0;
    absl::Time counted;
  };

  explicit Guard(GuardOptions options);
  Tokens CurrentTokens();
  absl::StatusOr<Caller> AdmitToken(std::string_view authorization, Scope needed);
  absl::StatusOr<Caller> AdmitLink(std::string_view link, std::string_view resource) const;
  absl::Status CountCall(const Tenant& tenant);
  std::string LinkSignature(std::string_view tenant, std::string_view resource, std::string_view expiry) const;

  const GuardOptions options_;
  std::atomic<double> max_calls_per_second_;
  std::string link_key_;
  std::mutex mutex_;
  Tokens tokens_;                                       // guarded by mutex_; null: no token file
  absl::Time next_look_ = absl::InfinitePast();         // guarded by mutex_
  std::string seen_;                                    // guarded by mutex_: what the file looked like when last read
  std::map<std::string, Bucket, std::less<>> buckets_;  // guarded by mutex_; by tenant
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_GUARD_H_
