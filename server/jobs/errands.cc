#include "server/jobs/errands.h"

#include <atomic>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "server/jobs/child_process.h"
#include "server/jobs/task_protocol.h"
#include "server/store/error_info.h"
#include "server/store/files.h"

namespace depthtween::server {
namespace {

constexpr int64_t kMaxAnswerBytes = 256 << 20;  // a PNG of 64 megapixels

// The child names a field from the root of its own options; the client sent them inside a larger message.
absl::Status WithPrefix(const absl::Status& status, const std::string& prefix) {
  const std::optional<ErrorInfo> info = GetErrorInfo(status);
  if (!info || info->reason != "BAD_FIELD" || prefix.empty()) return status;
  return BadField(prefix + info->metadata.at("field"), absl::StrCat(prefix, status.message()));
}

}  // namespace

struct Errand::State {
  ErrandOrder order;
  std::stop_source stop;
  std::mutex mutex;
  std::condition_variable done;
  std::function<void()> on_done;                      // guarded by mutex; empty once the errand is destroyed
  std::optional<absl::StatusOr<std::string>> answer;  // guarded by mutex

  void Answer(absl::StatusOr<std::string> value) {
    const std::lock_guard lock(mutex);
    answer = std::move(value);
    done.notify_all();
    if (on_done) on_done();
  }
};

Errand::Errand(std::shared_ptr<State> state) : state_(std::move(state)) {}

Errand::~Errand() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->on_done = nullptr;
  }
  state_->stop.request_stop();
}

std::optional<absl::StatusOr<std::string>> Errand::TakeAnswer() {
  const std::lock_guard lock(state_->mutex);
  return std::exchange(state_->answer, std::nullopt);
}

Errands::Errands(DataDirectory& directory, const ErrandOptions& options) : directory_(directory), options_(options) {
  for (int i = 0; i < options_.threads; ++i) {
    threads_.emplace_back([this](const std::stop_token& stop) { Work(stop); });
  }
}

Errands::~Errands() {
  Stop();
  threads_.clear();
}

void Errands::Stop() {
  for (std::jthread& thread : threads_) thread.request_stop();
  std::deque<std::shared_ptr<Errand::State>> waiting;
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    waiting.swap(waiting_);
  }
  for (const auto& state : waiting) state->Answer(ServerStopping());
}

absl::StatusOr<std::unique_ptr<Errand>> Errands::Start(const ErrandOrder& order, std::function<void()> on_done) {
  auto state = std::make_shared<Errand::State>();
  state->order = order;
  state->on_done = std::move(on_done);
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return ServerStopping();
    std::erase_if(waiting_, [](const auto& other) { return other->stop.stop_requested(); });
    if (static_cast<int>(waiting_.size()) >= options_.max_waiting) {
      return ServerBusy(
          absl::StrFormat("%d calls wait for a child process, which is the limit; try again later", waiting_.size()));
    }
    waiting_.push_back(state);
  }
  changed_.notify_one();
  return std::unique_ptr<Errand>(new Errand(std::move(state)));
}

absl::StatusOr<std::string> Errands::Run(const ErrandOrder& order) {
  ASSIGN_OR_RETURN(const std::unique_ptr<Errand> errand, Start(order, nullptr));
  std::unique_lock lock(errand->state_->mutex);
  errand->state_->done.wait(lock, [&] { return errand->state_->answer.has_value(); });
  return *std::exchange(errand->state_->answer, std::nullopt);
}

void Errands::Work(const std::stop_token& stop) {
  while (true) {
    std::shared_ptr<Errand::State> state;
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return !waiting_.empty(); }) || stop.stop_requested()) return;
      state = std::move(waiting_.front());
      waiting_.pop_front();
    }
    if (state->stop.stop_requested()) continue;  // no longer wanted
    const std::stop_callback server_stops(stop, [&state] { state->stop.request_stop(); });
    absl::StatusOr<std::string> answer = RunOne(state->order, state->stop.get_token());
    if (absl::IsCancelled(answer.status()) && stop.stop_requested()) answer = ServerStopping();
    if (!answer.ok()) answer = directory_.WithoutPath(answer.status());
    state->Answer(std::move(answer));
  }
}

absl::StatusOr<std::string> Errands::RunOne(const ErrandOrder& order, const std::stop_token& stop) {
  // Unique in this process. What a killed server left was discarded when this one started.
  static std::atomic<int64_t> started{0};
  const std::string folder = absl::StrCat(directory_.TasksFolder(), "/errand-", ++started);
  RETURN_IF_ERROR(MakeFolder(folder));
  const absl::Cleanup discard = [&] { directory_.Discard(folder).IgnoreError(); };
  RETURN_IF_ERROR(WriteScratchFile(folder + "/options.json", order.options));
  std::vector<std::string> command = {options_.core_program, "task"};
  command.insert(command.end(), order.arguments.begin(), order.arguments.end());
  for (const std::string& word : {std::string("--options"), folder + "/options.json", std::string("--out"),
                                  folder + "/answer", std::string("--progress-fd"), std::string("3")}) {
    command.push_back(word);
  }
  std::optional<absl::Status> said;
  absl::StatusOr<ChildOutcome> child = RunChild({.arguments = command,
                                                 .host = options_.host,
                                                 .folder = folder,
                                                 .memory_bytes = options_.child_memory_bytes,
                                                 .file_bytes = options_.child_file_bytes,
                                                 .grace = options_.grace,
                                                 .time_limit = options_.time_limit},
                                                stop, [&](std::string_view text) {
                                                  const ProgressLine line = ParseProgressLine(text);
                                                  if (line.error) said = line.error;
                                                  if (line.lost)
                                                    said = LostStatus(*line.lost, order.job_id, order.sequence_id);
                                                  return true;
                                                });
  if (!child.ok()) return WithContext(child.status(), "start of depthtween-core");
  if (child->timed_out) {
    return absl::DeadlineExceededError(
        absl::StrCat("it took longer than the ", absl::FormatDuration(options_.time_limit), " that the server allows"));
  }
  if (child->stopped) return absl::CancelledError("it was stopped");
  if (said) return WithPrefix(*said, order.field_prefix);
  if (child->exit_code != 0) {
    return absl::InternalError(
        absl::StrCat("task ", order.arguments.front(), ": ", child->Describe(),
                     "; its last output: ", absl::StripAsciiWhitespace(absl::string_view(child->error_output))));
  }
  return ReadWholeFile(folder + "/answer", kMaxAnswerBytes);
}

}  // namespace depthtween::server
