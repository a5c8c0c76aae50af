#include "server/webhooks/signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <array>
#include <new>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "server/store/error_info.h"
#include "server/store/files.h"

namespace depthtween::server {
namespace {

constexpr size_t kMinKeyBytes = 24, kMaxKeyBytes = 64;
constexpr int64_t kMaxKeyFileBytes = 64 << 10;

}  // namespace

absl::StatusOr<std::vector<std::string>> ParseWebhookKeys(std::string_view text) {
  std::vector<std::string> keys;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(absl::string_view(text.data(), text.size()), '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#') continue;
    if (!absl::ConsumePrefix(&line, "whsec_") || !absl::Base64Unescape(line, &keys.emplace_back()) ||
        keys.back().size() < kMinKeyBytes || keys.back().size() > kMaxKeyBytes) {
      return absl::InvalidArgumentError(absl::StrCat("line ", number, " must be \"whsec_\" and base64 of ",
                                                     kMinKeyBytes, " to ", kMaxKeyBytes,
                                                     " bytes; echo whsec_$(openssl rand -base64 32) makes one"));
    }
  }
  if (keys.empty()) {
    return absl::InvalidArgumentError("there is no key; echo whsec_$(openssl rand -base64 32) makes one");
  }
  return keys;
}

absl::StatusOr<std::vector<std::string>> ReadWebhookKeys(const std::string& file) {
  ASSIGN_OR_RETURN(const std::string text, ReadWholeFile(file, kMaxKeyFileBytes));
  absl::StatusOr<std::vector<std::string>> keys = ParseWebhookKeys(text);
  return keys.ok() ? keys : WithContext(keys.status(), file);
}

std::string SignWebhook(const std::vector<std::string>& keys, std::string_view id, int64_t timestamp_s,
                        std::string_view body) {
  const std::string text = absl::StrCat(View(id), ".", timestamp_s, ".", View(body));
  std::string header;
  for (const std::string& key : keys) {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int size = 0;
    if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()),
             reinterpret_cast<const unsigned char*>(text.data()), text.size(), digest.data(), &size) == nullptr) {
      throw std::bad_alloc();  // the only way it fails
    }
    absl::StrAppend(&header, header.empty() ? "" : " ", "v1,",
                    absl::Base64Escape(absl::string_view(reinterpret_cast<const char*>(digest.data()), size)));
  }
  return header;
}

}  // namespace depthtween::server
