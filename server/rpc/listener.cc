#include "server/rpc/listener.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "server/access/listen_address.h"
#include "server/telemetry/log.h"

namespace depthtween::server {
namespace {

constexpr int kScarcityPauseMs = 100;
constexpr absl::Duration kConnectionAlarmGap = absl::Minutes(1);

absl::Status CannotListen(const std::string& listen, absl::string_view why) {
  return absl::FailedPreconditionError(absl::StrFormat("cannot listen on %s: %s", listen, why));
}

// A new descriptor gets the lowest number that is free, so it tells how many are taken.
bool HasMoreThan(int reserve, int any_fd) {
  const int lowest = fcntl(any_fd, F_DUPFD_CLOEXEC, 0);
  if (lowest < 0) return false;
  close(lowest);
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return true;
  return static_cast<rlim_t>(lowest) + static_cast<rlim_t>(reserve) < limit.rlim_cur;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Listener>> Listener::Bind(const std::string& listen) {
  std::unique_ptr<Listener> listener(new Listener);
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return ErrnoStatus(errno, "make a pipe");
  for (const int end : ends) listener->over_.emplace_back(end);
  RETURN_IF_ERROR(IsUnixSocket(listen) ? listener->BindSocket(listen) : listener->BindPort(listen));
  return listener;
}

absl::Status Listener::BindSocket(const std::string& listen) {
  const std::string path = listen.substr(listen.find(':') + 1);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(address.sun_path)) {
    return CannotListen(listen, absl::StrCat("a path of 1 to ", sizeof(address.sun_path) - 1, " bytes is needed"));
  }
  std::copy(path.begin(), path.end(), address.sun_path);
  const Descriptor probe(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!probe.valid()) return ErrnoStatus(errno, "make a socket");
  if (connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    return CannotListen(listen, "another server answers there; stop it, or give --listen another address");
  }
  struct stat left {};
  if (lstat(path.c_str(), &left) == 0 && S_ISSOCK(left.st_mode)) unlink(path.c_str());
  RETURN_IF_ERROR(Listen(listen, AF_UNIX, &address, sizeof(address)));
  path_ = path;
  return absl::OkStatus();
}

absl::Status Listener::BindPort(const std::string& listen) {
  ASSIGN_OR_RETURN(const ListenAddress wanted, ParseListenAddress(listen));
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (const int failed = getaddrinfo(wanted.host.c_str(), absl::StrCat(wanted.port).c_str(), &hints, &found);
      failed != 0) {
    return CannotListen(listen, absl::StrCat(gai_strerror(failed), ": HOST is no address of this machine"));
  }
  const absl::Cleanup free_found = [found] { freeaddrinfo(found); };
  port_ = wanted.port;
  absl::Status bound = CannotListen(listen, "HOST has no address");
  // One is enough: a machine may know an address of IPv6 for localhost and have no IPv6.
  for (const addrinfo* address = found; address != nullptr; address = address->ai_next) {
    sockaddr_storage there{};
    std::copy_n(reinterpret_cast<const char*>(address->ai_addr), address->ai_addrlen, reinterpret_cast<char*>(&there));
    // Port 0 of the first is the port of all.
    const auto port = htons(static_cast<uint16_t>(port_));
    if (address->ai_family == AF_INET) reinterpret_cast<sockaddr_in&>(there).sin_port = port;
    if (address->ai_family == AF_INET6) reinterpret_cast<sockaddr_in6&>(there).sin6_port = port;
    const absl::Status listens = Listen(listen, address->ai_family, &there, address->ai_addrlen);
    if (!listens.ok()) {
      if (sockets_.empty()) bound = listens;
      continue;
    }
    bound = absl::OkStatus();
    sockaddr_storage is{};
    socklen_t size = sizeof(is);
    if (getsockname(sockets_.back().get(), reinterpret_cast<sockaddr*>(&is), &size) != 0) {
      return ErrnoStatus(errno, "look at a socket");
    }
    port_ = ntohs(is.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(is).sin6_port
                                           : reinterpret_cast<const sockaddr_in&>(is).sin_port);
  }
  return bound;
}

absl::Status Listener::Listen(const std::string& listen, int family, const void* address, size_t size) {
  sockets_.emplace_back(socket(family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int fd = sockets_.back().get();
  const int on = 1;
  if (fd >= 0 && family != AF_UNIX) {
    // A port that an earlier server has just left; not one that another has.
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));  // connections inherit it
  }
  if (fd >= 0 && bind(fd, static_cast<const sockaddr*>(address), static_cast<socklen_t>(size)) == 0 &&
      ::listen(fd, SOMAXCONN) == 0) {
    return absl::OkStatus();
  }
  const int error = errno;
  sockets_.pop_back();
  const absl::string_view advice =
      error == EADDRINUSE      ? "; is another server running there?"
      : error == EADDRNOTAVAIL ? "; HOST is not an address of this machine (--listen HOST:0 takes any free port)"
      : family == AF_UNIX      ? "; the folder of the socket must be there and writable"
                               : "";
  return CannotListen(listen, absl::StrCat(ErrnoStatus(error, "bind").message(), advice));
}

void Listener::Start(int reserve, std::function<void(int listener, int connection)> on_connection) {
  thread_ = std::thread([this, reserve, call = std::move(on_connection)] { Accept(reserve, call); });
}

void Listener::Accept(int reserve, const std::function<void(int listener, int connection)>& on_connection) const {
  std::vector<pollfd> waits;
  waits.push_back({.fd = over_.front().get(), .events = POLLIN, .revents = 0});
  for (const Descriptor& socket : sockets_) waits.push_back({.fd = socket.get(), .events = POLLIN, .revents = 0});
  absl::Time next_alarm = absl::InfinitePast();
  while (true) {
    // While descriptors are scarce, only for the end, and until it is time to look again.
    const bool room = HasMoreThan(reserve, over_.front().get());
    if (poll(waits.data(), room ? waits.size() : 1, room ? -1 : kScarcityPauseMs) < 0 && errno != EINTR) {
      LogError("cannot wait for connections", {{"error", std::string(ErrnoStatus(errno, "poll").message())}});
      poll(waits.data(), 1, kScarcityPauseMs);
    }
    if (waits.front().revents != 0) return;
    if (!room) {
      if (absl::Now() >= next_alarm) {
        LogError("too many connections: no more are accepted until some end; raise the limit of open files", {});
        next_alarm = absl::Now() + kConnectionAlarmGap;
      }
      continue;
    }
    for (pollfd& wait : waits) {
      if (std::exchange(wait.revents, 0) == 0) continue;
      const int connection = accept4(wait.fd, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (connection >= 0) on_connection(wait.fd, connection);
      // Otherwise it has gone again, or somebody took the last descriptor: the next turn sees to it.
    }
  }
}

Listener::~Listener() {
  if (thread_.joinable()) {
    const char byte = 0;
    while (write(over_.back().get(), &byte, 1) < 0 && errno == EINTR) {
    }
    thread_.join();
  }
  if (!path_.empty()) unlink(path_.c_str());
}

}  // namespace depthtween::server
