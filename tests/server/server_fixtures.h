// What the tests of server/store and server/jobs share: reasons of errors, a small disk, files.
#ifndef DEPTHTWEEN_TESTS_SERVER_SERVER_FIXTURES_H_
#define DEPTHTWEEN_TESTS_SERVER_SERVER_FIXTURES_H_

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>

#include "core/base/status.h"
#include "server/store/error_info.h"
#include "server/store/tenant.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::server {

// Whose the sequences and jobs of a test are.
inline const Tenant kTenant(kDefaultTenant);

// A status with this code and this reason of error_info.h.
MATCHER_P2(HasReason, code, reason, absl::StrCat("has code ", absl::StatusCodeToString(code), " and reason ", reason)) {
  const absl::Status& status = StatusOf(arg);
  const auto info = GetErrorInfo(status);
  *result_listener << "which is " << status.ToString();
  return status.code() == code && info && info->reason == reason;
}

// The value of an OK StatusOr; the test ends otherwise.
template <typename T>
T Take(absl::StatusOr<T> result) {
  if (!result.ok()) {
    ADD_FAILURE() << result.status();
    std::abort();
  }
  return *std::move(result);
}

// A file system of its own, in memory, that is soon full; unmounted at the end. Where it cannot be mounted the test
// fails rather than passes over what it was to show:  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
inline constexpr char kNeedsMount[] = "cannot mount a tmpfs: run as root, in a container with --cap-add SYS_ADMIN";
class SmallDisk {
 public:
  explicit SmallDisk(const std::string& size)
      : mounted_(mount("tmpfs", folder_.path().c_str(), "tmpfs", 0, ("size=" + size).c_str()) == 0) {}
  ~SmallDisk() {
    if (mounted_) umount2(folder_.path().c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  bool mounted() const { return mounted_; }
  const std::string& path() const { return folder_.path(); }

 private:
  TemporaryFolder folder_;
  bool mounted_;
};

inline std::string ReadText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream content;
  content << file.rdbuf();
  return content.str();
}

inline void WriteText(const std::string& path, std::string_view text) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_TESTS_SERVER_SERVER_FIXTURES_H_
