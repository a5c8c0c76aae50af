#include "server/access/token_file.h"

#include <fcntl.h>
#include <openssl/rand.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "proto/depthtween/sha256.h"
#include "server/store/error_info.h"
#include "server/store/files.h"
#include "server/store/resource_names.h"

namespace depthtween::server {
namespace {

using nlohmann::json;

constexpr int64_t kMaxTokenFileBytes = 16 << 20;
constexpr int kSecretBytes = 32;
constexpr char kSecretPrefix[] = "dt_";  // so that secret scanners can find one that was published

std::string FormatTokenTime(absl::Time time) { return absl::FormatTime(absl::RFC3339_sec, time, absl::UTCTimeZone()); }

absl::StatusOr<absl::Time> ParseTokenTime(const std::string& text) {
  absl::Time time;
  std::string why;
  if (absl::ParseTime(absl::RFC3339_full, text, &time, &why)) return time;
  return absl::InvalidArgumentError(absl::StrCat("\"", text, "\" is no time such as 2027-01-31T00:00:00Z"));
}

absl::StatusOr<Token> ParseToken(const json& entry) {
  Token token;
  token.id = entry.at("id").get<std::string>();
  token.sha256 = entry.at("sha256").get<std::string>();
  if (absl::HexStringToBytes(token.sha256).size() != 32 || Hex(absl::HexStringToBytes(token.sha256)) != token.sha256) {
    return absl::InvalidArgumentError(absl::StrCat("sha256 of token ", token.id, " must be 64 hexadecimal digits"));
  }
  token.tenant = entry.at("tenant").get<std::string>();
  RETURN_IF_ERROR(CheckTenantName(token.tenant));
  ASSIGN_OR_RETURN(token.scopes, ParseScopes(entry.at("scopes").get<std::string>()));
  ASSIGN_OR_RETURN(token.create_time, ParseTokenTime(entry.at("create_time").get<std::string>()));
  if (entry.contains("expire_time")) {
    ASSIGN_OR_RETURN(token.expire_time, ParseTokenTime(entry.at("expire_time").get<std::string>()));
  }
  return token;
}

std::string FormatTokens(const std::vector<Token>& tokens) {
  json list = json::array();
  for (const Token& token : tokens) {
    json entry = {{"id", token.id},
                  {"sha256", token.sha256},
                  {"tenant", token.tenant},
                  {"scopes", JoinScopes(token.scopes)},
                  {"create_time", FormatTokenTime(token.create_time)}};
    if (token.expire_time != absl::InfiniteFuture()) entry["expire_time"] = FormatTokenTime(token.expire_time);
    list.push_back(std::move(entry));
  }
  return json{{"tokens", std::move(list)}}.dump(2) + "\n";
}

std::string FolderOfFile(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

// Reads, changes and writes the file while no other process does.
absl::Status ChangeTokens(const std::string& path, bool make,
                          const std::function<absl::Status(std::vector<Token>&)>& change) {
  const std::string folder = FolderOfFile(path);
  const int lock = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock < 0) return ErrnoStatus(errno, "open the folder " + folder);
  struct Close {
    int descriptor;
    ~Close() { close(descriptor); }
  } const close_lock{lock};
  if (flock(lock, LOCK_EX) != 0) return ErrnoStatus(errno, "lock the folder " + folder);

  absl::StatusOr<std::vector<Token>> tokens = ReadTokenFile(path);
  if (absl::IsNotFound(tokens.status()) && make) tokens = std::vector<Token>();
  RETURN_IF_ERROR(tokens.status());
  RETURN_IF_ERROR(change(*tokens));

  const std::string unfinished = path + ".tmp";
  RETURN_IF_ERROR(WriteScratchFile(unfinished, ""));
  if (chmod(unfinished.c_str(), 0600) != 0) return ErrnoStatus(errno, "protect " + unfinished);
  RETURN_IF_ERROR(WriteScratchFile(unfinished, FormatTokens(*tokens)));
  RETURN_IF_ERROR(SyncFile(unfinished));
  RETURN_IF_ERROR(MoveFile(unfinished, path));
  return SyncFolder(folder);
}

}  // namespace

std::string HashOfSecret(std::string_view secret) {
  Sha256 hash;
  hash.Update(secret);
  return Hex(hash.Finish());
}

absl::StatusOr<std::vector<Token>> ParseTokens(std::string_view text) {
  std::vector<Token> tokens;
  try {
    const json document = json::parse(text);
    for (const json& entry : document.at("tokens")) {
      ASSIGN_OR_RETURN(Token token, ParseToken(entry));
      tokens.push_back(std::move(token));
    }
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat("is not a token file as 'depthtween-server token new' makes it: ", std::string(error.what())));
  }
  return tokens;
}

