// Made-up /proc and /sys trees, in the form of proc(5) and cgroups(7).
#include "server/jobs/machine_memory.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/support/temporary_folder.h"

namespace depthtween::server {
namespace {

constexpr int64_t kMiB = 1 << 20, kGiB = 1 << 30;

class MachineMemoryTest : public testing::Test {
 protected:
  MachineMemoryTest() { Write("/proc/meminfo", "MemFree:  1024 kB\nMemTotal:       16777216 kB\nSwapTotal: 0 kB\n"); }
  void Write(const std::string& path, const std::string& text) {
    const std::filesystem::path file = root_.path() + path;
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file) << text;
  }
  int64_t Usable() { return UsableMemoryBytes(root_.path()); }
  TemporaryFolder root_;
};

TEST_F(MachineMemoryTest, IsWhatIsInstalled) {
  EXPECT_EQ(Usable(), 16 * kGiB);
  Write("/proc/self/cgroup", "0::/system.slice/depthtween.service\n");
  Write("/sys/fs/cgroup/system.slice/depthtween.service/memory.max", "max\n");
  EXPECT_EQ(Usable(), 16 * kGiB);
}

TEST_F(MachineMemoryTest, OrTheLeastLimitOfTheGroupsAroundIt) {
  Write("/proc/self/cgroup", "0::/system.slice/depthtween.service\n");
  Write("/sys/fs/cgroup/system.slice/depthtween.service/memory.max", "4294967296\n");
  EXPECT_EQ(Usable(), 4 * kGiB);
  Write("/sys/fs/cgroup/system.slice/memory.max", "3221225472\n");
  EXPECT_EQ(Usable(), 3 * kGiB);
}

// Its path is one of the host, and what is mounted is its own group.
TEST_F(MachineMemoryTest, InAContainerTheMountIsTheGroup) {
  Write("/proc/self/cgroup", "0::/../../machine/one\n");
  Write("/sys/fs/cgroup/memory.max", "2147483648\n");
  EXPECT_EQ(Usable(), 2 * kGiB);
}

TEST_F(MachineMemoryTest, FirstVersionOfControlGroups) {
  Write("/proc/self/cgroup", "11:cpu,cpuacct:/a\n4:memory:/a/b\n0::/\n");
  Write("/sys/fs/cgroup/memory/a/b/memory.limit_in_bytes", "9223372036854771712\n");
  EXPECT_EQ(Usable(), 16 * kGiB);
  Write("/sys/fs/cgroup/memory/a/memory.limit_in_bytes", "1073741824\n");
  EXPECT_EQ(Usable(), kGiB);
}

TEST_F(MachineMemoryTest, WorkersShareIt) {
  EXPECT_NEAR(TaskMemoryBytes(16 * kGiB, 4), 3.2 * kGiB, kMiB);
  EXPECT_EQ(TaskMemoryBytes(2 * kGiB, 8), kGiB) << "less starts no task of ordinary size";
  EXPECT_EQ(TaskMemoryBytes(0, 8), 0) << "not known: no limit";
}

TEST(MachineMemory, OfThisMachineIsKnown) { EXPECT_GT(UsableMemoryBytes(), 0); }

}  // namespace
}  // namespace depthtween::server
