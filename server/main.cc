// depthtween-server: flags -> options, signals, order of starting and stopping.
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "core/base/parallel.h"
#include "core/base/status.h"
#include "core/io/file.h"
#include "core/sandbox/sandbox.h"
#include "server/access/guard.h"
#include "server/access/listen_address.h"
#include "server/data_commands.h"
#include "server/http/http_server.h"
#include "server/jobs/health_probe.h"
#include "server/jobs/job_manager.h"
#include "server/jobs/machine_memory.h"
#include "server/jobs/sequences.h"
#include "server/jobs/upkeep.h"
#include "server/rpc/health_check.h"
#include "server/rpc/job_json.h"
#include "server/rpc/rpc_server.h"
#include "server/store/data_directory.h"
#include "server/store/folder_blob_store.h"
#include "server/store/limits.h"
#include "server/store/sqlite_store.h"
#include "server/telemetry/health.h"
#include "server/telemetry/log.h"
#include "server/telemetry/service_manager.h"
#include "server/token_command.h"
#include "server/webhooks/webhooks.h"

namespace depthtween::server {
namespace {

constexpr char kVersion[] = "depthtween-server " DEPTHTWEEN_VERSION;
const std::map<std::string, LogLevel> log_levels = {{"debug", LogLevel::kDebug},
                                                    {"info", LogLevel::kInfo},
                                                    {"warning", LogLevel::kWarning},
                                                    {"error", LogLevel::kError}};
constexpr int kExitOk = 0, kExitFailed = 1, kExitUsage = 2;

constexpr absl::Duration kDay = absl::Hours(24);

// Streams end by themselves at once. This is for clients that do not read, and for calls that wait for the disk.
constexpr absl::Duration kStopPatience = absl::Seconds(2);
// What a stop may take beyond the drain: both listeners' patience, children that end, a disk that is slow.
constexpr absl::Duration kStopSlack = absl::Seconds(30);

struct ServeOptions {
  int64_t task_memory_bytes = -1;  // below 0: as the machine has it
  std::string data_dir;
  int quarantine_days = 7;
  double upload_days = 7, succeeded_days = 0, failed_days = 0, cancelled_days = 0, sequence_days = 0;
  double queue_hours = 0, run_hours = 0;
  int64_t collect_below_bytes = 0, collect_until_bytes = 0;
  int scrub_days = 30;
  std::string port_file;
  double drain_s = 10;
  RpcServerOptions rpc;
  bool with_http = false;
  std::string http_port_file;
  HttpServerOptions http;
  GuardOptions guard;
  JobManagerOptions jobs;
  WebhookOptions webhooks;
  Limits limits;
  LogOptions log;
};

// Blocks SIGINT and SIGTERM for this thread and all threads it starts, so that Wait() gets them.
class StopSignals {
 public:
  StopSignals() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, &before_);
    signal(SIGPIPE, SIG_IGN);  // a peer that hangs up fails a write and must not end the server
  }

  // Returns the first signal; until it comes, calls `meanwhile` every `interval`. A second signal ends the process at
  // once.
  int Wait(absl::Duration interval, const std::function<void()>& meanwhile) const {
    int number = -1;
    absl::Time next = absl::Now() + interval;
    while (number < 0) {
      const timespec left = absl::ToTimespec(std::max(absl::ZeroDuration(), next - absl::Now()));
      number = sigtimedwait(&signals_, nullptr, &left);
      if (number < 0 && errno == EAGAIN) {
        meanwhile();
        next = absl::Now() + interval;
      }
    }
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
    return number;
  }

 private:
  sigset_t signals_{};
  sigset_t before_{};
};

// Checks the text of a number, or of a size with its unit, before CLI11 converts it: CLI11's own check prints its upper
// bound with 309 digits, and calls -5GB an overflow.
CLI::Validator AtLeast(int least) {
  return CLI::Validator(
      [least](const std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        if (end == text.c_str() || value >= least) return std::string();  // CLI11 rejects what is no number
        return absl::StrCat(text, ", must be at least ", least);
      },
      "");
}

