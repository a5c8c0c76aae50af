#include "client/lib/fetch.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/lib/backoff.h"
#include "client/lib/files.h"
#include "proto/depthtween/crc32c.h"

namespace depthtween::client {
namespace {

namespace fs = std::filesystem;

using Outputs = v1::OutputService::StubInterface;

constexpr int64_t kMostFrameBytes = int64_t{1} << 30;

// Whether to retry a stream that ended with an error: the server is unreachable, or bytes arrived damaged.
class Persistence {
 public:
  explicit Persistence(const Connection& connection) : backoff_(connection.NewBackoff()) {}

  void Progressed() {
    damaged_ = 0;
    backoff_.Reset();
  }
  bool TryAgain(const absl::Status& status) {
    if (IsLost(status)) return false;
    if (absl::IsDataLoss(status)) return ++damaged_ < kDamagedTries && backoff_.Wait(status);
    return IsTransient(status) && backoff_.Wait(status);
  }

 private:
  Backoff backoff_;
  int damaged_ = 0;
};

absl::Status CheckChecksum(std::string_view data, uint32_t expected, std::string_view what, int64_t offset) {
  if (Crc32c(data) == expected) return absl::OkStatus();
  return absl::DataLossError(absl::StrFormat("%s arrived damaged: bytes from %d on do not match their crc32c",
                                             absl::string_view(what.data(), what.size()), offset));
}

// Assembles frames from their chunks.
class FrameAssembler {
 public:
  explicit FrameAssembler(std::string output) : output_(std::move(output)) {}

  // True when `chunk` was the last of its frame: frame() is whole and checked.
  absl::StatusOr<bool> Add(const v1::FrameChunk& chunk) {
    if (chunk.has_header()) frame_ = {.index = chunk.frame(), .header = chunk.header()};
    const std::string what = absl::StrCat("frame ", chunk.frame(), " of ", output_);
    const int64_t size = frame_.header.size_bytes();
    if (chunk.frame() != frame_.index || chunk.offset() != static_cast<int64_t>(frame_.bytes.size()) ||
        size > kMostFrameBytes || chunk.offset() + static_cast<int64_t>(chunk.data().size()) > size) {
      return absl::DataLossError(
          absl::StrFormat("%s arrived with a chunk out of place, at byte %d of %d", what, chunk.offset(), size));
    }
    RETURN_IF_ERROR(CheckChecksum(chunk.data(), chunk.crc32c(), what, chunk.offset()));
    frame_.bytes += chunk.data();
    if (!chunk.has_next_frame()) return false;
    if (static_cast<int64_t>(frame_.bytes.size()) != size) {
      return absl::DataLossError(absl::StrFormat("%s ended after %d of %d bytes", what, frame_.bytes.size(), size));
    }
    RETURN_IF_ERROR(CheckChecksum(frame_.bytes, frame_.header.crc32c(), what, 0));
    frame_.next_frame = chunk.next_frame();
    return true;
  }
  const Frame& frame() const { return frame_; }

