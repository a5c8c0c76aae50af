// What the server counts and measures, in the form that Prometheus reads.
//
// One registry for the process, as there is one log. Names follow Prometheus: unit last, counters end in _total. Labels
// have few values: methods, codes, kinds of task, tenants; never ids. deploy/grafana and deploy/prometheus name these
// metrics, and a test compares them.
// Threads: all functions may be called concurrently.
#ifndef DEPTHTWEEN_SERVER_TELEMETRY_METRICS_H_
#define DEPTHTWEEN_SERVER_TELEMETRY_METRICS_H_

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>

namespace depthtween::server {

// depthtween_calls_total{method,code}, depthtween_call_seconds{method}
void CountCall(std::string_view method, std::string_view code, double seconds);
// depthtween_http_requests_total{method,status}
void CountHttpRequest(std::string_view method, int status);
// depthtween_tasks_total{kind,outcome}, depthtween_task_seconds{kind}; `outcome`: "done", "failed", "stopped"
void CountTask(std::string_view kind, std::string_view outcome, double seconds);
// depthtween_task_failures_total{kind,code}: attempts that went wrong, tried again or not
void CountTaskFailure(std::string_view kind, std::string_view code);
// depthtween_frames_total{product}; `product`: "depth", "render"
void CountFrames(std::string_view product, int frames);
// depthtween_bytes_total{direction}; `direction`: "in" (uploads), "out" (frames and files)
void CountBytes(std::string_view direction, int64_t bytes);
// depthtween_queue_wait_seconds: from a job's creation to its start
void ObserveQueueWait(double seconds);
// depthtween_store_write_seconds: of one transaction, waiting for its turn included
void ObserveStoreWrite(double seconds);

// What is looked up at the moment of asking.
struct Gauges {
  std::map<std::pair<std::string, std::string>, int> jobs;  // depthtween_jobs{tenant,state}
  int workers = 0;                                          // depthtween_workers
  int busy_workers = 0;                                     // depthtween_busy_workers
  int64_t free_disk_bytes = 0;                              // depthtween_free_disk_bytes
  bool ready = false;                                       // depthtween_ready
};
// All metrics as text, in Prometheus' exposition format 0.0.4, with depthtween_build_info{version}.
std::string MetricsText(const Gauges& gauges);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_TELEMETRY_METRICS_H_
