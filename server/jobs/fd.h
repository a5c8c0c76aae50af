// A file descriptor with an owner.
#ifndef DEPTHTWEEN_SERVER_JOBS_FD_H_
#define DEPTHTWEEN_SERVER_JOBS_FD_H_

#include <unistd.h>

#include <utility>

namespace depthtween::server {

class Fd {
 public:
  explicit Fd(int fd = -1) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd() { Close(); }
  void Close() {
    if (fd_ >= 0) close(std::exchange(fd_, -1));
  }
  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }

 private:
  int fd_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_JOBS_FD_H_
