// SHA-256, by which depthtween.v1 tells files and requests apart; by OpenSSL's libcrypto.
//
// It lives with the protocol, header-only, because server and clients share nothing else.
#ifndef DEPTHTWEEN_PROTO_DEPTHTWEEN_SHA256_H_
#define DEPTHTWEEN_PROTO_DEPTHTWEEN_SHA256_H_

#include <openssl/evp.h>

#include <memory>
#include <new>
#include <string>
#include <string_view>

#include "absl/strings/escaping.h"

namespace depthtween {

// Grammar:  Update* Finish. Throws std::bad_alloc when OpenSSL runs out of memory, the only way its calls fail here.
class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new()) {
    Check(context_ == nullptr ? 0 : EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr));
  }

  void Update(std::string_view bytes) { Check(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size())); }
  // 32 bytes.
  std::string Finish() {
    std::string digest(32, '\0');
    Check(EVP_DigestFinal_ex(context_.get(), reinterpret_cast<unsigned char*>(digest.data()), nullptr));
    return digest;
  }

 private:
  struct Free {
    void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
  };
  static void Check(int succeeded) {
    if (succeeded != 1) throw std::bad_alloc();
  }

  std::unique_ptr<EVP_MD_CTX, Free> context_;
};

// Lower-case hexadecimal.
inline std::string Hex(std::string_view bytes) { return absl::BytesToHexString({bytes.data(), bytes.size()}); }

}  // namespace depthtween

#endif  // DEPTHTWEEN_PROTO_DEPTHTWEEN_SHA256_H_
