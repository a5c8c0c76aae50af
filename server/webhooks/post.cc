#include "server/webhooks/post.h"

#include <openssl/ssl.h>

#include <boost/asio/as_tuple.hpp>
#include <boost/asio/awaitable.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <exception>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using Tcp = asio::ip::tcp;

constexpr auto kAwaitPost = asio::as_tuple(asio::use_awaitable);
constexpr uint32_t kMaxAnswerHeadBytes = 16 << 10;

absl::Status Failed(const WebhookUrl& url, std::string_view what, const boost::system::error_code& error) {
  return absl::UnavailableError(
      absl::StrCat(url.authority, ": ", absl::string_view(what.data(), what.size()), ": ", error.message()));
}

// Why a handshake failed: the certificate's fault says more than "handshake".
absl::Status HandshakeFailed(const WebhookUrl& url, SSL* ssl, const boost::system::error_code& error) {
  const long verified = SSL_get_verify_result(ssl);
  if (verified == X509_V_OK) return Failed(url, "TLS", error);
  return absl::UnavailableError(
      absl::StrCat(url.authority, ": its certificate is not trusted: ", X509_verify_cert_error_string(verified)));
}

absl::Status Judge(const WebhookUrl& url, int status) {
  if (status >= 200 && status < 300) return absl::OkStatus();
  const std::string answered = absl::StrCat(url.authority, " answered ", status);
  if (status == 410) return absl::FailedPreconditionError(absl::StrCat(answered, ": it wants no more of it"));
  return absl::UnavailableError(
      absl::StrCat(answered, status >= 300 && status < 400 ? "; redirects are not followed" : ", must be 200 to 299"));
}

template <typename Stream>
asio::awaitable<absl::Status> Exchange(const WebhookUrl& url, const WebhookPost& post, Stream& stream) {
  http::request<http::string_body> request(http::verb::post, url.target, 11, post.body);
  request.set(http::field::host, url.authority);
  request.set(http::field::user_agent, "depthtween-server/" DEPTHTWEEN_VERSION);
  request.set(http::field::content_type, "application/json");
  request.set(http::field::connection, "close");
  request.set("webhook-id", post.event_id);
  request.set("webhook-timestamp", absl::StrCat(post.timestamp_s));
  request.set("webhook-signature", post.signature);
  request.prepare_payload();
  const auto [not_sent, sent] = co_await http::async_write(stream, request, kAwaitPost);
  if (not_sent) co_return Failed(url, "cannot send", not_sent);
  boost::beast::flat_buffer buffer(kMaxAnswerHeadBytes);
  http::response_parser<http::empty_body> answer;
  answer.header_limit(kMaxAnswerHeadBytes);
  const auto [not_read, read] = co_await http::async_read_header(stream, buffer, answer, kAwaitPost);
  if (not_read) co_return Failed(url, "no answer", not_read);
  co_return Judge(url, answer.get().result_int());
}

asio::awaitable<absl::Status> Deliver(const WebhookUrl& url, const WebhookPost& post, bool allow_private) {
  const asio::any_io_executor executor = co_await asio::this_coro::executor;
  Tcp::resolver resolver(executor);
  const auto [unknown, found] = co_await resolver.async_resolve(url.host, url.port, kAwaitPost);
  if (unknown) co_return Failed(url, "its name leads nowhere", unknown);
  // Connected to by their numbers: asked again, the name might lead elsewhere.
  std::vector<Tcp::endpoint> addresses;
  for (const auto& entry : found) {
    if (allow_private || IsPublicAddress(entry.endpoint().address())) addresses.push_back(entry.endpoint());
  }
  if (addresses.empty()) {
    co_return absl::PermissionDeniedError(
        absl::StrCat(url.authority, " is no address of the public internet, and this server sends to no other"));
  }
  Tcp::socket socket(executor);
  const auto [refused, endpoint] = co_await asio::async_connect(socket, addresses, kAwaitPost);
  if (refused) co_return Failed(url, "cannot connect", refused);
  if (!url.tls) co_return co_await Exchange(url, post, socket);

  asio::ssl::context tls(asio::ssl::context::tls_client);
  boost::system::error_code error;
  tls.set_options(
      asio::ssl::context::default_workarounds | asio::ssl::context::no_tlsv1 | asio::ssl::context::no_tlsv1_1, error);
  if (!error) tls.set_default_verify_paths(error);
  if (error) co_return Failed(url, "TLS", error);
  asio::ssl::stream<Tcp::socket> stream(std::move(socket), tls);
  stream.set_verify_mode(asio::ssl::verify_peer, error);
  if (!error) stream.set_verify_callback(asio::ssl::host_name_verification(url.host), error);
  boost::system::error_code is_name;
  asio::ip::make_address(url.host, is_name);  // addresses are not sent as names
  if (is_name) SSL_set_tlsext_host_name(stream.native_handle(), url.host.c_str());
  if (error) co_return Failed(url, "TLS", error);
  const auto [rejected] = co_await stream.async_handshake(asio::ssl::stream_base::client, kAwaitPost);
  if (rejected) co_return HandshakeFailed(url, stream.native_handle(), rejected);
  co_return co_await Exchange(url, post, stream);
}

}  // namespace

absl::Status PostWebhook(const WebhookUrl& url, const WebhookPost& post, const PostOptions& options,
                         const std::stop_token& stop) {
  std::optional<absl::Status> result;
  // Its end destroys what is under way, which then touches nothing any more.
  asio::io_context context(1);
  asio::co_spawn(context, Deliver(url, post, options.allow_private),
                 [&result](const std::exception_ptr& thrown, absl::Status status) {
                   if (!thrown) {
                     result = std::move(status);
                     return;
                   }
                   try {
                     std::rethrow_exception(thrown);
                   } catch (const std::exception& error) {
                     result = absl::UnavailableError(error.what());
                   }
                 });
  {
    const std::stop_callback on_stop(stop, [&context] { context.stop(); });
    context.run_for(absl::ToChronoNanoseconds(options.time_limit));
  }
  if (result) return *std::move(result);
  if (stop.stop_requested()) return absl::CancelledError("the server stops");
  return absl::UnavailableError(
      absl::StrCat(url.authority, ": no answer within ", absl::FormatDuration(options.time_limit)));
}

}  // namespace depthtween::server
