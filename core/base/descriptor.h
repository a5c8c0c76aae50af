// The owner of a file descriptor, which is closed at the end.
#ifndef DEPTHTWEEN_CORE_BASE_DESCRIPTOR_H_
#define DEPTHTWEEN_CORE_BASE_DESCRIPTOR_H_

#include <unistd.h>

#include <utility>

namespace depthtween {

class Descriptor {
 public:
  // What open() and its like return; negative: there is none.
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }
  // Closes it now. Some file systems report a failed write only here; false leaves errno.
  bool Close() { return ::close(std::exchange(fd_, -1)) == 0; }

 private:
  int fd_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_DESCRIPTOR_H_
