// An exchange without a socket: the request's body is a string, the answer is recorded.
#ifndef DEPTHTWEEN_TESTS_SERVER_HTTP_FAKE_EXCHANGE_H_
#define DEPTHTWEEN_TESTS_SERVER_HTTP_FAKE_EXCHANGE_H_

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/use_future.hpp>
#include <optional>
#include <string>
#include <utility>

#include "server/http/exchange.h"

namespace depthtween::server {

class FakeExchange : public Exchange {
 public:
  FakeExchange(boost::asio::io_context& context, HttpRequest request, std::string body = "", size_t piece_bytes = 1000)
      : Exchange(std::move(request)), context_(context), to_read_(std::move(body)), piece_bytes_(piece_bytes) {}

  boost::asio::any_io_executor executor() override { return context_.get_executor(); }
  boost::asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size) override {
    if (gone()) co_return absl::CancelledError("the client is gone");
    const size_t count = std::min({size, piece_bytes_, to_read_.size()});
    std::copy_n(to_read_.begin(), count, data);
    to_read_.erase(0, count);
    co_return count;
  }
  boost::asio::awaitable<absl::Status> Respond(HttpResponse response) override {
    if (gone()) co_return absl::CancelledError("the client is gone");
    status = response.status;
    headers = std::move(response.headers);
    body = std::move(response.body);
    ended = true;
    co_return absl::OkStatus();
  }
  boost::asio::awaitable<absl::Status> StartBody(int first_status, HttpHeaders first_headers,
                                                 std::optional<uint64_t> length) override {
    status = first_status;
    headers = std::move(first_headers);
    content_length = length;
    co_return gone() ? absl::CancelledError("the client is gone") : absl::OkStatus();
  }
  boost::asio::awaitable<absl::Status> Write(std::string_view bytes) override {
    if (gone()) co_return absl::CancelledError("the client is gone");
    body.append(bytes);
    ++writes;
    if (gone_after_writes == writes) MarkGone();
    co_return absl::OkStatus();
  }
  boost::asio::awaitable<absl::Status> End() override {
    ended = true;
    co_return gone() ? absl::CancelledError("the client is gone") : absl::OkStatus();
  }
  bool answered() const override { return status != 0; }
  using Exchange::MarkGone;

  std::string HeaderOf(std::string_view name) const {
    for (const auto& [key, value] : headers) {
      if (SameHeader(key, name)) return value;
    }
    return "";
  }

  // What was answered.
  int status = 0;
  HttpHeaders headers;
  std::string body;
  std::optional<uint64_t> content_length;
  bool ended = false;
  int writes = 0;
  // The client goes away after that many writes; 0: it stays.
  int gone_after_writes = 0;

 private:
  boost::asio::io_context& context_;
  std::string to_read_;
  const size_t piece_bytes_;
};

// Runs a coroutine to its end and returns what it returns. The context runs here until it has nothing left to do.
template <typename Result>
Result RunToEnd(boost::asio::io_context& context, boost::asio::awaitable<Result> work) {
  auto result = boost::asio::co_spawn(context, std::move(work), boost::asio::use_future);
  context.restart();
  context.run();
  return result.get();
}

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_HTTP_FAKE_EXCHANGE_H_
