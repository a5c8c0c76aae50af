// The files that make a listener speak TLS.
#ifndef DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_
#define DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_

#include <string>

#include "core/base/status.h"

namespace depthtween::server {

// PEM files. Both listeners read them again when they change, so that certificates are renewed without a restart.
struct TlsFiles {
  std::string cert;       // the chain, the server's own certificate first; empty: no TLS
  std::string key;        // of the certificate
  std::string client_ca;  // if set, clients must show a certificate that one of these has signed

  bool enabled() const { return !cert.empty() || !key.empty() || !client_ca.empty(); }
};

// OK if the files can be read and used together. InvalidArgument names the file and what is wrong: missing, not PEM, a
// key that does not belong to the certificate, or a certificate that has expired.
absl::Status CheckTlsFiles(const TlsFiles& files);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_