 private:
  const std::string output_;
  Frame frame_;
};

std::string FetchStatePath(const std::string& directory) { return directory + "/.fetch.json"; }

// The state of an unfinished fetch, kept in the result folder.
class FetchState {
 public:
  // FailedPrecondition if the folder's fetch is of another job.
  static absl::StatusOr<FetchState> Open(const std::string& directory, const std::string& job) {
    FetchState state(FetchStatePath(directory), job);
    const absl::StatusOr<std::string> text = ReadFile(state.path_);
    if (absl::IsNotFound(text.status())) return state;
    RETURN_IF_ERROR(text.status());
    const nlohmann::json stored = nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false);
    if (!stored.is_object() || !stored.contains("job") || stored["job"] != job) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "%s holds an unfinished fetch of %s; fetch %s into another folder, or use --force to replace it", directory,
          stored.is_object() ? stored.value("job", "another job") : "another job", job));
    }
    const nlohmann::json next_frame = stored.value("next_frame", nlohmann::json::object());
    for (const auto& [output, frame] : next_frame.items()) {
      if (frame.is_number_integer()) state.next_frame_[output] = std::max(0, frame.get<int>());
    }
    const nlohmann::json lost = stored.value("lost", nlohmann::json::object());
    for (const auto& [output, frames] : lost.items()) {
      for (const nlohmann::json& frame : frames) {
        if (frame.is_number_integer()) state.lost_[output].insert(std::max(0, frame.get<int>()));
      }
    }
    return state;
  }

  int next_frame(const std::string& output) const {
    const auto found = next_frame_.find(output);
    return found == next_frame_.end() ? 0 : found->second;
  }
  std::set<int> lost(const std::string& output) const {
    const auto found = lost_.find(output);
    return found == lost_.end() ? std::set<int>() : found->second;
  }
  // The frame is in the folder. The fetch continues at `next_frame`, unless it had got further already.
  absl::Status AddFetched(const std::string& output, int frame, int next_frame) {
    if (const auto found = lost_.find(output); found != lost_.end()) found->second.erase(frame);
    return GoOn(output, next_frame);
  }
  absl::Status AddLost(const std::string& output, int frame, int next_frame) {
    lost_[output].insert(frame);
    return GoOn(output, next_frame);
  }
  absl::Status Save() const {
    return WriteFile(path_, nlohmann::json{{"job", job_}, {"next_frame", next_frame_}, {"lost", lost_}}.dump());
  }
  absl::Status Remove() {
    if (std::remove(path_.c_str()) != 0 && errno != ENOENT) return ErrnoStatus(errno, "removing " + path_);
    return absl::OkStatus();
  }

 private:
  FetchState(std::string path, std::string job) : path_(std::move(path)), job_(std::move(job)) {}

  absl::Status GoOn(const std::string& output, int next_frame) {
    next_frame_[output] = std::max(this->next_frame(output), next_frame);
    return Save();
  }

  std::string path_;
  std::string job_;
  std::map<std::string, int> next_frame_;
  std::map<std::string, std::set<int>> lost_;  // of those before next_frame_
};

// "depth" of "jobs/7/outputs/depth".
absl::Status CheckName(const std::string& name) {
  if (IsPlainFileName(name)) return absl::OkStatus();
  return absl::DataLossError(absl::StrFormat("the server named a file '%s', which is not a plain file name", name));
}

// Where an output lies in a result folder: the name of a file, or of a folder with frames, which may lie in another.
absl::StatusOr<std::string> PlaceOf(const v1::Output& output) {
  if (output.kind() != v1::Output::KIND_FRAMES) {
    RETURN_IF_ERROR(CheckName(output.file_name()));
    return output.file_name();
  }
  for (const absl::string_view part : absl::StrSplit(output.file_name(), '/')) {
    RETURN_IF_ERROR(CheckName(std::string(part)));
  }
  return output.file_name();
}

// The start_frame that continues after `frame`.
int After(int frame, int stride) {
  return static_cast<int>(std::min<int64_t>(int64_t{frame} + std::max(1, stride), std::numeric_limits<int>::max()));
}

