// Where a server and its clients on one machine meet when nobody says otherwise.
#ifndef DEPTHTWEEN_PROTO_DEPTHTWEEN_LOCAL_ADDRESS_H_
#define DEPTHTWEEN_PROTO_DEPTHTWEEN_LOCAL_ADDRESS_H_

#include <sys/stat.h>

#include <cstdlib>
#include <string>

namespace depthtween {

inline constexpr char kLocalPort[] = "127.0.0.1:50051";

// Where the session of a person has a folder of its own, which nobody else can enter, a socket in there: every user of
// the machine can reach a port of loopback. Elsewhere, in containers and services, that port.
inline std::string LocalListenAddress() {
  const char* folder = std::getenv("XDG_RUNTIME_DIR");
  struct stat info {};
  if (folder == nullptr || folder[0] != '/' || stat(folder, &info) != 0 || !S_ISDIR(info.st_mode)) return kLocalPort;
  return std::string("unix:") + folder + "/depthtween.sock";
}

// The same for a client: the socket if it is there, else the port.
inline std::string LocalServerAddress() {
  const std::string address = LocalListenAddress();
  struct stat info {};
  constexpr size_t kSchemeLength = 5;  // "unix:"
  const bool there = address != kLocalPort && stat(address.c_str() + kSchemeLength, &info) == 0;
  return there ? address : kLocalPort;
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_PROTO_DEPTHTWEEN_LOCAL_ADDRESS_H_
