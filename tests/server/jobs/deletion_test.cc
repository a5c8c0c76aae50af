// The order of deleting, from the calls that it makes.
#include "server/jobs/deletion.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Records what is called; `forgets` answers one call after another, the last one from then on.
struct Calls {
  std::vector<absl::Status> forgets;
  absl::Status removed;
  std::vector<std::string> made;

  absl::Status Delete() {
    size_t next = 0;
    return DeleteWithFiles(
        "jobs/7",
        [&] {
          made.push_back("forget");
          return forgets[std::min(next++, forgets.size() - 1)];
        },
        [&] {
          made.push_back("remove");
          return removed;
        });
  }
};

// A record that stays keeps its files; without one they go, and that they could not is said.
TEST(DeleteWithFiles, ForgetsFirst) {
  Calls done{.forgets = {absl::OkStatus()}};
  EXPECT_TRUE(done.Delete().ok());
  EXPECT_THAT(done.made, ElementsAre("forget", "remove"));

  Calls refused{.forgets = {absl::FailedPreconditionError("it is running")}};
  EXPECT_EQ(refused.Delete(), absl::FailedPreconditionError("it is running"));
  EXPECT_THAT(refused.made, ElementsAre("forget"));

  Calls stuck{.forgets = {absl::OkStatus()}, .removed = absl::PermissionDeniedError("no")};
  EXPECT_THAT(std::string(stuck.Delete().message()), HasSubstr("jobs/7 is deleted, but its files stay"));
}

// Room for the record comes of removing the files.
TEST(DeleteWithFiles, MakesRoomOnAFullDisk) {
  Calls full{.forgets = {DiskFull("no room"), DiskFull("no room"), absl::OkStatus()}};
  EXPECT_TRUE(full.Delete().ok());
  EXPECT_THAT(full.made, ElementsAre("forget", "remove", "forget", "forget"));

  Calls other{.forgets = {DiskFull("no room"), absl::InternalError("broken")}};
  EXPECT_THAT(std::string(other.Delete().message()), HasSubstr("the files of jobs/7 are gone, but not its record"));
}

}  // namespace
}  // namespace depthtween::server
