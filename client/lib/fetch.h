// Fetches results: single frames as they become ready, or a whole result folder.
#ifndef DEPTHTWEEN_CLIENT_LIB_FETCH_H_
#define DEPTHTWEEN_CLIENT_LIB_FETCH_H_

#include <functional>
#include <string>
#include <vector>

#include "client/lib/connection.h"

namespace depthtween::client {

// One whole frame, checked against its checksums, in the requested encoding.
struct Frame {
  int index = -1;
  int next_frame = -1;  // the start_frame that continues after this one
  v1::FrameHeader header;
  std::string bytes;
};

// Streams the frames that `request` asks for into `sink`, in order, each once. When the connection breaks or bytes
// arrive damaged, a new stream continues after the last whole frame. `on_lost`, which may be empty, gets a frame that
// the server has lost; the stream continues after it. An error of `sink` or `on_lost` ends the stream and is returned.
// Errors: Aborted when a followed job ended without success; DataLoss when frames arrive damaged again and again, or
// when the server has lost one and `on_lost` is empty.
absl::Status StreamFrames(Connection& connection, v1::StreamFramesRequest request,
                          const std::function<absl::Status(const Frame&)>& sink,
                          const std::function<absl::Status(int frame)>& on_lost = nullptr);

// Writes an output that is one file to `path`, whole or not at all, and returns its size. When the connection breaks, a
// new stream resumes where the last one stopped.
absl::StatusOr<int64_t> FetchFile(Connection& connection, const std::string& name, const std::string& path);

// The file name of a frame: its stem and the extension of its encoding. DataLoss if that is no plain file name.
absl::StatusOr<std::string> FrameFileName(const v1::FrameHeader& header);

// Renders one frame now. Errors: FailedPrecondition when the frame is not finished; InvalidArgument names the field.
absl::StatusOr<Frame> RenderFrame(Connection& connection, const v1::RenderFrameRequest& request);

absl::StatusOr<v1::ListOutputsResponse> ListOutputs(Connection& connection, const std::string& job);

struct FetchProgress {
  int frames_done = 0;   // files in the folder, over all outputs
  int frames_total = 0;  // 0 while the server does not know
  int64_t bytes = 0;     // received by this call
};

// What the server has lost of one output.
struct LostOutput {
  std::string output;       // its resource name
  std::string place;        // its file or folder in a result
  std::vector<int> frames;  // ascending; empty: it is one file
};

struct FetchSummary {
  FetchProgress progress;
  bool complete = false;         // everything a succeeded job has is in the folder
  std::vector<LostOutput> lost;  // cannot be fetched; everything else that is ready is in the folder
};

struct FetchOptions {
  // Wait for frames as a running job makes them, until it ends. Otherwise take what is ready.
  bool follow = false;
  // Replace an earlier result in the folder.
  bool replace = false;
};

// Whether a result may be fetched into `directory`: it is new, empty, or holds an unfinished fetch, or an earlier
// result that may be replaced. Errors: AlreadyExists; InvalidArgument if it is no folder, or holds a recording.
absl::Status CheckFolder(const std::string& directory, bool replace);

// Writes the result of a job into `directory` as `depthtween-core upsample` would: depth/ uncertainty/ provenance/, and
// a folder for the pictures of each render, the files byte for byte as the server stores them, then depth.txt,
// camera.json, report.json and videos. Leaves out what the server has lost and names it in the summary. `directory`
// keeps the state of an unfinished fetch, so that the next call resumes there and asks again for what was lost. With
// `replace`, removes an earlier result first, so that no frame of it survives among the new ones. Errors: those of
// CheckFolder; FailedPrecondition when `directory` holds an unfinished fetch of another job; Aborted as StreamFrames.
absl::StatusOr<FetchSummary> FetchResult(Connection& connection, const std::string& job, const std::string& directory,
                                         const FetchOptions& options,
                                         const std::function<void(const FetchProgress&)>& on_progress);

}  // namespace depthtween::client

#endif  // DEPTHTWEEN_CLIENT_LIB_FETCH_H_