std::string CoreBesideThisProgram() {
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  return (self.parent_path() / "depthtween-core").string();
}

std::string BoundAddress(const std::string& listen, int port) {
  if (listen.rfind("unix:", 0) == 0) return listen;
  return absl::StrCat(listen.substr(0, listen.rfind(':')), ":", port);
}

// Descriptors that are not connections': of the database, the log, gRPC and libraries; and of a task at work.
int ReservedFiles(const JobManagerOptions& jobs) {
  constexpr int kOwnFiles = 96, kFilesOfTask = 16;
  return kOwnFiles + kFilesOfTask * (jobs.workers + jobs.frame_renderers);
}

// Both listeners are protected in the same way.
HttpServerOptions HttpOptions(const ServeOptions& options, const Guard& guard, int64_t file_limit) {
  HttpServerOptions http = options.http;
  http.tokens = guard.asks_for_tokens();
  http.insecure_listen_anywhere = options.rpc.insecure_listen_anywhere;
  http.tls = options.rpc.tls;
  // Whoever reaches this address has all rights: no page of another name may use a browser to do so.
  const std::string host = http.listen.substr(0, http.listen.rfind(':'));
  if (!http.tokens && IsLoopback(host)) {
    for (const std::string& name : {std::string("localhost"), std::string("127.0.0.1"), std::string("[::1]"), host}) {
      http.allowed_hosts.push_back(name);
    }
  } else {
    http.allowed_hosts.clear();
  }
  // The other half is for gRPC, which takes what is there but the reserve.
  http.max_connections =
      static_cast<int>(std::clamp<int64_t>((file_limit - ReservedFiles(options.jobs)) / 2, 1, http.max_connections));
  return http;
}

JobManagerOptions JobOptions(const ServeOptions& options, const Limits& limits) {
  JobManagerOptions jobs = options.jobs;
  jobs.check_webhook = [webhooks = options.webhooks](std::string_view url) { return CheckWebhook(webhooks, url); };
  jobs.min_free_bytes = limits.reserved_disk_bytes;
  jobs.child_memory_bytes = options.task_memory_bytes >= 0 ? options.task_memory_bytes
                                                           : TaskMemoryBytes(UsableMemoryBytes(), options.jobs.workers);
  jobs.time_limits = {.queue = absl::Hours(1) * options.queue_hours, .run = absl::Hours(1) * options.run_hours};
  jobs.retention = {.keep_succeeded = kDay * options.succeeded_days,
                    .keep_failed = kDay * options.failed_days,
                    .keep_cancelled = kDay * options.cancelled_days,
                    .keep_sequences = kDay * options.sequence_days,
                    .keep_uploads = limits.keep_uploads,
                    .collect_below_bytes = options.collect_below_bytes,
                    .collect_until_bytes = std::max(options.collect_below_bytes, options.collect_until_bytes)};
  return jobs;
}

// Connections, streams and children all need descriptors; the usual soft limit of 1,024 is there for select(), which
// nothing here uses. Returns the limit.
int64_t RaiseFileLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return std::numeric_limits<int>::max();
  const rlimit raised{limit.rlim_max, limit.rlim_max};
  const rlim_t in_force = setrlimit(RLIMIT_NOFILE, &raised) == 0 ? limit.rlim_max : limit.rlim_cur;
  return static_cast<int64_t>(std::min<rlim_t>(in_force, std::numeric_limits<int>::max()));  // it may be infinite
}

