// What the server tells the service manager that started it, by the protocol of sd_notify(3): datagrams of lines
// NAME=VALUE to a socket that the environment names. systemd speaks it, and so do some runtimes of containers.
//
// Written out here, because it is one system call and libsystemd is much more.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_SERVICE_MANAGER_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_SERVICE_MANAGER_H_

#include <string>
#include <string_view>

#include "absl/time/time.h"

namespace depthtween::server {

// What cannot be sent is logged as a warning: a server that serves is not ended because nobody hears that it does.
// Threads: all methods may be called concurrently.
class ServiceManager {
 public:
  // NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; without the first all methods do nothing.
  static ServiceManager OfEnvironment();

  // `socket`: a path, or "@name" of an abstract socket; empty: there is no manager. `watchdog`: after how long a
  // silence the manager restarts the server; InfiniteDuration: never.
  ServiceManager(std::string socket, absl::Duration watchdog);

  // The server takes work. `status`, in one line, is for `systemctl status`.
  void Ready(std::string_view status) const;
  // The server goes on; to be said every alive_interval().
  void Alive() const;
  // The server ends by itself, at the latest after `patience`; until then nobody need fear that it hangs.
  void Stopping(absl::Duration patience) const;

  // Half of the watchdog's time, so that one late call does no harm; InfiniteDuration without one.
  absl::Duration alive_interval() const { return watchdog_ / 2; }

 private:
  void Send(std::string_view lines) const;

  std::string socket_;
  absl::Duration watchdog_;
};

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_SERVICE_MANAGER_H_
