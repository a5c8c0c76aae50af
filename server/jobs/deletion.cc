#include "server/jobs/deletion.h"

#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

constexpr int kRoomTries = 50;
constexpr absl::Duration kRoomGap = absl::Milliseconds(50);

bool IsDiskFull(const absl::Status& status) {
  const std::optional<ErrorInfo> info = GetErrorInfo(status);
  return info && info->reason == "DISK_FULL";
}

}  // namespace

absl::Status DeleteWithFiles(std::string_view name, const std::function<absl::Status()>& forget,
                             const std::function<absl::Status()>& remove) {
  const std::string named(name);
  absl::Status forgotten = forget();
  if (!IsDiskFull(forgotten)) {
    RETURN_IF_ERROR(std::move(forgotten));
    return WithContext(remove(), absl::StrCat(named, " is deleted, but its files stay until the server restarts"));
  }
  RETURN_IF_ERROR(remove());
  // Their disk space is freed in the background.
  for (int i = 0; i < kRoomTries && IsDiskFull(forgotten); ++i) {
    absl::SleepFor(kRoomGap);
    forgotten = forget();
  }
  return WithContext(forgotten, absl::StrCat("the files of ", named, " are gone, but not its record: delete it again"));
}

}  // namespace depthtween::server
