#include "server/http/transport.h"

#include <poll.h>

#include <array>
#include <boost/asio/as_tuple.hpp>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/core/buffers_suffix.hpp>
#include <type_traits>
#include <utility>

#include "absl/time/clock.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
using Tcp = asio::ip::tcp;
using TlsStream = asio::ssl::stream<Tcp::socket>;

constexpr auto kAwait = asio::as_tuple(asio::use_awaitable);

// Closes the socket when time is up, which fails the operation under way.
class Watchdog {
 public:
  explicit Watchdog(Tcp::socket& socket) : socket_(socket), timer_(socket.get_executor()) {}

  void Set(absl::Time deadline) {
    expired_ = false;
    timer_.expires_after(absl::ToChronoNanoseconds(std::max(deadline - absl::Now(), absl::ZeroDuration())));
    // A handler that has been queued when the timer is set anew or cancelled must do nothing.
    timer_.async_wait([this, turn = ++turn_, alive = std::weak_ptr<int>(alive_)](boost::system::error_code error) {
      if (error || alive.expired() || turn != turn_) return;
      expired_ = true;
      boost::system::error_code ignored;
      socket_.close(ignored);
    });
  }
  void Clear() {
    ++turn_;
    timer_.cancel();
  }
  bool expired() const { return expired_; }

 private:
  Tcp::socket& socket_;
  asio::steady_timer timer_;
  int64_t turn_ = 0;
  bool expired_ = false;
  const std::shared_ptr<int> alive_ = std::make_shared<int>(0);
};

template <typename Stream>
class StreamTransport : public Transport {
 public:
  template <typename... Arguments>
  explicit StreamTransport(Arguments&&... arguments)
      : stream_(std::forward<Arguments>(arguments)...), watchdog_(Socket()) {
    boost::system::error_code ignored;
    Socket().set_option(Tcp::no_delay(true), ignored);  // an event of a stream must not wait for the next one
  }

  asio::any_io_executor executor() override { return Socket().get_executor(); }

  asio::awaitable<absl::Status> Handshake(absl::Time deadline) override {
    if constexpr (kTls) {
      watchdog_.Set(deadline);
      const auto [error] = co_await stream_.async_handshake(asio::ssl::stream_base::server, kAwait);
      watchdog_.Clear();
      if (error) co_return Failed(error);
    }
    co_return absl::OkStatus();
  }

  asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size, absl::Time deadline) override {
    watchdog_.Set(deadline);
    const auto [error, count] = co_await stream_.async_read_some(asio::buffer(data, size), kAwait);
    watchdog_.Clear();
    if (!error) co_return count;
    // Without close_notify a cut TLS stream looks the same; lengths and chunks say whether a request is whole.
    if (error == asio::error::eof || error == asio::ssl::error::stream_truncated) co_return size_t{0};
    co_return Failed(error);
  }

  asio::awaitable<absl::Status> Write(std::vector<std::string_view> pieces, absl::Duration patience) override {
    std::vector<asio::const_buffer> buffers;
    for (const std::string_view piece : pieces) buffers.emplace_back(piece.data(), piece.size());
    boost::beast::buffers_suffix<std::vector<asio::const_buffer>> rest(buffers);
    while (asio::buffer_size(rest) > 0) {
      watchdog_.Set(absl::Now() + patience);
      const auto [error, count] = co_await stream_.async_write_some(rest, kAwait);
      watchdog_.Clear();
      if (error) co_return Failed(error);
      rest.consume(count);
    }
    co_return absl::OkStatus();
  }

  asio::awaitable<void> ShutDown(absl::Time deadline) override {
    watchdog_.Set(deadline);
    boost::system::error_code error;
    // Sends close_notify and waits for the peer's, which some never send: then the watchdog ends it.
    if constexpr (kTls) co_await stream_.async_shutdown(kAwait);
    Socket().shutdown(Tcp::socket::shutdown_send, error);
    // Closing a socket with unread bytes resets the connection, and the peer may then lose the answer.
    std::array<char, 4096> dropped;  // NOLINT(cppcoreguidelines-pro-type-member-init): never read
    while (!error) {
      const auto [failed, count] = co_await Socket().async_read_some(asio::buffer(dropped), kAwait);
      error = failed;
    }
    watchdog_.Clear();
    Close();
  }

  void Close() override {
    boost::system::error_code ignored;
    Socket().close(ignored);
  }

  bool PeerIsGone() override {
    if (!Socket().is_open()) return true;
    pollfd poller{.fd = Socket().native_handle(), .events = POLLRDHUP, .revents = 0};
    return poll(&poller, 1, 0) > 0;
  }

 private:
  static constexpr bool kTls = std::is_same_v<Stream, TlsStream>;

  Tcp::socket& Socket() {
    if constexpr (kTls) {
      return stream_.next_layer();
    } else {
      return stream_;
    }
  }

  absl::Status Failed(const boost::system::error_code& error) {
    Close();
    if (watchdog_.expired()) return absl::DeadlineExceededError("the connection was too slow");
    return absl::CancelledError(absl::StrCat("the connection is gone: ", error.message()));
  }

  Stream stream_;
  Watchdog watchdog_;
};

}  // namespace

std::unique_ptr<Transport> MakeTransport(Tcp::socket socket, const std::shared_ptr<asio::ssl::context>& tls) {
  if (tls == nullptr) return std::make_unique<StreamTransport<Tcp::socket>>(std::move(socket));
  return std::make_unique<StreamTransport<TlsStream>>(std::move(socket), *tls);
}

}  // namespace depthtween::server
