// The folder an upsampling leaves: for every colour frame depth/ uncertainty/ provenance/<stem>.png, then depth.txt,
// camera.json and report.json. Depth and list are those of a sequence folder, so a result drops back into the same
// tools. Where it was asked for there is also motion/<stem>.npz, from which renderers learn what other frames show.
//
// Stored depth is the result: what is read back is what every reader of the folder sees, bit for bit.
#ifndef DEPTHTWEEN_CORE_IO_RESULT_FOLDER_H_
#define DEPTHTWEEN_CORE_IO_RESULT_FOLDER_H_

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/sequence/depth_result.h"
#include "core/sequence/sequence.h"

namespace depthtween {

// Where a frame's files lie, relative to the result folder.
std::string ResultDepthName(const std::string& stem);
std::string ResultUncertaintyName(const std::string& stem);
std::string ResultProvenanceName(const std::string& stem);
std::string ResultMotionName(const std::string& stem);

// Writes one frame durably; its folders must exist (ResultWriter::Create makes them). Depth is written last: a frame
// whose depth file is there is whole. Motion is written if the result has it. Errors: InvalidArgument when the images
// differ in size; ResourceExhausted when the disk is full. Threads: safe to call concurrently for different stems.
absl::Status WriteResultFrame(const std::string& dir, const std::string& stem, double depth_scale,
                              const DepthResult& result);

// The inverse; color_index is -1, motion stays empty. Errors: NotFound; DataLoss when files are damaged or disagree in
// size.
absl::StatusOr<DepthResult> ReadResultFrame(const std::string& dir, const std::string& stem, double depth_scale);

// The depth of one frame alone. Errors as ReadResultFrame.
absl::StatusOr<Image<float>> ReadResultDepth(const std::string& dir, const std::string& stem, double depth_scale);

// Pixels from one colour frame to the next, and from there back.
struct FrameMotion {
  Image<Flow2> next, back;
};
// Arrays `next` and `back`, H x W x 2, half floats: u, v in whole 32nds of a pixel, as fine as halves are at 64 pixels,
// so that most of their bits are zero and deflate finds that.
absl::StatusOr<std::string> EncodeMotion(ImageView<const Flow2> next, ImageView<const Flow2> back);
// NotFound for a frame without motion: it was not asked for, or the frame is held, or the last one. DataLoss when the
// file is damaged.
absl::StatusOr<FrameMotion> ReadResultMotion(const std::string& dir, const std::string& stem);

// Create Write* Finish  - or, with several processes on one folder: each does Create Write*, and one more, when all are
// done, Create Finish.
class ResultWriter {
 public:
  // Makes the folders; those of an earlier or a concurrent writer are kept. `sequence` is the input, after any
  // thinning.
  static absl::StatusOr<ResultWriter> Create(const std::string& dir, const Sequence& sequence,
                                             bool with_motion = false);

  // WriteResultFrame under the stem of sequence.color[result.color_index]. InvalidArgument when there is no such frame,
  // or when its size is not the camera's.
  absl::Status Write(const DepthResult& result) const;

  // Writes depth.txt, camera.json and, last, report.json: a folder with a report is whole.
  // FailedPrecondition names the first frame that has not been written.
  absl::Status Finish(const nlohmann::json& report) const;

  const std::string& dir() const { return dir_; }

 private:
  ResultWriter(std::string dir, Sequence sequence) : dir_(std::move(dir)), sequence_(std::move(sequence)) {}

  std::string dir_;
  Sequence sequence_;
};

// A finished result, frames decoded on demand. Threads: safe to call concurrently.
class ResultFolder {
 public:
  // FailedPrecondition when there is no report yet; else errors as of ReadSequenceHeader.
  static absl::StatusOr<ResultFolder> Open(const std::string& dir);

  const std::string& dir() const { return dir_; }
  const Camera& camera() const { return camera_; }
  double depth_scale() const { return depth_scale_; }
  // One per colour frame of the input, ascending in time.
  const std::vector<FrameRef>& frames() const { return frames_; }
  const nlohmann::json& report() const { return report_; }

  // Metres, 0 = unknown.
  absl::StatusOr<Image<float>> Depth(int index) const;
  // Metres, 0 = unknown.
  absl::StatusOr<Image<float>> Sigma(int index) const;
  absl::StatusOr<Image<Provenance>> ProvenanceAt(int index) const;

 private:
  ResultFolder() = default;

  std::string dir_;
  Camera camera_;
  double depth_scale_ = 0.0;
  std::vector<FrameRef> frames_;
  nlohmann::json report_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_RESULT_FOLDER_H_
