// A client that sends exactly the bytes it is told, and reads answers as RFC 9112 has them.
#ifndef DEPTHTWEEN_TESTS_SERVER_HTTP_RAW_CLIENT_H_
#define DEPTHTWEEN_TESTS_SERVER_HTTP_RAW_CLIENT_H_

#include <optional>
#include <string>
#include <string_view>

#include "server/http/exchange.h"

namespace depthtween::server {

struct RawAnswer {
  int status = 0;  // 0: the connection ended before an answer was whole
  HttpHeaders headers;
  std::string body;

  std::string Header(std::string_view name) const;
};

class RawClient {
 public:
  // To 127.0.0.1. Reads give up after 60 s.
  explicit RawClient(int port);
  ~RawClient();
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  // false: the server has closed the connection before it took all.
  bool Send(std::string_view bytes) const;
  // "GET <target> HTTP/1.1" with Host, and more header lines that end in CR LF.
  bool Get(std::string_view target, std::string_view more_headers = "") const;
  bool Post(std::string_view target, std::string_view body, std::string_view more_headers = "") const;
  // The next answer on this connection. `to_head`: of a HEAD request, which has no body.
  RawAnswer ReadAnswer(bool to_head = false);
  // The next line without its end, of a body that is still being made; nullopt at the end of the connection.
  std::optional<std::string> ReadLine();
  // All bytes until the server closes.
  std::string ReadToEnd();
  // No more will be sent; the connection stays open for reading.
  void FinishSending() const;

 private:
  bool Fill();
  std::string Take(size_t count);

  int socket_ = -1;
  std::string buffer_;
};

// One request on a connection of its own.
RawAnswer GetOnce(int port, std::string_view target, std::string_view more_headers = "");
RawAnswer PostOnce(int port, std::string_view target, std::string_view body, std::string_view more_headers = "");

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_HTTP_RAW_CLIENT_H_
