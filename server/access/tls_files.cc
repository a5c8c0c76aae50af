#include "server/access/tls_files.h"

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <memory>

#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

struct FreeOpenSsl {
  void operator()(BIO* file) const { BIO_free(file); }
  void operator()(X509* certificate) const { X509_free(certificate); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
};
template <typename T>
using Owned = std::unique_ptr<T, FreeOpenSsl>;

absl::Status BadTlsFile(absl::string_view flag, const std::string& file, absl::string_view why) {
  ERR_clear_error();
  return absl::InvalidArgumentError(absl::StrCat(flag, " = ", file, ": ", why));
}

absl::StatusOr<Owned<X509>> ReadCertificate(absl::string_view flag, const std::string& file) {
  if (file.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        flag, " is missing: TLS needs --tls-cert and --tls-key, and clients' certificates --tls-client-ca"));
  }
  const Owned<BIO> bytes(BIO_new_file(file.c_str(), "r"));
  if (bytes == nullptr) return BadTlsFile(flag, file, "cannot be read");
  Owned<X509> certificate(PEM_read_bio_X509(bytes.get(), nullptr, nullptr, nullptr));
  if (certificate == nullptr) return BadTlsFile(flag, file, "has no certificate in PEM form");
  if (X509_cmp_current_time(X509_get0_notAfter(certificate.get())) < 0) {
    return BadTlsFile(flag, file, "the certificate has expired");
  }
  return certificate;
}

// A key with a pass phrase would make OpenSSL ask for it at the terminal.
int NoPassPhrase(char* /*buffer*/, int /*size*/, int /*writing*/, void* /*context*/) { return -1; }

}  // namespace

absl::Status CheckTlsFiles(const TlsFiles& files) {
  ASSIGN_OR_RETURN(const Owned<X509> certificate, ReadCertificate("--tls-cert", files.cert));
  if (files.key.empty()) return absl::InvalidArgumentError("--tls-key is missing: TLS needs --tls-cert and --tls-key");
  const Owned<BIO> bytes(BIO_new_file(files.key.c_str(), "r"));
  if (bytes == nullptr) return BadTlsFile("--tls-key", files.key, "cannot be read");
  const Owned<EVP_PKEY> key(PEM_read_bio_PrivateKey(bytes.get(), nullptr, NoPassPhrase, nullptr));
  if (key == nullptr) return BadTlsFile("--tls-key", files.key, "has no private key in PEM form without a pass phrase");
  if (X509_check_private_key(certificate.get(), key.get()) != 1) {
    return BadTlsFile("--tls-key", files.key, absl::StrCat("does not belong to the certificate in ", files.cert));
  }
  return files.client_ca.empty() ? absl::OkStatus() : ReadCertificate("--tls-client-ca", files.client_ca).status();
}

}  // namespace depthtween::server
