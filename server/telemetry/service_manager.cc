#include "server/telemetry/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

std::string_view EnvironmentValue(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

// 0, or the errno that says why `lines` did not get there.
int SendDatagram(std::string_view socket_name, std::string_view lines) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket_name.size() >= sizeof(address.sun_path)) return ENAMETOOLONG;
  std::memcpy(address.sun_path, socket_name.data(), socket_name.size());
  if (socket_name.front() == '@') address.sun_path[0] = '\0';  // abstract: the name is what follows, without an end
  const socklen_t length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_name.size());
  const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return errno;
  const ssize_t sent = sendto(fd, lines.data(), lines.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&address),
                              length);  // a datagram goes whole or not at all
  const int error = sent < 0 ? errno : 0;
  close(fd);
  return error;
}

}  // namespace

ServiceManager ServiceManager::OfEnvironment() {
  int64_t watchdog_us = 0;
  const std::string_view pid = EnvironmentValue("WATCHDOG_PID");
  // Inherited by a child of the process that is watched, the variables are not for it.
  const bool ours = pid.empty() || pid == absl::StrCat(getpid());
  if (!ours || !absl::SimpleAtoi(std::string(EnvironmentValue("WATCHDOG_USEC")), &watchdog_us) || watchdog_us <= 0)
    watchdog_us = 0;
  return {std::string(EnvironmentValue("NOTIFY_SOCKET")),
          watchdog_us == 0 ? absl::InfiniteDuration() : absl::Microseconds(watchdog_us)};
}

ServiceManager::ServiceManager(std::string socket, absl::Duration watchdog)
    : socket_(std::move(socket)), watchdog_(socket_.empty() ? absl::InfiniteDuration() : watchdog) {}

void ServiceManager::Ready(std::string_view status) const {
  std::string line(status);
  std::replace(line.begin(), line.end(), '\n', ' ');  // what follows would be another value
  Send(absl::StrCat("READY=1\nSTATUS=", line));
}

void ServiceManager::Alive() const { Send("WATCHDOG=1"); }

void ServiceManager::Stopping(absl::Duration patience) const {
  const int64_t us = absl::ToInt64Microseconds(patience);
  std::string lines = absl::StrCat("STOPPING=1\nSTATUS=stopping\nEXTEND_TIMEOUT_USEC=", us);
  if (watchdog_ < patience) absl::StrAppend(&lines, "\nWATCHDOG_USEC=", us, "\nWATCHDOG=1");
  Send(lines);
}

void ServiceManager::Send(std::string_view lines) const {
  if (socket_.empty()) return;
  if (const int error = SendDatagram(socket_, lines); error != 0) {
    LogWarning("the service manager cannot be told", {{"socket", socket_}, {"error", std::strerror(error)}});
  }
}

}  // namespace depthtween::server