absl::Status Serve(const ServeOptions& options) {
  const StopSignals stop_signals;
  const int64_t file_limit = RaiseFileLimit();
  umask(0077);  // recordings are nobody else's to read
  ConfigureLog(options.log);
  absl::StatusOr<std::unique_ptr<Guard>> opened = Guard::Open(options.guard);
  if (!opened.ok()) return WithContext(opened.status(), "--tokens");
  const std::unique_ptr<Guard> guard = *std::move(opened);
  RETURN_IF_ERROR(options.rpc.Validate(guard->asks_for_tokens()));
  RpcServerOptions rpc_options = options.rpc;
  rpc_options.reserved_files = ReservedFiles(options.jobs);
  const HttpServerOptions http_options = HttpOptions(options, *guard, file_limit);
  if (options.with_http) RETURN_IF_ERROR(WithContext(http_options.Validate(), "--http-listen"));

  Limits limits = options.limits;
  limits.keep_uploads = kDay * options.upload_days;
  RETURN_IF_ERROR(limits.Validate());

  // Each borrows those above it and is destroyed before them.
  ASSIGN_OR_RETURN(
      const std::unique_ptr<DataDirectory> directory,
      DataDirectory::Open(options.data_dir, {.keep_quarantine = absl::Hours(24) * options.quarantine_days}));
  ASSIGN_OR_RETURN(const std::unique_ptr<Store> store, OpenSqliteStore(directory->DatabaseFile(), limits));
  const std::unique_ptr<BlobStore> blobs = MakeFolderBlobStore(*directory);
  const JobManagerOptions job_options = JobOptions(options, limits);
  absl::StatusOr<std::unique_ptr<JobManager>> started = JobManager::Start(*directory, *store, job_options);
  if (absl::IsNotFound(started.status()) || absl::IsPermissionDenied(started.status())) {
    return WithContext(started.status(), "--core-binary");
  }
  ASSIGN_OR_RETURN(const std::unique_ptr<JobManager> jobs, std::move(started));
  const auto describe = [&jobs](std::string_view id) -> absl::StatusOr<std::string> {
    ASSIGN_OR_RETURN(const JobView job, jobs->Get(Tenant::Everyone(), id));
    return JobJson(job);
  };
  absl::StatusOr<std::unique_ptr<Webhooks>> webhooks = Webhooks::Start(*store, describe, options.webhooks);
  if (!webhooks.ok()) return WithContext(webhooks.status(), "--webhook-key");
  Sequences sequences(
      *store, *blobs, [&jobs] { jobs->Wake(); }, [&jobs](std::string_view id) { jobs->StopValidation(id); });
  Collector collector(*store, *jobs, sequences, *directory, job_options.retention);
  Upkeep upkeep(*store, collector, jobs->damage(), directory->path(), {.scrub_round = kDay * options.scrub_days});
  Health health;
  const HealthProbe probe(*store, *directory, jobs->damage(), health);
  ASSIGN_OR_RETURN(const std::unique_ptr<RpcServer> server,
                   RpcServer::Start(rpc_options, *directory, *guard, sequences, *jobs, upkeep, health));

  std::unique_ptr<HttpServer> http;
  if (options.with_http) {
    ASSIGN_OR_RETURN(http, HttpServer::Start(http_options, server->InProcessChannel()));
  }

  const std::string address = BoundAddress(options.rpc.listen, server->port());
  const bool tls = options.rpc.tls.enabled();
  const std::string http_address =
      http == nullptr ? ""
                      : absl::StrCat(tls ? "https://" : "http://", BoundAddress(http_options.listen, http->port()));
  if (!options.port_file.empty()) RETURN_IF_ERROR(WriteFile(options.port_file, absl::StrCat(server->port(), "\n")));
  if (http != nullptr && !options.http_port_file.empty()) {
    RETURN_IF_ERROR(WriteFile(options.http_port_file, absl::StrCat(http->port(), "\n")));
  }
  absl::PrintF("%s ready on %s%s%s: %d workers, data in %s\n", kVersion, address, tls ? " with TLS" : "",
               http == nullptr ? "" : absl::StrCat(" and ", http_address), jobs->workers(), directory->path());
  std::fflush(stdout);
  LogInfo("ready", {{"version", DEPTHTWEEN_VERSION},
                    {"address", address},
                    {"http", http_address},
                    {"tls", tls ? "yes" : "no"},
                    {"tokens", guard->asks_for_tokens() ? "yes" : "no"},
                    {"workers", absl::StrCat(jobs->workers())},
                    {"data_dir", directory->path()}});
  if (options.rpc.insecure_listen_anywhere) {
    LogWarning(
        "open_to_everyone",
        {{"address", address}, {"tls", tls ? "yes" : "no"}, {"tokens", guard->asks_for_tokens() ? "yes" : "no"}});
  }

  const SandboxSupport sandbox = SupportedSandbox();
  if (!sandbox.system_calls || !sandbox.files) {
    LogWarning("tasks are not shut in as they should be: this kernel lacks a part, or keeps it from this process",
               {{"seccomp", sandbox.system_calls ? "yes" : "no"}, {"landlock", sandbox.files ? "yes" : "no"}});
  }

  const ServiceManager manager = ServiceManager::OfEnvironment();
  manager.Ready(absl::StrCat("ready on ", address, http == nullptr ? "" : " and ", http_address));
  // The manager restarts a server that says nothing: it speaks only after jobs and store have answered.
  const int signal_number = stop_signals.Wait(manager.alive_interval(), [&] {
    (void)jobs->Measure();
    manager.Alive();
  });
  manager.Stopping(absl::Seconds(options.drain_s) + kStopSlack);
  LogInfo("stopping", {{"signal", strsignal(signal_number)}});
  // Not ready, so that nobody sends more; what runs may come to its end, the rest goes on after the next start.
  health.StopServing();
  jobs->Drain(absl::Seconds(options.drain_s));
  jobs->StopErrands();  // calls that wait for a child must not outlast the patience
  if (http != nullptr) http->Drain();
  server->Drain(kStopPatience);  // streams over HTTP learn from this why they end
  if (http != nullptr) http->Stop(kStopPatience);
  server->Stop(absl::ZeroDuration());
  return absl::OkStatus();  // the destructors end the children and close the store
}

