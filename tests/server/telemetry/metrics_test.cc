// The registry is the process's, so that a test counts what it adds to what it finds. The lines are Prometheus' text
// format, written down by hand.
#include "server/telemetry/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Metrics, EveryKindHasItsLine) {
  CountCall("MetricsTest", "OK", 0.004);
  CountCall("MetricsTest", "NOT_FOUND", 3);
  CountHttpRequest("GET", 299);
  CountHttpRequest("BREW", 299);
  CountTask("test-kind", "done", 0.2);
  CountTaskFailure("test-kind", "INTERNAL");
  CountFrames("test-product", 7);
  CountBytes("test-direction", 5'000'000'000);
  const std::string text = MetricsText({.workers = 3, .busy_workers = 2, .free_disk_bytes = 1024, .ready = true});
  for (const char* line : {"depthtween_calls_total{code=\"OK\",method=\"MetricsTest\"} 1\n",
                           "depthtween_calls_total{code=\"NOT_FOUND\",method=\"MetricsTest\"} 1\n",
                           "depthtween_call_seconds_count{method=\"MetricsTest\"} 2\n",
                           "depthtween_call_seconds_bucket{method=\"MetricsTest\",le=\"0.005\"} 1\n",
                           "depthtween_http_requests_total{method=\"GET\",status=\"299\"} 1\n",
                           "depthtween_http_requests_total{method=\"other\",status=\"299\"} 1\n",
                           "depthtween_tasks_total{kind=\"test-kind\",outcome=\"done\"} 1\n",
                           "depthtween_task_seconds_bucket{kind=\"test-kind\",le=\"0.25\"} 1\n",
                           "depthtween_task_failures_total{code=\"INTERNAL\",kind=\"test-kind\"} 1\n",
                           "depthtween_frames_total{product=\"test-product\"} 7\n",
                           "depthtween_bytes_total{direction=\"test-direction\"} 5000000000\n",
                           "depthtween_workers 3\n", "depthtween_busy_workers 2\n", "depthtween_free_disk_bytes 1024\n",
                           "depthtween_ready 1\n", "depthtween_build_info{version=\"" DEPTHTWEEN_VERSION "\"} 1\n"}) {
    EXPECT_THAT(text, HasSubstr(line));
  }
}

TEST(Metrics, ATenantWithoutJobsHasNoLine) {
  EXPECT_THAT(MetricsText({.jobs = {{{"studio", "RUNNING"}, 4}}}),
              HasSubstr("depthtween_jobs{state=\"RUNNING\",tenant=\"studio\"} 4\n"));
  EXPECT_THAT(MetricsText({}), Not(HasSubstr("studio")));
}

}  // namespace
}  // namespace depthtween::server