absl::StatusOr<std::vector<Token>> ReadTokenFile(const std::string& path) {
  struct stat facts {};
  if (stat(path.c_str(), &facts) != 0) return ErrnoStatus(errno, "read the token file " + path);
  if ((facts.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the token file %s can be written by others, who could let themselves in: chmod 600 it", path));
  }
  ASSIGN_OR_RETURN(const std::string text, ReadWholeFile(path, kMaxTokenFileBytes));
  absl::StatusOr<std::vector<Token>> tokens = ParseTokens(text);
  if (!tokens.ok()) return WithContext(tokens.status(), path);
  return tokens;
}

absl::StatusOr<std::string> AddToken(const std::string& path, const NewToken& wanted) {
  RETURN_IF_ERROR(CheckTenantName(wanted.tenant));
  if (wanted.scopes.empty()) return absl::InvalidArgumentError("scopes: name at least one of read, write, admin");
  if (wanted.lifetime <= absl::ZeroDuration()) return absl::InvalidArgumentError("the lifetime must be longer than 0");
  std::array<unsigned char, kSecretBytes> random{};
  if (RAND_bytes(random.data(), kSecretBytes) != 1) return absl::InternalError("the system gives no random bytes");
  const std::string secret =
      kSecretPrefix + absl::WebSafeBase64Escape({reinterpret_cast<const char*>(random.data()), random.size()});
  const absl::Time now = absl::Now();
  const Token token = {.id = NewId(),
                       .sha256 = HashOfSecret(secret),
                       .tenant = wanted.tenant,
                       .scopes = wanted.scopes,
                       .create_time = now,
                       .expire_time = now + wanted.lifetime};
  RETURN_IF_ERROR(ChangeTokens(path, /*make=*/true, [&](std::vector<Token>& tokens) {
    tokens.push_back(token);
    return absl::OkStatus();
  }));
  return secret;
}

absl::Status RevokeToken(const std::string& path, std::string_view id) {
  return ChangeTokens(path, /*make=*/false, [&](std::vector<Token>& tokens) -> absl::Status {
    if (std::erase_if(tokens, [&](const Token& token) { return token.id == id; }) > 0) return absl::OkStatus();
    return absl::NotFoundError(
        absl::StrFormat("%s has no token %s; 'depthtween-server token list' shows them", path, std::string(id)));
  });
}

absl::StatusOr<absl::Duration> ParseLifetime(std::string_view text) {
  int64_t number = 0;
  const std::string digits(text.substr(0, text.empty() ? 0 : text.size() - 1));
  const bool plain = digits.find_first_not_of("0123456789") == std::string::npos;
  if (plain && absl::SimpleAtoi(digits, &number) && number > 0 && number <= 1'000'000) {
    if (text.back() == 'd') return absl::Hours(24) * number;
    if (text.back() == 'h') return absl::Hours(number);
    if (text.back() == 'm') return absl::Minutes(number);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("\"", std::string(text), "\" is no lifetime, must be such as 30d, 12h or 45m"));
}

}  // namespace depthtween::server
