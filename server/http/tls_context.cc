#include "server/http/tls_context.h"

#include <openssl/ssl.h>

#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

namespace ssl = boost::asio::ssl;

std::vector<std::filesystem::file_time_type> TimesOf(const TlsFiles& files) {
  std::vector<std::filesystem::file_time_type> times;
  for (const std::string& file : {files.cert, files.key, files.client_ca}) {
    std::error_code missing;
    times.push_back(std::filesystem::last_write_time(file, missing));
    if (missing) times.back() = {};
  }
  return times;
}

// HTTP/1.1 is all there is; a client that offers only h2 is told so by no choice.
int ChooseProtocol(SSL* /*ssl*/, const unsigned char** out, unsigned char* out_size, const unsigned char* in,
                   unsigned int in_size, void* /*argument*/) {
  static constexpr unsigned char kOurs[] = {8, 'h', 't', 't', 'p', '/', '1', '.', '1'};
  unsigned char* chosen = nullptr;
  if (SSL_select_next_proto(&chosen, out_size, kOurs, sizeof(kOurs), in, in_size) != OPENSSL_NPN_NEGOTIATED) {
    return SSL_TLSEXT_ERR_NOACK;
  }
  *out = chosen;
  return SSL_TLSEXT_ERR_OK;
}

absl::Status BadFile(const char* flag, const std::string& file, const boost::system::error_code& error) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s = \"%s\", must be a readable PEM file: %s", flag, file, error.message()));
}

absl::StatusOr<std::shared_ptr<ssl::context>> ReadContext(const TlsFiles& files) {
  auto context = std::make_shared<ssl::context>(ssl::context::tls_server);
  boost::system::error_code error;
  context->set_options(ssl::context::default_workarounds | ssl::context::no_sslv2 | ssl::context::no_sslv3 |
                           ssl::context::no_tlsv1 | ssl::context::no_tlsv1_1 | SSL_OP_NO_RENEGOTIATION,
                       error);
  if (!error) context->use_certificate_chain_file(files.cert, error);
  if (error) return BadFile("tls_cert", files.cert, error);
  context->use_private_key_file(files.key, ssl::context::pem, error);
  if (error) return BadFile("tls_key", files.key, error);
  SSL_CTX* native = context->native_handle();
  if (SSL_CTX_check_private_key(native) != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("tls_key = \"%s\", must be the key of the certificate in \"%s\"", files.key, files.cert));
  }
  if (!files.client_ca.empty()) {
    context->load_verify_file(files.client_ca, error);
    if (!error) context->set_verify_mode(ssl::verify_peer | ssl::verify_fail_if_no_peer_cert, error);
    if (error) return BadFile("tls_client_ca", files.client_ca, error);
    SSL_CTX_set_client_CA_list(native, SSL_load_client_CA_file(files.client_ca.c_str()));
  }
  // Sessions are resumed only here, and only where the client's certificate was seen.
  static constexpr unsigned char kSessionId[] = "depthtween-http";
  SSL_CTX_set_session_id_context(native, kSessionId, sizeof(kSessionId) - 1);
  SSL_CTX_set_alpn_select_cb(native, ChooseProtocol, nullptr);
  return context;
}

}  // namespace

absl::StatusOr<std::unique_ptr<TlsContext>> TlsContext::Load(const TlsFiles& files) {
  // A file that changes while it is read is then read again.
  std::vector<std::filesystem::file_time_type> times = TimesOf(files);
  ASSIGN_OR_RETURN(std::shared_ptr<ssl::context> context, ReadContext(files));
  return std::unique_ptr<TlsContext>(new TlsContext(files, std::move(context), std::move(times)));
}

TlsContext::TlsContext(TlsFiles files, std::shared_ptr<ssl::context> context,
                       std::vector<std::filesystem::file_time_type> times)
    : files_(std::move(files)), context_(std::move(context)), file_times_(std::move(times)), checked_(absl::Now()) {}

std::shared_ptr<ssl::context> TlsContext::Current(absl::Duration check_every) {
  const std::lock_guard lock(mutex_);
  if (absl::Now() - checked_ < check_every) return context_;
  checked_ = absl::Now();
  std::vector<std::filesystem::file_time_type> times = TimesOf(files_);
  if (times == file_times_) return context_;
  file_times_ = std::move(times);
  absl::StatusOr<std::shared_ptr<ssl::context>> context = ReadContext(files_);
  if (context.ok()) {
    context_ = *std::move(context);
    LogInfo("certificate_reloaded", {{"listener", "http"}, {"file", files_.cert}});
  } else {
    LogWarning("certificate_kept", {{"listener", "http"}, {"why", std::string(context.status().message())}});
  }
  return context_;
}

}  // namespace depthtween::server
