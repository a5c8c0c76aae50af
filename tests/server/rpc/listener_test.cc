// Connections over real sockets. How many descriptors are free is known because the test sets the limit.
#include "server/rpc/listener.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <atomic>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

// A connection to a port of loopback; the kernel makes it before anybody accepts it.
int Connect(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  EXPECT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  return fd;
}

void WaitUntilEqual(const std::atomic<int>& count, int wanted) {
  while (count != wanted) usleep(1000);
}

TEST(Listener, HandsOverConnections) {
  const auto listener = Take(Listener::Bind("localhost:0"));
  ASSERT_GT(listener->port(), 0);
  std::atomic<int> accepted = 0;
  listener->Start(0, [&accepted](int /*listener*/, int connection) {
    close(connection);
    ++accepted;
  });
  for (int i = 1; i <= 3; ++i) {
    close(Connect(listener->port()));
    WaitUntilEqual(accepted, i);
  }
}

TEST(Listener, SaysWhyItCannotListen) {
  const auto first = Take(Listener::Bind("127.0.0.1:0"));
  EXPECT_THAT(Listener::Bind("127.0.0.1:" + std::to_string(first->port())),
              HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Listener::Bind("192.0.2.1:0"), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Listener::Bind("no.such.host.invalid:1"), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Listener::Bind("unix:/no/such/folder/socket"), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Listener::Bind("unix:/" + std::string(200, 'x')), HasCode(absl::StatusCode::kFailedPrecondition));
}

TEST(Listener, RemovesItsSocketAndTakesNobodyElses) {
  const TemporaryFolder folder;
  const std::string path = folder / "socket";
  struct stat info {};
  {
    const auto listener = Take(Listener::Bind("unix:" + path));
    EXPECT_EQ(listener->port(), 0);
    EXPECT_EQ(stat(path.c_str(), &info), 0);
    EXPECT_THAT(Listener::Bind("unix:" + path), HasCode(absl::StatusCode::kFailedPrecondition));
    EXPECT_EQ(stat(path.c_str(), &info), 0);
  }
  EXPECT_NE(stat(path.c_str(), &info), 0);
  WriteText(path, "somebody's file");
  EXPECT_THAT(Listener::Bind("unix:" + path), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(ReadText(path), "somebody's file");
}

// With as few descriptors as the reserve asks for none is accepted; the limit is raised, and all are.
TEST(Listener, LeavesDescriptorsToOthersAndGoesOnWhenThereAreSome) {
  const auto listener = Take(Listener::Bind("127.0.0.1:0"));
  std::vector<int> clients;
  for (int i = 0; i < 5; ++i) clients.push_back(Connect(listener->port()));
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  constexpr int kReserve = 20;
  const rlimit scarce{static_cast<rlim_t>(clients.back() + kReserve), before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &scarce), 0);
  std::atomic<int> accepted = 0;
  listener->Start(kReserve, [&accepted](int /*listener*/, int connection) {
    close(connection);
    ++accepted;
  });
  usleep(300'000);  // three looks
  EXPECT_EQ(accepted, 0);
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  WaitUntilEqual(accepted, 5);
  for (const int client : clients) close(client);
}

}  // namespace
}  // namespace depthtween::server