// What the server deletes by itself.
void AddRetentionOptions(CLI::App& command, ServeOptions& options) {
  const std::string group = "Retention; what is pinned stays, see 'depthtween pin'";
  const auto days = [&](const char* flag, double& value, const char* help) {
    command.add_option(flag, value, help)->check(AtLeast(0))->type_name("DAYS")->capture_default_str()->group(group);
  };
  days("--keep-succeeded-days", options.succeeded_days,
       "Delete a job that SUCCEEDED so long ago, with its outputs; 0: keep it");
  days("--keep-failed-days", options.failed_days, "The same for a job that FAILED");
  days("--keep-cancelled-days", options.cancelled_days, "The same for a job that was CANCELLED");
  days("--keep-sequence-days", options.sequence_days,
       "Delete a recording that no job has used for so long; 0: keep it");
  days("--upload-days", options.upload_days,
       "Delete a recording that is not committed when no byte of it has come for so long; 0: keep it");
  const auto size = CLI::AsSizeValue(/*kb_is_1000=*/true);
  const auto watermark = [&](const char* flag, int64_t& value, const char* help) {
    command.add_option(flag, value, help)
        ->transform(size)
        ->transform(AtLeast(0))
        ->type_name("SIZE")
        ->capture_default_str()
        ->group(group);
  };
  watermark("--collect-below", options.collect_below_bytes,
            "When less is free on the disk, delete the oldest of the jobs that have ended and the recordings that are "
            "not used, unless it was within the last hour; 0: never");
  watermark("--collect-until", options.collect_until_bytes,
            "Stop deleting when so much is free; by default as --collect-below");
}

