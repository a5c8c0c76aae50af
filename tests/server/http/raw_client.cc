#include "tests/server/http/raw_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "absl/strings/str_cat.h"

namespace depthtween::server {

std::string RawAnswer::Header(std::string_view name) const {
  for (const auto& [key, value] : headers) {
    if (SameHeader(key, name)) return value;
  }
  return "";
}

RawClient::RawClient(int port) : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  timeval limit{.tv_sec = 60, .tv_usec = 0};
  setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit));
  // A connection that fails shows as an answer without a status.
  (void)connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
}

RawClient::~RawClient() { close(socket_); }

bool RawClient::Send(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t count = send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (count <= 0) return false;
    bytes.remove_prefix(static_cast<size_t>(count));
  }
  return true;
}

bool RawClient::Get(std::string_view target, std::string_view more_headers) const {
  return Send(
      absl::StrCat("GET ", std::string(target), " HTTP/1.1\r\nHost: test\r\n", std::string(more_headers), "\r\n"));
}

bool RawClient::Post(std::string_view target, std::string_view body, std::string_view more_headers) const {
  return Send(absl::StrCat("POST ", std::string(target), " HTTP/1.1\r\nHost: test\r\nContent-Length: ", body.size(),
                           "\r\n", std::string(more_headers), "\r\n", std::string(body)));
}

void RawClient::FinishSending() const { shutdown(socket_, SHUT_WR); }

bool RawClient::Fill() {
  std::string piece(65536, '\0');
  const ssize_t count = recv(socket_, piece.data(), piece.size(), 0);
  if (count <= 0) return false;
  buffer_.append(piece, 0, static_cast<size_t>(count));
  return true;
}

std::string RawClient::Take(size_t count) {
  while (buffer_.size() < count && Fill()) {
  }
  std::string result = buffer_.substr(0, count);
  buffer_.erase(0, count);
  return result;
}

std::optional<std::string> RawClient::ReadLine() {
  size_t end = 0;
  while ((end = buffer_.find('\n')) == std::string::npos) {
    if (!Fill()) return std::nullopt;
  }
  std::string line = Take(end + 1);
  line.pop_back();
  if (!line.empty() && line.back() == '\r') line.pop_back();
  return line;
}

RawAnswer RawClient::ReadAnswer(bool to_head) {
  RawAnswer answer;
  const std::optional<std::string> first = ReadLine();
  if (!first || first->size() < 12) return answer;
  const int status = std::atoi(first->c_str() + 9);
  while (true) {
    const std::optional<std::string> line = ReadLine();
    if (!line) return answer;
    if (line->empty()) break;
    const size_t colon = std::min(line->find(": "), line->size());
    answer.headers.emplace_back(line->substr(0, colon), line->substr(std::min(colon + 2, line->size())));
  }
  if (status == 100) return ReadAnswer(to_head);
  const std::string length = answer.Header("Content-Length");
  if (to_head || status == 204 || status == 304) {
  } else if (!length.empty()) {
    const size_t count = std::strtoull(length.c_str(), nullptr, 10);
    answer.body = Take(count);
    if (answer.body.size() < count) return answer;
  } else if (answer.Header("Transfer-Encoding") == "chunked") {
    while (true) {
      const std::optional<std::string> size = ReadLine();
      if (!size) return answer;
      const size_t count = std::strtoull(size->c_str(), nullptr, 16);
      const std::string chunk = Take(count);
      if (chunk.size() < count || !ReadLine()) return answer;
      if (count == 0) break;
      answer.body += chunk;
    }
  } else {
    answer.body = ReadToEnd();
  }
  answer.status = status;
  return answer;
}

std::string RawClient::ReadToEnd() {
  while (Fill()) {
  }
  return Take(buffer_.size());
}

RawAnswer GetOnce(int port, std::string_view target, std::string_view more_headers) {
  RawClient client(port);
  client.Get(target, more_headers);
  return client.ReadAnswer();
}

RawAnswer PostOnce(int port, std::string_view target, std::string_view body, std::string_view more_headers) {
  RawClient client(port);
  client.Post(target, body, more_headers);
  return client.ReadAnswer();
}

}  // namespace depthtween::server
