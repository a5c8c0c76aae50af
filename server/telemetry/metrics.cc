#include "server/telemetry/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <iterator>

namespace depthtween::server {
namespace {

using prometheus::BuildCounter;
using prometheus::BuildGauge;
using prometheus::BuildHistogram;
using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::Labels;
using Buckets = Histogram::BucketBoundaries;

// Seconds: of calls and transactions, and of work.
const Buckets kShort = {0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 10};
const Buckets kLong = {0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60, 180, 600, 1800, 7200};

struct Registry {
  prometheus::Registry registry;
  Family<Counter>& calls = BuildCounter()
                               .Name("depthtween_calls_total")
                               .Help("Calls answered, by method and status code.")
                               .Register(registry);
  Family<Histogram>& call_seconds = BuildHistogram()
                                        .Name("depthtween_call_seconds")
                                        .Help("From the arrival of a call to its answer; of streams, to their end.")
                                        .Register(registry);
  Family<Counter>& http_requests = BuildCounter()
                                       .Name("depthtween_http_requests_total")
                                       .Help("HTTP requests answered, by method and status.")
                                       .Register(registry);
  Family<Counter>& tasks = BuildCounter()
                               .Name("depthtween_tasks_total")
                               .Help("Attempts at tasks that ended, by kind and outcome.")
                               .Register(registry);
  Family<Histogram>& task_seconds =
      BuildHistogram().Name("depthtween_task_seconds").Help("Wall time of one attempt at a task.").Register(registry);
  Family<Counter>& task_failures = BuildCounter()
                                       .Name("depthtween_task_failures_total")
                                       .Help("Attempts that went wrong, by kind and status code.")
                                       .Register(registry);
  Family<Counter>& frames =
      BuildCounter().Name("depthtween_frames_total").Help("Frames stored, of depth and of renders.").Register(registry);
  Family<Counter>& bytes = BuildCounter()
                               .Name("depthtween_bytes_total")
                               .Help("Bytes of uploads that came in, and of frames and files that went out.")
                               .Register(registry);
  Histogram& queue_wait = BuildHistogram()
                              .Name("depthtween_queue_wait_seconds")
                              .Help("From the creation of a job to its start.")
                              .Register(registry)
                              .Add({}, kLong);
  Histogram& store_write = BuildHistogram()
                               .Name("depthtween_store_write_seconds")
                               .Help("Of one transaction that writes, waiting for its turn included.")
                               .Register(registry)
                               .Add({}, kShort);
  Gauge& workers =
      BuildGauge().Name("depthtween_workers").Help("Tasks that may run at the same time.").Register(registry).Add({});
  Gauge& busy_workers = BuildGauge().Name("depthtween_busy_workers").Help("Tasks that run.").Register(registry).Add({});
  Gauge& free_disk = BuildGauge()
                         .Name("depthtween_free_disk_bytes")
                         .Help("Free space where the data folder lies.")
                         .Register(registry)
                         .Add({});
  Gauge& ready =
      BuildGauge().Name("depthtween_ready").Help("1 while the server takes new work.").Register(registry).Add({});

  Registry() {
    BuildGauge()
        .Name("depthtween_build_info")
        .Help("1, with the version as a label.")
        .Register(registry)
        .Add({{"version", DEPTHTWEEN_VERSION}})
        .Set(1);
  }
};

Registry& OfProcess() {
  static Registry registry;
  return registry;
}

Labels Labelled(std::initializer_list<std::pair<const char*, std::string_view>> pairs) {
  Labels labels;
  for (const auto& [key, value] : pairs) labels[key] = std::string(value);
  return labels;
}

}  // namespace

void CountCall(std::string_view method, std::string_view code, double seconds) {
  OfProcess().calls.Add(Labelled({{"method", method}, {"code", code}})).Increment();
  OfProcess().call_seconds.Add(Labelled({{"method", method}}), kShort).Observe(seconds);
}

void CountHttpRequest(std::string_view method, int status) {
  // Clients choose the word, and every new one would be kept for ever.
  constexpr std::string_view kMethods[] = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"};
  if (std::find(std::begin(kMethods), std::end(kMethods), method) == std::end(kMethods)) method = "other";
  OfProcess().http_requests.Add(Labelled({{"method", method}, {"status", std::to_string(status)}})).Increment();
}

void CountTask(std::string_view kind, std::string_view outcome, double seconds) {
  OfProcess().tasks.Add(Labelled({{"kind", kind}, {"outcome", outcome}})).Increment();
  OfProcess().task_seconds.Add(Labelled({{"kind", kind}}), kLong).Observe(seconds);
}

void CountTaskFailure(std::string_view kind, std::string_view code) {
  OfProcess().task_failures.Add(Labelled({{"kind", kind}, {"code", code}})).Increment();
}

void CountFrames(std::string_view product, int frames) {
  OfProcess().frames.Add(Labelled({{"product", product}})).Increment(frames);
}

void CountBytes(std::string_view direction, int64_t bytes) {
  OfProcess().bytes.Add(Labelled({{"direction", direction}})).Increment(static_cast<double>(bytes));
}

void ObserveQueueWait(double seconds) { OfProcess().queue_wait.Observe(seconds); }

void ObserveStoreWrite(double seconds) { OfProcess().store_write.Observe(seconds); }

std::string MetricsText(const Gauges& gauges) {
  Registry& own = OfProcess();
  own.workers.Set(gauges.workers);
  own.busy_workers.Set(gauges.busy_workers);
  own.free_disk.Set(static_cast<double>(gauges.free_disk_bytes));
  own.ready.Set(gauges.ready ? 1 : 0);
  // A registry of its own: a tenant whose jobs are gone must not keep its last number.
  prometheus::Registry now;
  Family<Gauge>& jobs =
      BuildGauge().Name("depthtween_jobs").Help("Jobs that the server knows, by tenant and state.").Register(now);
  for (const auto& [key, count] : gauges.jobs) {
    jobs.Add(Labelled({{"tenant", key.first}, {"state", key.second}})).Set(count);
  }
  const prometheus::TextSerializer serializer;
  return serializer.Serialize(own.registry.Collect()) + serializer.Serialize(now.Collect());
}

}  // namespace depthtween::server
