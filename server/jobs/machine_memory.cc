#include "server/jobs/machine_memory.h"

#include <algorithm>
#include <fstream>
#include <limits>
#include <string_view>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace depthtween::server {
namespace {

constexpr int64_t kUnlimitedMemory = std::numeric_limits<int64_t>::max();
constexpr int64_t kLeastTaskMemory = int64_t{1} << 30;

// Of "MemTotal:  16303428 kB".
int64_t InstalledMemory(const std::string& root) {
  std::ifstream file(root + "/proc/meminfo");
  for (std::string name, unit; file >> name;) {
    int64_t value = 0;
    if (name == "MemTotal:" && file >> value) return value << 10;
    std::getline(file, unit);
  }
  return kUnlimitedMemory;
}

// The number in a control group's file; version 2 writes "max" for none, version 1 nearly 2^63.
int64_t LimitIn(const std::string& path) {
  std::string word;
  int64_t bytes = 0;
  std::ifstream(path) >> word;
  return absl::SimpleAtoi(word, &bytes) && bytes > 0 ? bytes : kUnlimitedMemory;
}

// The least limit of a group and all above it. Inside a container the group's path may be one outside; then the mount
// itself, where the walk ends, is the group.
int64_t LimitOfGroup(const std::string& mount, std::string path, const std::string& file) {
  int64_t least = kUnlimitedMemory;
  while (true) {
    least = std::min(least, LimitIn(absl::StrCat(mount, path, "/", file)));
    if (path.empty() || path == "/") return least;
    path.resize(path.rfind('/') == std::string::npos ? 0 : path.rfind('/'));
  }
}

}  // namespace

int64_t UsableMemoryBytes(const std::string& root) {
  int64_t least = InstalledMemory(root);
  std::ifstream groups(root + "/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::vector<std::string> fields = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (fields.size() != 3) continue;
    const std::vector<std::string> controllers = absl::StrSplit(fields[1], ',');
    if (fields[1].empty()) {
      least = std::min(least, LimitOfGroup(root + "/sys/fs/cgroup", fields[2], "memory.max"));
    } else if (std::find(controllers.begin(), controllers.end(), "memory") != controllers.end()) {
      least = std::min(least, LimitOfGroup(root + "/sys/fs/cgroup/memory", fields[2], "memory.limit_in_bytes"));
    }
  }
  return least == kUnlimitedMemory ? 0 : least;
}

int64_t TaskMemoryBytes(int64_t usable_bytes, int workers) {
  if (usable_bytes <= 0) return 0;
  return std::max(kLeastTaskMemory, usable_bytes / 10 * 8 / workers);
}

}  // namespace depthtween::server
