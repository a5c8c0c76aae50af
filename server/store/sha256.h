// SHA-256, by OpenSSL's libcrypto.
#ifndef DEPTHTWEEN_SERVER_STORE_SHA256_H_
#define DEPTHTWEEN_SERVER_STORE_SHA256_H_

#include <memory>
#include <string>
#include <string_view>

namespace depthtween::server {

// Grammar:  Update* Finish
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void Update(std::string_view bytes);
  // 32 bytes.
  std::string Finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

// Lower-case hexadecimal.
std::string Hex(std::string_view bytes);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_SHA256_H_