// What a result consists of, and what the new one will consist of. Pictures of another job under other names stay.
absl::Status RemoveResult(const std::string& directory, const v1::ListOutputsResponse& outputs) {
  std::vector<std::string> parts = {".fetch.json", "report.json",  "depth.txt", "camera.json", "depth",
                                    "uncertainty", "provenance",   "motion",    "sceneflow",   "preview.png",
                                    "flow",        "depth_change", "kitti"};
  for (const v1::Output& output : outputs.outputs()) {
    ASSIGN_OR_RETURN(parts.emplace_back(), PlaceOf(output));
  }
  for (const std::string& part : parts) {
    const fs::path path = fs::path(directory) / part;
    std::error_code error;
    fs::remove_all(path, error);
    if (error) return ErrnoStatus(error.value(), "removing " + path.string());
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<v1::ListOutputsResponse> ListOutputs(Connection& connection, const std::string& job) {
  v1::ListOutputsRequest request;
  request.set_parent(job);
  return connection.Call(connection.outputs(), &Outputs::ListOutputs, request);
}

absl::Status StreamFrames(Connection& connection, v1::StreamFramesRequest request,
                          const std::function<absl::Status(const Frame&)>& sink,
                          const std::function<absl::Status(int frame)>& on_lost) {
  for (Persistence persistence(connection);;) {
    grpc::ClientContext context;  // no deadline: a followed job takes as long as it takes
    connection.Authorize(context);
    const auto stream = connection.outputs().StreamFrames(&context, request);
    FrameAssembler assembler(request.name());
    v1::FrameChunk chunk;
    absl::Status here, sunk;
    while (here.ok() && sunk.ok() && stream->Read(&chunk)) {
      const absl::StatusOr<bool> whole = assembler.Add(chunk);
      here = whole.status();
      if (!here.ok() || !*whole) continue;
      sunk = sink(assembler.frame());
      request.set_start_frame(assembler.frame().next_frame);
      persistence.Progressed();
    }
    if (!here.ok() || !sunk.ok()) context.TryCancel();
    const absl::Status there = connection.Answer(stream->Finish());
    if (!sunk.ok()) return sunk;
    absl::Status status = here.ok() ? there : here;
    if (const std::optional<int> lost = LostFrame(status); lost && on_lost && *lost >= request.start_frame()) {
      RETURN_IF_ERROR(on_lost(*lost));
      request.set_start_frame(After(*lost, request.stride()));
      persistence.Progressed();
    } else if (!persistence.TryAgain(status)) {
      return status;
    }
    if (request.end_frame() > 0 && request.start_frame() >= request.end_frame()) return absl::OkStatus();
  }
}

absl::StatusOr<int64_t> FetchFile(Connection& connection, const std::string& name, const std::string& path) {
  ASSIGN_OR_RETURN(GrowingFile file, GrowingFile::Open(path));
  int64_t size = 0;
  for (Persistence persistence(connection);;) {
    v1::ReadOutputRequest request;
    request.set_name(name);
    request.set_read_offset(size);
    grpc::ClientContext context;
    connection.Authorize(context);
    const auto stream = connection.outputs().ReadOutput(&context, request);
    v1::ReadOutputResponse part;
    absl::Status here, written;
    while (here.ok() && written.ok() && stream->Read(&part)) {
      here = CheckChecksum(part.data(), part.crc32c(), name, part.offset());
      if (here.ok() && part.offset() != size) {
        here = absl::DataLossError(absl::StrFormat("%s arrived with bytes out of place, at %d", name, part.offset()));
      }
      if (!here.ok()) continue;
      written = file.Append(part.data());
      size += static_cast<int64_t>(part.data().size());
      persistence.Progressed();
    }
    if (!here.ok() || !written.ok()) context.TryCancel();
    const absl::Status there = connection.Answer(stream->Finish());
    if (!written.ok()) return written;
    absl::Status status = here.ok() ? there : here;
    if (status.ok()) break;
    if (!persistence.TryAgain(status)) return status;
  }
  RETURN_IF_ERROR(file.Finish());
  return size;
}

absl::StatusOr<std::string> FrameFileName(const v1::FrameHeader& header) {
  const auto extension = [&] {
    switch (header.encoding()) {
      case v1::ENCODING_JPEG:
        return ".jpg";
      case v1::ENCODING_NPZ:
        return ".npz";
      case v1::ENCODING_FLO:
        return ".flo";
      case v1::ENCODING_PFM:
        return ".pfm";
      default:
        return ".png";
    }
  };
  const std::string name = absl::StrCat(header.stem(), extension());
  RETURN_IF_ERROR(CheckName(name));
  return name;
}

absl::StatusOr<Frame> RenderFrame(Connection& connection, const v1::RenderFrameRequest& request) {
  for (Persistence persistence(connection);;) {
    grpc::ClientContext context;  // no deadline: the server has one
    connection.Authorize(context);
    const auto stream = connection.outputs().RenderFrame(&context, request);
    FrameAssembler assembler(request.job());
    v1::FrameChunk chunk;
    absl::Status here;
    bool whole = false;
    while (here.ok() && !whole && stream->Read(&chunk)) {
      const absl::StatusOr<bool> added = assembler.Add(chunk);
      here = added.status();
      whole = added.ok() && *added;
    }
    if (!here.ok()) context.TryCancel();
    const absl::Status there = connection.Answer(stream->Finish());
    absl::Status status = here.ok() ? there : here;
    if (status.ok() && whole) return assembler.frame();
    if (!persistence.TryAgain(status)) {
      return status.ok() ? absl::DataLossError("the picture ended before it was whole") : status;
    }
  }
}

absl::Status CheckFolder(const std::string& directory, bool replace) {
  std::error_code error;
  const fs::path root(directory);
  if (!fs::exists(root, error)) return absl::OkStatus();
  if (!fs::is_directory(root, error)) return absl::InvalidArgumentError(directory + " is not a folder");
  // A result lists no colour; a folder that does is somebody's recording.
  if (fs::exists(root / "rgb.txt", error)) {
    return absl::InvalidArgumentError(
        directory + " holds a recording (rgb.txt), which a result must not be mixed with: name another folder");
  }
  if (replace || fs::is_empty(root, error) || fs::exists(FetchStatePath(directory), error)) return absl::OkStatus();
  return absl::AlreadyExistsError(
      directory + " is not empty: name another folder, or use --force to replace an earlier result in it");
}

absl::StatusOr<FetchSummary> FetchResult(Connection& connection, const std::string& job, const std::string& directory,
                                         const FetchOptions& options,
                                         const std::function<void(const FetchProgress&)>& on_progress) {
  // Asked first, so that a wrong name leaves no folder behind.
  ASSIGN_OR_RETURN(v1::ListOutputsResponse outputs, ListOutputs(connection, job));
  RETURN_IF_ERROR(CheckFolder(directory, options.replace));
  if (options.replace) RETURN_IF_ERROR(RemoveResult(directory, outputs));
  RETURN_IF_ERROR(MakeFolder(directory));
  ASSIGN_OR_RETURN(FetchState state, FetchState::Open(directory, job));
  RETURN_IF_ERROR(state.Save());

  FetchSummary summary;
  FetchProgress& progress = summary.progress;
  for (const v1::Output& output : outputs.outputs()) {
    if (output.kind() != v1::Output::KIND_FRAMES) continue;
    progress.frames_total += output.frame_count();
    ASSIGN_OR_RETURN(const std::string folder, PlaceOf(output));
    progress.frames_done += state.next_frame(folder) - static_cast<int>(state.lost(folder).size());
  }
  for (const v1::Output& output : outputs.outputs()) {
    if (output.kind() != v1::Output::KIND_FRAMES) continue;
    ASSIGN_OR_RETURN(const std::string folder, PlaceOf(output));
    RETURN_IF_ERROR(MakeFolder(absl::StrCat(directory, "/", folder)));
    const auto keep = [&](const Frame& frame) -> absl::Status {
      ASSIGN_OR_RETURN(const std::string name, FrameFileName(frame.header));
      // A frame without bytes: this output has nothing for it.
      if (!frame.bytes.empty()) {
        RETURN_IF_ERROR(WriteFile(absl::StrCat(directory, "/", folder, "/", name), frame.bytes));
      }
      RETURN_IF_ERROR(state.AddFetched(folder, frame.index, frame.next_frame));
      progress.frames_done += 1;
      progress.bytes += static_cast<int64_t>(frame.bytes.size());
      if (on_progress) on_progress(progress);
      return absl::OkStatus();
    };
    const auto leave_out = [&](int frame) { return state.AddLost(folder, frame, After(frame, /*stride=*/1)); };
    v1::StreamFramesRequest request;
    request.set_name(output.name());
    // Lost at the last request; it may have been restored since.
    for (const int frame : state.lost(folder)) {
      request.set_start_frame(frame);
      request.set_end_frame(After(frame, /*stride=*/1));
      RETURN_IF_ERROR(StreamFrames(connection, request, keep, leave_out));
    }
    request.set_start_frame(state.next_frame(folder));
    request.clear_end_frame();
    request.set_follow(options.follow);
    RETURN_IF_ERROR(StreamFrames(connection, request, keep, leave_out));
  }

  // Asked again: the job has ended meanwhile and made its files.
  ASSIGN_OR_RETURN(outputs, ListOutputs(connection, job));
  summary.complete = outputs.outputs_size() > 0;
  progress.frames_total = 0;
  for (const v1::Output& output : outputs.outputs()) {
    if (output.kind() == v1::Output::KIND_FRAMES) {
      progress.frames_total += output.frame_count();
      ASSIGN_OR_RETURN(const std::string folder, PlaceOf(output));
      if (output.frame_count() == 0 || state.next_frame(folder) < output.frame_count()) {
        summary.complete = false;
      }
      const std::set<int> lost = state.lost(folder);
      if (!lost.empty()) {
        summary.lost.push_back({.output = output.name(), .place = folder, .frames = {lost.begin(), lost.end()}});
      }
      continue;
    }
    // Requests lost files too: they may have been restored.
    if (!output.ready() && !output.lost()) {
      summary.complete = false;
      continue;
    }
    ASSIGN_OR_RETURN(const std::string file, PlaceOf(output));
    const absl::StatusOr<int64_t> bytes = FetchFile(connection, output.name(), absl::StrCat(directory, "/", file));
    if (IsLost(bytes.status())) {
      summary.lost.push_back({.output = output.name(), .place = file});
      continue;
    }
    RETURN_IF_ERROR(bytes.status());
    progress.bytes += *bytes;
  }
  summary.complete = summary.complete && summary.lost.empty();
  if (summary.complete) RETURN_IF_ERROR(state.Remove());
  return summary;
}

}  // namespace depthtween::client
