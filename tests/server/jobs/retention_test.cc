// What the rules of retention choose from lists of jobs and recordings of known ages and sizes, worked out by hand.
#include "server/jobs/retention.h"

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

const absl::Time kNow = absl::FromUnixSeconds(1'800'000'000);
constexpr int64_t kBytes = 10;  // of everything

Collectable Job(const std::string& id, int days, JobState state = JobState::kSucceeded) {
  return {.id = id, .job_state = state, .since = kNow - absl::Hours(24) * days};
}
Collectable Sequence(const std::string& id, int days) { return {.id = id, .since = kNow - absl::Hours(24) * days}; }

std::vector<std::string> Chosen(const RetentionRules& rules, int64_t free_bytes, const std::vector<Collectable>& jobs,
                                const std::vector<Collectable>& sequences) {
  std::vector<std::string> chosen;
  for (const CollectOrder& order :
       ChooseGarbage(rules, kNow, free_bytes, jobs, sequences, [](const Collectable&, bool) { return kBytes; })) {
    EXPECT_EQ(order.bytes, kBytes);
    chosen.push_back(absl::StrCat(order.what.id, " ", std::string(ToString(order.reason))));
  }
  return chosen;
}

TEST(Retention, WithoutRulesNothingGoes) {
  EXPECT_THAT(Chosen({}, 0, {Job("a", 10'000)}, {Sequence("s", 10'000)}), IsEmpty());
  EXPECT_EQ(ExpireTime({}, {.state = JobState::kSucceeded, .end_time = kNow}), absl::InfiniteFuture());
}

TEST(Retention, EachStateHasATimeOfItsOwn) {
  const RetentionRules rules = {.keep_succeeded = absl::Hours(24 * 30),
                                .keep_failed = absl::Hours(24 * 7),
                                .keep_cancelled = absl::ZeroDuration(),
                                .keep_sequences = absl::Hours(24 * 60)};
  EXPECT_THAT(Chosen(rules, 0,
                     {Job("old cancelled", 400, JobState::kCancelled), Job("old", 30), Job("young", 29),
                      Job("old failed", 8, JobState::kFailed), Job("young failed", 6, JobState::kFailed)},
                     {Sequence("old recording", 61), Sequence("young recording", 59)}),
              ElementsAre("old expired", "old failed expired", "old recording expired"));
  const JobRecord failed = {.state = JobState::kFailed, .end_time = kNow};
  EXPECT_EQ(ExpireTime(rules, failed), kNow + absl::Hours(24 * 7));
  JobRecord pinned = failed;
  pinned.pinned = true;
  EXPECT_EQ(ExpireTime(rules, pinned), absl::InfiniteFuture());
  EXPECT_EQ(ExpireTime(rules, {.state = JobState::kRunning, .end_time = absl::InfiniteFuture()}),
            absl::InfiniteFuture());
}

// 95 bytes are free and 100 are the mark: 105 come of the first, 115 of the second, which is enough for 110.
TEST(Retention, ANearlyFullDiskTakesTheOldestUntilThereIsRoom) {
  const RetentionRules rules = {.collect_below_bytes = 100, .collect_until_bytes = 110};
  const std::vector<Collectable> jobs = {Job("j9", 9), Job("j5", 5), Job("j0", 0)};
  const std::vector<Collectable> sequences = {Sequence("s7", 7), Sequence("s4", 4)};
  EXPECT_THAT(Chosen(rules, 95, jobs, sequences), ElementsAre("j9 disk pressure", "s7 disk pressure"));
  EXPECT_THAT(Chosen(rules, 100, jobs, sequences), IsEmpty());
  EXPECT_THAT(Chosen(rules, 0, jobs, sequences),
              ElementsAre("j9 disk pressure", "s7 disk pressure", "j5 disk pressure", "s4 disk pressure"))
      << "what ended within the hour stays";
  // What expires makes room too.
  RetentionRules both = rules;
  both.keep_succeeded = absl::Hours(24 * 8);
  EXPECT_THAT(Chosen(both, 95, jobs, sequences), ElementsAre("j9 expired"));
}

TEST(Retention, RulesAreChecked) {
  EXPECT_THAT(RetentionRules().Validate(), IsOk());
  EXPECT_THAT(RetentionRules{.keep_failed = -absl::Hours(1)}.Validate(), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT((RetentionRules{.collect_below_bytes = 2, .collect_until_bytes = 1}).Validate(),
              HasCode(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace depthtween::server
