// The lines that sd_notify(3) fixes, read from sockets that the test has opened as a service manager does.
#include "server/telemetry/service_manager.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "absl/strings/str_cat.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

// A socket that keeps what is sent to it: a datagram is there as soon as it was sent.
class Manager {
 public:
  explicit Manager(const std::string& name) : fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    bound_ = bind(fd_, reinterpret_cast<const sockaddr*>(&address),
                  static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size())) == 0;
  }
  ~Manager() { close(fd_); }
  Manager(const Manager&) = delete;
  Manager& operator=(const Manager&) = delete;

  bool bound() const { return bound_; }
  // nullopt when nothing has come.
  std::optional<std::string> Next() const {
    std::array<char, 4096> bytes{};
    const ssize_t count = recv(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (count < 0) return std::nullopt;
    return std::string(bytes.data(), static_cast<size_t>(count));
  }

 private:
  int fd_;
  bool bound_ = false;
};

class ServiceManagerTest : public testing::Test {
 protected:
  ServiceManagerTest() : folder_(testing::TempDir() + absl::StrCat("service_manager_", getpid())) {
    std::filesystem::create_directories(folder_);
  }
  ~ServiceManagerTest() override {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) unsetenv(name);
    std::filesystem::remove_all(folder_);
  }

  static ServiceManager With(const std::map<std::string, std::string>& environment) {
    for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
    return ServiceManager::OfEnvironment();
  }

  std::string folder_;
};

TEST_F(ServiceManagerTest, SaysWhatTheServerDoes) {
  const std::string name = folder_ + "/notify";
  const Manager manager(name);
  ASSERT_TRUE(manager.bound());
  const ServiceManager ours = With({{"NOTIFY_SOCKET", name}, {"WATCHDOG_USEC", "30000000"}});
  EXPECT_EQ(ours.alive_interval(), absl::Seconds(15));
  ours.Ready("on 127.0.0.1:50051\nREADY=0");
  EXPECT_EQ(manager.Next(), "READY=1\nSTATUS=on 127.0.0.1:50051 READY=0");
  ours.Alive();
  EXPECT_EQ(manager.Next(), "WATCHDOG=1");
  ours.Stopping(absl::Seconds(20));
  EXPECT_EQ(manager.Next(), "STOPPING=1\nSTATUS=stopping\nEXTEND_TIMEOUT_USEC=20000000");
  EXPECT_EQ(manager.Next(), std::nullopt);
}

// A long drain must look neither like a hang nor like a stop that is overdue.
TEST_F(ServiceManagerTest, ALongStopMovesTheWatchdog) {
  const std::string name = folder_ + "/notify";
  const Manager manager(name);
  ServiceManager(name, absl::Seconds(30)).Stopping(absl::Minutes(5));
  EXPECT_THAT(manager.Next().value_or(""),
              testing::AllOf(HasSubstr("EXTEND_TIMEOUT_USEC=300000000"), HasSubstr("WATCHDOG_USEC=300000000")));
}

TEST_F(ServiceManagerTest, TheSocketMayBeAbstract) {
  const std::string name = absl::StrCat("@depthtween_test_", getpid());
  const Manager manager(name);
  ASSERT_TRUE(manager.bound());
  With({{"NOTIFY_SOCKET", name}}).Alive();
  EXPECT_EQ(manager.Next(), "WATCHDOG=1");
}

TEST_F(ServiceManagerTest, WithoutAManagerNothingIsSaid) {
  const ServiceManager ours = With({{"WATCHDOG_USEC", "30000000"}});
  EXPECT_EQ(ours.alive_interval(), absl::InfiniteDuration());
  testing::internal::CaptureStderr();
  ours.Ready("");
  ours.Alive();
  ours.Stopping(absl::Seconds(1));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(ServiceManagerTest, AWatchdogOfAnotherProcessOrWithoutSenseIsNone) {
  const std::string name = folder_ + "/notify";
  for (const char* time : {"", "0", "-5", "soon"}) {
    EXPECT_EQ(With({{"NOTIFY_SOCKET", name}, {"WATCHDOG_USEC", time}}).alive_interval(), absl::InfiniteDuration())
        << time;
  }
  EXPECT_EQ(With({{"WATCHDOG_USEC", "2000000"}, {"WATCHDOG_PID", "1"}}).alive_interval(), absl::InfiniteDuration());
  EXPECT_EQ(With({{"WATCHDOG_PID", absl::StrCat(getpid())}}).alive_interval(), absl::Seconds(1));
}

TEST_F(ServiceManagerTest, AManagerThatIsGoneIsLogged) {
  for (const std::string& name : {folder_ + "/none", folder_ + "/" + std::string(200, 'x')}) {
    testing::internal::CaptureStderr();
    ServiceManager(name, absl::Seconds(1)).Alive();
    EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("the service manager cannot be told"));
  }
}

}  // namespace
}  // namespace depthtween::server
