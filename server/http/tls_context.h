// The certificate of the HTTP listener, which follows its files.
#ifndef DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_
#define DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_

#include <boost/asio/ssl/context.hpp>
#include <filesystem>
#include <memory>
#include <mutex>
#include <vector>

#include "absl/time/time.h"
#include "core/base/status.h"
#include "server/access/tls_files.h"

namespace depthtween::server {

class TlsContext {
 public:
  // InvalidArgument names the file that does not work.
  static absl::StatusOr<std::unique_ptr<TlsContext>> Load(const TlsFiles& files);

  // For a new connection. Looks at the files at most once in `check_every`; if one has changed, all are read again. If
  // they do not work, that is logged once and what worked stays. Threads: may be called concurrently.
  std::shared_ptr<boost::asio::ssl::context> Current(absl::Duration check_every = absl::Seconds(1));

 private:
  TlsContext(TlsFiles files, std::shared_ptr<boost::asio::ssl::context> context,
             std::vector<std::filesystem::file_time_type> times);

  const TlsFiles files_;
  std::mutex mutex_;
  std::shared_ptr<boost::asio::ssl::context> context_;       // guarded by mutex_
  std::vector<std::filesystem::file_time_type> file_times_;  // guarded by mutex_
  absl::Time checked_;                                       // guarded by mutex_
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_TLS_CONTEXT_H_
