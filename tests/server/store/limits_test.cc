// Each limit with a value just outside its range, which is stated in limits.h and by what one message can carry.
#include "server/store/limits.h"

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

TEST(Limits, DefaultsAreValidAndEachFieldHasItsRange) {
  EXPECT_THAT(Limits().Validate(), IsOk());
  for (const Limits& bad :
       {Limits{.max_sequence_bytes = 0}, Limits{.max_files_per_sequence = 0}, Limits{.max_files_per_upload = 10'001},
        Limits{.max_files_per_upload = 0}, Limits{.max_chunk_bytes = 4'000'001}, Limits{.max_queued_jobs = 0},
        Limits{.max_tenant_bytes = -1}, Limits{.max_tenant_queued_jobs = -1}, Limits{.max_tenant_tasks = -1},
        Limits{.max_tenant_uploads = -1}}) {
    EXPECT_THAT(bad.Validate(), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  }
}

TEST(LiveLimits, KeepsWhatItHasWhenTheNewOnesAreWrong) {
  LiveLimits live(Limits{.max_queued_jobs = 7});
  EXPECT_THAT(live.Set(Limits{.max_queued_jobs = 0}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_EQ(live.Get().max_queued_jobs, 7);
  EXPECT_THAT(live.Set(Limits{.max_queued_jobs = 8}), IsOk());
  EXPECT_EQ(live.Get().max_queued_jobs, 8);
}

}  // namespace
}  // namespace depthtween::server