void AddServeCommand(CLI::App& app, ServeOptions& options) {
  CLI::App* command = app.add_subcommand("serve", "Serve until SIGTERM or SIGINT.");
  command->add_option("--data-dir", options.data_dir, "Folder for recordings, jobs and results; made if missing")
      ->required();
  command->add_flag("--new-database", options.jobs.accept_new_store,
                    "Go on with an empty database where the folder's own is lost: recordings and jobs that it does not "
                    "know go to DATA_DIR/quarantine");
  command
      ->add_option("--quarantine-days", options.quarantine_days,
                   "How long to keep what lies in the data folder and the database does not know, such as after the "
                   "database was restored from a backup")
      ->check(AtLeast(0))
      ->type_name("DAYS")
      ->capture_default_str();
  command
      ->add_option(
          "--drain-seconds", options.drain_s,
          "At SIGTERM, how long to let running tasks come to their end before they are stopped; what they have "
          "not finished goes on after the next start. A second signal ends the server at once")
      ->check(AtLeast(0))
      ->type_name("N")
      ->capture_default_str();
  command
      ->add_option("--scrub-days", options.scrub_days,
                   "Read every stored file once in this time, slowly, and log what is damaged; 0: begin no round")
      ->check(AtLeast(0))
      ->type_name("DAYS")
      ->capture_default_str();
  command
      ->add_option("--listen", options.rpc.listen,
                   "HOST:PORT (port 0: any free one) or unix:PATH. By default a socket in XDG_RUNTIME_DIR, "
                   "which no other user of the machine can reach; where there is none, 127.0.0.1:50051")
      ->capture_default_str();
  command->add_option("--port-file", options.port_file, "Write the bound port to this file once ready");
  command->add_flag(
      "--insecure-listen-anywhere", options.rpc.insecure_listen_anywhere,
      "Listen on addresses other than loopback even without --tls-cert and --tokens: then anyone who can reach the "
      "port can read and delete everything. Only where the network itself keeps others out");
  command->add_option("--http-listen", options.http.listen,
                      "HOST:PORT of the HTTP listener: JSON, server-sent events, gRPC-Web. Without it there is none");
  command->add_option("--http-port-file", options.http_port_file,
                      "Write the bound port of the HTTP listener to this file once ready");
  command
      ->add_option("--allow-origin", options.http.allowed_origins,
                   "Let scripts of web pages of this origin use the HTTP listener, such as https://example.org; may be "
                   "given again")
      ->type_name("ORIGIN");
  command
      ->add_option(
          "--allow-host", options.http.allowed_hosts,
          "Answer requests under this name too, where the HTTP listener is on loopback and asks for no tokens: "
          "there it answers as localhost, 127.0.0.1 and [::1]; may be given again")
      ->type_name("NAME");
  command->add_option("--workers", options.jobs.workers, "Tasks that run at the same time")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str();
  command
      ->add_option("--threads", options.jobs.default_threads,
                   "Threads of a task whose job leaves the choice to the server")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str();
  command
      ->add_option("--frame-renderers", options.jobs.frame_renderers,
                   "Single frames rendered on demand at the same time, beside the workers")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str();
  command->add_option("--core-binary", options.jobs.core_program, "The depthtween-core that runs the tasks")
      ->capture_default_str();

  AddRetentionOptions(*command, options);

  const std::string limits = "Limits";
  const auto size = CLI::AsSizeValue(/*kb_is_1000=*/true);  // 20GB, 256MiB
  command
      ->add_option("--max-sequence-bytes", options.limits.max_sequence_bytes,
                   "Largest size of one recording; also as 20GB or 256MiB")
      ->transform(size)
      ->transform(AtLeast(1))
      ->type_name("SIZE")
      ->capture_default_str()
      ->group(limits);
  command->add_option("--max-files-per-sequence", options.limits.max_files_per_sequence, "Most files of one recording")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str()
      ->group(limits);
  const auto of_tenant = [&](const char* flag, auto& value, const char* help) {
    return command->add_option(flag, value, help)->type_name("N")->capture_default_str()->group(limits);
  };
  of_tenant("--max-tenant-bytes", options.limits.max_tenant_bytes,
            "Largest size of all recordings of one tenant; also as 20GB; 0: no limit of its own")
      ->transform(size)
      ->transform(AtLeast(0))
      ->type_name("SIZE");
  of_tenant("--max-tenant-queued-jobs", options.limits.max_tenant_queued_jobs,
            "Most jobs of one tenant in the queue; 0: no limit of its own")
      ->check(AtLeast(0));
  of_tenant("--max-tenant-tasks", options.limits.max_tenant_tasks,
            "Most tasks of one tenant at work at the same time; 0: as many as there are workers")
      ->check(AtLeast(0));
  of_tenant("--max-tenant-uploads", options.limits.max_tenant_uploads,
            "Most uploads of one tenant that are begun and not finished; 0: no limit of its own")
      ->check(AtLeast(0));
  const auto hours = [&](const char* flag, double& value, const char* help) {
    command->add_option(flag, value, help)->check(AtLeast(0))->type_name("HOURS")->capture_default_str()->group(limits);
  };
  hours("--max-queue-hours", options.queue_hours,
        "Fail a job that has waited so long for its first task; 0: no limit. A job may ask for a shorter one");
  hours("--max-run-hours", options.run_hours,
        "Fail a job that has run so long, by the clock on the wall; 0: no limit. A job may ask for a shorter one");
  command->add_option("--max-queued-jobs", options.limits.max_queued_jobs, "Most jobs in the queue")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str()
      ->group(limits);
  command
      ->add_option("--reserved-disk-bytes", options.limits.reserved_disk_bytes,
                   "Refuse uploads that would leave less space free, and begin no work while there is less")
      ->transform(size)
      ->transform(AtLeast(0))
      ->type_name("SIZE")
      ->capture_default_str()
      ->group(limits);
  command
      ->add_option("--max-sequence-pixels", options.jobs.max_sequence_pixels,
                   "Most pixels of all frames of one recording together; 0: no limit")
      ->check(AtLeast(0))
      ->type_name("N")
      ->capture_default_str()
      ->group(limits);
  command
      ->add_option("--max-threads-per-task", options.jobs.max_threads, "Most threads that a job may ask for, per task")
      ->check(AtLeast(1))
      ->type_name("N")
      ->capture_default_str()
      ->group(limits);
  command
      ->add_option("--task-memory-bytes", options.task_memory_bytes,
                   "Memory of one task; 0: no limit. By default 0.8 of the memory of the machine, or of the control "
                   "group that the server runs in, divided by the workers, and at least 1 GiB")
      ->transform(size)
      ->transform(AtLeast(0))
      ->type_name("SIZE")
      ->default_str("")
      ->group(limits);
  command
      ->add_option_function<double>(
          "--task-stall-seconds", [&options](double seconds) { options.jobs.task_stall = absl::Seconds(seconds); },
          "End a task that tells of no progress for so long, and try it again")
      ->check(CLI::Range(1.0, 1e9))
      ->type_name("SECONDS")
      ->default_str(absl::StrCat(absl::ToDoubleSeconds(options.jobs.task_stall)))
      ->group(limits);
  command
      ->add_option("--task-cpu-seconds", options.jobs.task_cpu_seconds,
                   "Processor time of one task, over all its threads; 0: no limit")
      ->check(AtLeast(0))
      ->type_name("SECONDS")
      ->capture_default_str()
      ->group(limits);
  const auto count = [&](const char* flag, int& value, const char* help) {
    command->add_option(flag, value, help)->check(AtLeast(1))->type_name("N")->capture_default_str()->group(limits);
  };
  count("--max-calls", options.rpc.room.calls, "Most short calls being answered at the same time");
  count("--max-streams", options.rpc.room.streams, "Most watches, frame streams and uploads open at the same time");
  count("--max-streams-of-client", options.rpc.room.streams_of_client,
        "Of them, most of one tenant, and of one client address");
  command
      ->add_option("--max-calls-per-second", options.guard.max_calls_per_second,
                   "Most calls of one tenant, over a few seconds; 0: no limit")
      ->check(AtLeast(0))
      ->type_name("N")
      ->capture_default_str()
      ->group(limits);

  const std::string security = "Security";
  command
      ->add_option("--tls-cert", options.rpc.tls.cert,
                   "Speak TLS with this certificate chain (PEM). Read again when it changes, as are the two below")
      ->type_name("FILE")
      ->group(security);
  command->add_option("--tls-key", options.rpc.tls.key, "Its private key (PEM)")->type_name("FILE")->group(security);
  command
      ->add_option("--tls-client-ca", options.rpc.tls.client_ca,
                   "Let in only clients with a certificate that one of these has signed (PEM)")
      ->type_name("FILE")
      ->group(security);
  command
      ->add_option(
          "--tokens", options.guard.token_file,
          "Let in only calls with a bearer token of this file, see 'depthtween-server token'. Read again when it "
          "changes")
      ->type_name("FILE")
      ->group(security);

  command
      ->add_option(
          "--webhook-key", options.webhooks.key_file,
          "Let jobs have webhooks, and sign them with the keys of this file: \"whsec_\" and base64 of 24 to 64 "
          "bytes on each line")
      ->type_name("FILE")
      ->group(security);
  command
      ->add_flag(
          "--webhook-allow-private", options.webhooks.allow_private,
          "Let webhooks go to addresses that are not public, such as those of this machine and its network, and to "
          "http://: then whoever may create jobs can make the server call its neighbours")
      ->group(security);

  const std::string log = "Log";
  command->add_flag("--log-json", options.log.json, "Log JSON, one object a line")->group(log);
  command->add_option("--log-level", options.log.level, "debug, info, warning or error")
      ->transform(CLI::CheckedTransformer(log_levels))
      ->type_name("LEVEL")
      ->default_str("info")
      ->group(log);
}

