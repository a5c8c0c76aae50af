// SHA-256, by which files and whole recordings are told apart.
#ifndef DEPTHTWEEN_CLIENT_LIB_SHA256_H_
#define DEPTHTWEEN_CLIENT_LIB_SHA256_H_

#include <memory>
#include <string>
#include <string_view>

struct evp_md_ctx_st;

namespace depthtween::client {

// Grammar of use:  Add* Finish
class Sha256 {
 public:
  Sha256();
  void Add(std::string_view bytes);
  // The 32 bytes of the digest.
  std::string Finish();

 private:
  struct Free {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, Free> context_;
};

// Lower-case hexadecimal.
std::string Hex(std::string_view bytes);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_SHA256_H_
