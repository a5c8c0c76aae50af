// The certificate of the HTTP listener, which follows its files.
#ifndef DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_
#define DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_

#include <boost/asio/ssl/context.hpp>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"

namespace depthtween::server {

class TlsContext {
 public:
  // PEM files: a chain, its key, and (if not empty) the authority that clients' certificates must be signed by, without
  // which no connection is made. InvalidArgument names the file that does not work.
  static absl::StatusOr<std::unique_ptr<TlsContext>> Load(const std::string& cert, const std::string& key,
                                                          const std::string& client_ca);

  // For a new connection. Looks at the files at most once in `check_every`; if one has changed, all are read again. If
  // they do not work, that is logged once and what worked stays. Threads: may be called concurrently.
  std::shared_ptr<boost::asio::ssl::context> Current(absl::Duration check_every = absl::Seconds(1));

 private:
  TlsContext(std::vector<std::string> files, std::shared_ptr<boost::asio::ssl::context> context);

  const std::vector<std::string> files_;  // certificate, key, authority or ""
  std::mutex mutex_;
  std::shared_ptr<boost::asio::ssl::context> context_;       // guarded by mutex_
  std::vector<std::filesystem::file_time_type> file_times_;  // guarded by mutex_
  absl::Time checked_;                                       // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_
