#include "server/access/guard.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/rand.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "server/store/error_info.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr absl::Duration kLookGap = absl::Seconds(1);
constexpr double kBurstSeconds = 5;      // so many seconds' worth of calls may come at once
constexpr size_t kMaxSecretBytes = 512;  // ours have 46; longer ones are not hashed

// What tells a changed file from the one read before.
std::string LookOf(const std::string& path) {
  struct stat facts {};
  if (stat(path.c_str(), &facts) != 0) return "none";
  return absl::StrCat(facts.st_ino, " ", facts.st_size, " ", facts.st_mtim.tv_sec, " ", facts.st_mtim.tv_nsec, " ",
                      facts.st_mode);
}

absl::Status Refused(absl::string_view reason, absl::string_view message) {
  return WithErrorInfo(absl::UnauthenticatedError(message), {.reason = std::string(reason), .metadata = {}});
}

absl::Status WrongScope(Scope needed) {
  const std::string scope(ToString(needed));
  return WithErrorInfo(
      absl::PermissionDeniedError(absl::StrFormat(
          "this call needs the scope %s, which the token or link does not have: ask the operator for one that has",
          scope)),
      {.reason = "WRONG_SCOPE", .metadata = {{"scope", scope}}});
}

bool SameText(std::string_view a, std::string_view b) {
  return a.size() == b.size() && CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Guard>> Guard::Open(const GuardOptions& options) {
  if (!(options.max_calls_per_second >= 0)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("max_calls_per_second = %g, must be >= 0 (0: no limit)", options.max_calls_per_second));
  }
  std::unique_ptr<Guard> guard(new Guard(options));
  std::array<unsigned char, 32> random{};
  if (RAND_bytes(random.data(), random.size()) != 1) return absl::InternalError("the system gives no random bytes");
  guard->link_key_.assign(random.begin(), random.end());
  if (options.token_file.empty()) return guard;
  guard->seen_ = LookOf(options.token_file);
  ASSIGN_OR_RETURN(std::vector<Token> tokens, ReadTokenFile(options.token_file));
  if (tokens.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the token file %s has no token, so that nobody could call: make one with 'depthtween-server "
                        "token new --tokens "
                        "%s --tenant NAME --scopes read,write'",
                        options.token_file, options.token_file));
  }
  guard->tokens_ = std::make_shared<const std::vector<Token>>(std::move(tokens));
  guard->next_look_ = absl::Now() + kLookGap;
  return guard;
}

Guard::Guard(GuardOptions options)
    : options_(std::move(options)), max_calls_per_second_(options_.max_calls_per_second) {}

absl::Status Guard::SetMaxCallsPerSecond(double calls) {
  // NaN fails the comparison too.
  if (!(calls >= 0)) {
    return BadField("limits.max_calls_per_second",
                    absl::StrFormat("limits.max_calls_per_second = %g, must be >= 0 (0: no limit)", calls));
  }
  max_calls_per_second_ = calls;
  return absl::OkStatus();
}

absl::StatusOr<Caller> Guard::Admit(const Credentials& credentials, const Needs& needs, std::string_view resource) {
  absl::StatusOr<Caller> caller = Caller{.tenant = Tenant(kDefaultTenant), .token_id = {}};
  if (!credentials.link.empty()) {
    caller = needs.link_opens ? AdmitLink(credentials.link, resource) : WrongScope(needs.scope);
  } else if (!options_.token_file.empty()) {
    caller = AdmitToken(credentials.authorization, needs.scope);
  }
  if (caller.ok()) RETURN_IF_ERROR(CountCall(caller->tenant));
  return caller;
}

Guard::Tokens Guard::CurrentTokens() {
  const std::lock_guard lock(mutex_);
  const absl::Time now = absl::Now();
  if (now < next_look_) return tokens_;
  next_look_ = now + kLookGap;
  std::string look = LookOf(options_.token_file);
  if (look == seen_) return tokens_;
  seen_ = std::move(look);
  absl::StatusOr<std::vector<Token>> read = ReadTokenFile(options_.token_file);
  if (read.ok()) {
    LogInfo("tokens read again", {{"tokens", absl::StrCat(read->size())}});
    tokens_ = std::make_shared<const std::vector<Token>>(*std::move(read));
  } else {
    LogError("cannot read the changed token file; the tokens known before stay valid",
             {{"error", std::string(read.status().message())}});
  }
  return tokens_;
}

