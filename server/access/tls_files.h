// The files that make a listener speak TLS.
#ifndef DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_
#define DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_

#include <string>

namespace depthtween::server {

// PEM files. Both listeners read them again when they change, so that certificates are renewed without a restart.
struct TlsFiles {
  std::string cert;       // the chain, the server's own certificate first; empty: no TLS
  std::string key;        // of the certificate
  std::string client_ca;  // if set, clients must show a certificate that one of these has signed

  bool enabled() const { return !cert.empty() || !key.empty() || !client_ca.empty(); }
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_ACCESS_TLS_FILES_H_
