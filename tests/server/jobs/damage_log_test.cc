// What was logged is read from standard error, where the log goes.
#include "server/jobs/damage_log.h"

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

TEST(DamageLog, SaysItOnceOfEachFile) {
  DamageLog log;
  testing::internal::CaptureStderr();
  log.Report("jobs/7/out/report.json", "it is missing");
  log.Report("jobs/7/out/report.json", "it is missing");
  log.Report("sequences/3/rgb/0.png", "it is missing");
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 2) << said;
  EXPECT_THAT(said, testing::HasSubstr("jobs/7/out/report.json"));
  EXPECT_EQ(log.files(), 2);
}

}  // namespace
}  // namespace depthtween::server