absl::StatusOr<Caller> Guard::AdmitToken(std::string_view authorization, Scope needed) {
  // RFC 6750: the scheme's name in any case, one or more blanks, the token.
  constexpr size_t kSchemeLength = 7;
  const std::string_view scheme = authorization.substr(0, kSchemeLength);
  if (authorization.empty()) {
    return Refused("NO_TOKEN", "this server asks for a token: send 'authorization: Bearer SECRET'");
  }
  if (!absl::EqualsIgnoreCase(View(scheme), "bearer ")) {
    return Refused("BAD_TOKEN", "the authorization is not of the form 'Bearer SECRET'");
  }
  const absl::string_view secret = absl::StripAsciiWhitespace(View(authorization.substr(kSchemeLength)));
  const absl::Status unknown = Refused("BAD_TOKEN", "the token is not known to this server, or was revoked");
  if (secret.size() > kMaxSecretBytes) return unknown;
  const std::string hash = HashOfSecret({secret.data(), secret.size()});
  const Tokens tokens = CurrentTokens();
  const Token* found = nullptr;
  for (const Token& token : *tokens) {
    if (SameText(token.sha256, hash)) found = &token;  // goes through all, whichever it is
  }
  if (found == nullptr) return unknown;
  if (absl::Now() >= found->expire_time) {
    return Refused("EXPIRED_TOKEN", absl::StrCat("the token expired at ", absl::FormatTime(found->expire_time),
                                                 ": ask the operator for a new one"));
  }
  if (found->scopes.count(needed) == 0) return WrongScope(needed);
  return Caller{.tenant = Tenant(found->tenant), .token_id = found->id};
}

// A link is TENANT.EXPIRY.RESOURCE.SIGNATURE, with the resource in Base64.
absl::StatusOr<Caller> Guard::AdmitLink(std::string_view link, std::string_view resource) const {
  const absl::Status bad = Refused("BAD_LINK",
                                   "the link is not one of this server to this resource, or was made before "
                                   "the server was started: ask for a new one");
  const std::vector<std::string> parts = absl::StrSplit(View(link), '.');
  int64_t expiry = 0;
  if (parts.size() != 4 || link.size() > kMaxSecretBytes || !absl::SimpleAtoi(parts[1], &expiry)) return bad;
  std::string opens;
  if (!absl::WebSafeBase64Unescape(parts[2], &opens)) return bad;
  if (!SameText(LinkSignature(parts[0], opens, parts[1]), parts[3])) return bad;
  // What it was made for, and the job that this is an output of.
  if (opens != resource && opens.rfind(absl::StrCat(View(resource), "/outputs/"), 0) != 0) return bad;
  if (absl::Now() >= absl::FromUnixSeconds(expiry))
    return Refused("BAD_LINK", "the link has expired: ask for a new one");
  return Caller{.tenant = Tenant(parts[0]), .token_id = {}};
}

std::string Guard::SignLink(const Tenant& tenant, std::string_view resource, absl::Duration life) const {
  const std::string expiry = absl::StrCat(absl::ToUnixSeconds(absl::Now() + std::min(life, kMaxLinkLife)));
  return absl::StrCat(tenant.name(), ".", expiry, ".", absl::WebSafeBase64Escape(View(resource)), ".",
                      LinkSignature(tenant.name(), resource, expiry));
}

// Neither a tenant's name nor a number has a line break, so that no two triples give one text.
std::string Guard::LinkSignature(std::string_view tenant, std::string_view resource, std::string_view expiry) const {
  const std::string text = absl::StrCat(View(tenant), "\n", View(expiry), "\n", View(resource));
  std::array<unsigned char, EVP_MAX_MD_SIZE> mac{};
  unsigned int size = 0;
  HMAC(EVP_sha256(), link_key_.data(), static_cast<int>(link_key_.size()),
       reinterpret_cast<const unsigned char*>(text.data()), text.size(), mac.data(), &size);
  return absl::WebSafeBase64Escape({reinterpret_cast<const char*>(mac.data()), size});
}

absl::Status Guard::CountCall(const Tenant& tenant) {
  const double rate = max_calls_per_second_;
  if (rate == 0) return absl::OkStatus();
  const std::lock_guard lock(mutex_);
  const absl::Time now = absl::Now();
  const double full = std::max(1.0, rate * kBurstSeconds);
  const auto [entry, fresh] = buckets_.try_emplace(tenant.name(), Bucket{.calls = full, .counted = now});
  Bucket& bucket = entry->second;
  bucket.calls = std::min(full, bucket.calls + rate * std::max(0.0, absl::ToDoubleSeconds(now - bucket.counted)));
  bucket.counted = now;
  if (bucket.calls < 1) {
    return LimitExceeded("max_calls_per_second", static_cast<int64_t>(rate),
                         absl::StrFormat("the tenant %s makes more than %g calls a second", tenant.name(), rate));
  }
  bucket.calls -= 1;
  return absl::OkStatus();
}

}  // namespace depthtween::server