void AddHealthCheckCommand(CLI::App& app, HealthCheckOptions& options) {
  CLI::App* command = app.add_subcommand("healthcheck", "Exit with 0 if a server is up and serving, else with 1.");
  command->add_option("--server", options.server, "HOST:PORT or unix:PATH")->capture_default_str();
  const auto file = [&](const char* flag, std::string& value, const char* help) {
    command->add_option(flag, value, help)->type_name("FILE");
  };
  file("--tls-ca", options.tls_ca, "The server speaks TLS; its certificate is signed by one of these (PEM)");
  file("--tls-cert", options.tls_cert, "Your own certificate, where the server asks for one (PEM)");
  file("--tls-key", options.tls_key, "Its private key (PEM)");
  command
      ->add_option("--tls-name", options.tls_name,
                   "The name in the server's certificate, where it is not the HOST of --server")
      ->type_name("NAME");
  command
      ->add_option_function<double>(
          "--timeout", [&options](double seconds) { options.timeout = absl::Seconds(seconds); }, "Seconds")
      ->check(CLI::Range(0.001, 1e6))
      ->default_str(absl::StrCat(absl::ToDoubleSeconds(options.timeout)));
}

int Main(int argc, char** argv) {
  ServeOptions serve;
  serve.jobs.core_program = CoreBesideThisProgram();
  serve.jobs.workers = AvailableThreads();
  serve.jobs.max_threads = AvailableThreads();
  HealthCheckOptions health_check;

  CLI::App app(
      "Runs depth upsampling as jobs: recordings come in, frames go out, over gRPC.\n"
      "\n"
      "  depthtween-server serve --data-dir /var/lib/depthtween\n"
      "  depthtween submit SEQUENCE_FOLDER --wait -o RESULT_FOLDER\n",
      "depthtween-server");
  app.set_version_flag("--version", kVersion);
  app.require_subcommand(1);
  app.get_formatter()->column_width(36);
  AddServeCommand(app, serve);
  AddHealthCheckCommand(app, health_check);
  TokenOptions token;
  const CLI::App* token_command = AddTokenCommand(app, token);
  const DataCommands data_commands(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;  // --help and --version end parsing too
  }

  absl::Status status;
  try {
    serve.with_http = app.got_subcommand("serve") && app.get_subcommand("serve")->count("--http-listen") > 0;
    if (app.got_subcommand("serve")) {
      status = Serve(serve);
    } else if (app.got_subcommand("token")) {
      status = RunTokenCommand(*token_command, token);
    } else if (std::optional<absl::Status> done = data_commands.Run()) {
      status = *std::move(done);
    } else {
      status = CheckHealth(health_check);
    }
  } catch (const std::exception& error) {
    status = absl::InternalError(absl::StrCat("unexpected failure, please report it: ", error.what()));
  }
  if (status.ok()) return kExitOk;
  absl::FPrintF(stderr, "depthtween-server: %s\n", std::string(status.message()));
  return absl::IsInvalidArgument(status) ? kExitUsage : kExitFailed;
}

}  // namespace
}  // namespace depthtween::server

// What may still be thrown, before the flags are parsed, is that there is no memory.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) { return depthtween::server::Main(argc, argv); }
