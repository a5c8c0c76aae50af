// What the tests of server/store and server/jobs share: folders that vanish, status matchers.
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

namespace depthtween::server {

inline const absl::Status& StatusOf(const absl::Status& status) { return status; }
template <typename T>
const absl::Status& StatusOf(const absl::StatusOr<T>& result) {
  return result.status();
}

MATCHER(IsOk, "is OK") {
  *result_listener << "which is " << StatusOf(arg).ToString();
  return StatusOf(arg).ok();
}

MATCHER_P(HasCode, code, absl::StrCat("has code ", absl::StatusCodeToString(code))) {
  *result_listener << "which is " << StatusOf(arg).ToString();
  return StatusOf(arg).code() == code;
}

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

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "depthtween_test_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::string& path() const { return path_; }
  std::string operator/(std::string_view name) const { return path_ + "/" + std::string(name); }

 private:
  std::string path_;
};

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
