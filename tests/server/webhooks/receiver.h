// A receiver of webhooks on loopback, of plain sockets: it shares no code with what is tested.
#ifndef DEPTHTWEEN_TESTS_SERVER_WEBHOOKS_RECEIVER_H_
#define DEPTHTWEEN_TESTS_SERVER_WEBHOOKS_RECEIVER_H_

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace depthtween::server {

class Receiver {
 public:
  // Answers the first request with the first status line, and so on; the last one stands for all that follow. ""
  // answers nothing until the receiver is gone.
  explicit Receiver(std::vector<std::string> answers) : answers_(std::move(answers)) {
    listener_ = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof(address));
    socklen_t size = sizeof(address);
    getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    listen(listener_, 16);
    thread_ = std::thread([this] { Serve(); });
  }
  ~Receiver() {
    shutdown(listener_, SHUT_RDWR);
    thread_.join();
    close(listener_);
    for (const int held : held_) close(held);
  }
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_) + "/hook?a=b"; }
  int port() const { return port_; }
  // Head and body of each request so far.
  std::vector<std::string> requests() {
    const std::lock_guard lock(mutex_);
    return requests_;
  }
  int connections() const { return connections_; }

 private:
  void Serve() {
    for (int connection = 0; (connection = accept(listener_, nullptr, nullptr)) >= 0;) {
      ++connections_;
      const std::string request = Read(connection);
      std::string answer;
      {
        const std::lock_guard lock(mutex_);
        answer = answers_[std::min(requests_.size(), answers_.size() - 1)];
        requests_.push_back(request);
      }
      if (answer.empty()) {
        held_.push_back(connection);
        continue;
      }
      answer = "HTTP/1.1 " + answer + "\r\nContent-Length: 0\r\n\r\n";
      [[maybe_unused]] const ssize_t sent = write(connection, answer.data(), answer.size());
      close(connection);
    }
  }
  static std::string Read(int connection) {
    std::string text;
    std::array<char, 4096> piece{};
    for (ssize_t got = 0; (got = read(connection, piece.data(), piece.size())) > 0;) {
      text.append(piece.data(), static_cast<size_t>(got));
      const size_t head = text.find("\r\n\r\n"), length = text.find("Content-Length: ");
      if (head == std::string::npos || length == std::string::npos) continue;
      if (text.size() >= head + 4 + std::stoul(text.substr(length + 16))) break;
    }
    return text;
  }

  std::vector<std::string> answers_;
  int listener_ = -1, port_ = 0;
  std::atomic<int> connections_{0};
  std::mutex mutex_;
  std::vector<std::string> requests_;  // guarded by mutex_
  std::vector<int> held_;              // of the thread, then of the destructor
  std::thread thread_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_WEBHOOKS_RECEIVER_H_
