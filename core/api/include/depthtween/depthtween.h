// Depthtween as a library: depth for every colour frame, from colour frames at a high rate and depth frames at a low
// one.
//
//   depthtween::DepthStream stream(camera, options, [](const depthtween::DepthStream::Frame& frame) {
//     Use(frame.depth_m);   // metres, one for each pixel of the colour frame
//     return true;
//   });
//   ... stream.PushColor(time_ns, pixels, row_bytes, layout); stream.PushDepth(time_ns, pixels, row_bytes); ...
//   const depthtween::Status status = stream.Finish();
//
// Grammar of use:  (PushColor | PushDepth)* Finish
//
// Order:    stamps ascend in each of the two streams; how the streams interleave does not matter, and depth does not
//           depend on it. Both carry stamps of one clock, nanoseconds. A depth frame that was taken together with a
//           colour frame has the same stamp as that.
// Images:   depth is registered to colour: one camera, one size. Rows from top to bottom, `row_bytes` bytes apart;
//           pixels are copied before a push returns.
// Results:  one call of the callback for each colour frame, in time order, from inside a push or Finish, on the thread
//           that called it. Frames come as soon as everything that decides them was pushed: with preset "balanced" the
//           depth frame after them and three more (preset "fast": one more), with `causal` the depth frame after them.
//           Finish delivers the rest. Colour frames before the first and after the last depth frame have that frame's.
// Memory:   the frames from four depth frames before the interval being computed to those it waits for, while neither
//           stream runs ahead of the other; the frames of the one that does wait. See Options::noise_frames for the
//           beginning. Freed images are kept for the next ones, up to a limit for the process.
// Errors:   values, never exceptions. A push that returns InvalidArgument took nothing, and the stream goes on. Any
//           other error ends it: all later calls return it again. A wrong camera or option is returned by every call.
// Threads:  one stream is used by one thread at a time (but Cancel by any); streams run side by side. While a stream
//           computes, OpenCV runs on one thread in the whole process (cv::setNumThreads); afterwards as it did before.
#ifndef DEPTHTWEEN_DEPTHTWEEN_H_
#define DEPTHTWEEN_DEPTHTWEEN_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace depthtween {

// Whether something went well, and if not, why.
class [[nodiscard]] Status {
 public:
  enum class Code {
    kOk,
    kCancelled,           // by Cancel, or the callback returned false
    kInvalidArgument,     // the message names field, value and rule
    kFailedPrecondition,  // not the time for this call
    kResourceExhausted,   // memory, or a limit
    kInternal,            // a fault of this library
  };
  Status() = default;
  Status(Code code, std::string message) : code_(code), message_(std::move(message)) {}
  bool ok() const { return code_ == Code::kOk; }
  Code code() const { return code_; }
  const std::string& message() const { return message_; }

 private:
  Code code_ = Code::kOk;
  std::string message_;
};

class DepthStream {
 public:
  // A pinhole camera with Brown-Conrady distortion, as in OpenCV. The integer coordinate is the centre of a pixel.
  struct Camera {
    int width = 0, height = 0;                      // pixels
    double fx = 0, fy = 0, cx = 0, cy = 0;          // pixels
    double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;  // 0: no distortion
    double depth_scale = 1000;                      // units of 16-bit depth per metre
  };

  // As of `depthtween-core upsample`, whose help explains them.
  struct Options {
    std::string method = "ours";
    std::string preset = "balanced";
    bool causal = false;  // each frame from what had been seen by then alone
    std::vector<std::string> without;
    std::string fill = "near";     // how far depth is inferred: all, near or none
    std::string clock = "stamps";  // or "OFFSET_MS[,DRIFT_PPM]" of the depth camera's clock

    int threads = 0;  // does not change depth; 0: one for each processor
    // The sensor's noise is measured on the first so many depth frames, for which the stream waits. 0: on samples of
    // the whole recording; then all frames are held in memory until Finish, stamps are compared over the recording as
    // the program does, and depth is that of `depthtween-core upsample` to the last bit. With `causal`, the first depth
    // frame alone decides unless this is 0.
    int noise_frames = 4;
  };
  // Options from a JSON object with the names above; what is left out stays as it is in `options`.
  static Status ParseOptions(std::string_view json, Options& options);

  // Where a pixel's depth comes from.
  enum class Provenance : uint8_t {
    kNone = 0,      // no answer: depth 0
    kMeasured = 1,  // this frame coincides with a depth frame, and the sensor saw this pixel
    kBoth = 2,      // seen from the depth frames before and after
    kOne = 3,       // seen from one of them
    kInferred = 4,  // seen from neither: filled from the same layer
    kHeld = 5,      // before the first or after the last depth frame: that frame, unmoved
  };

  // Depth of one colour frame: width x height values each, rows one after another. Valid during the callback.
  struct Frame {
    int64_t time_ns = 0;  // the colour frame's stamp
    int width = 0, height = 0;
    const float* depth_m = nullptr;  // metres along z; 0 = unknown
    const float* sigma_m = nullptr;  // predicted standard deviation, metres; 0 where depth is unknown
    const Provenance* provenance = nullptr;
  };
  // Returns whether to go on.
  using Callback = std::function<bool(const Frame& frame)>;

  DepthStream(const Camera& camera, const Options& options, Callback callback);
  ~DepthStream();
  DepthStream(DepthStream&&) noexcept;
  DepthStream& operator=(DepthStream&&) noexcept;

  // 8-bit sRGB samples of a pixel, in memory order. The fourth is ignored.
  enum class Layout { kGray, kRgb, kBgr, kRgba, kBgra };
  Status PushColor(int64_t time_ns, const uint8_t* pixels, ptrdiff_t row_bytes, Layout layout = Layout::kRgb);
  // 16-bit units of camera.depth_scale, or metres; 0 = unknown, and so is what is not a positive, finite number.
  Status PushDepth(int64_t time_ns, const uint16_t* units, ptrdiff_t row_bytes);
  Status PushDepth(int64_t time_ns, const float* metres, ptrdiff_t row_bytes);
  // Computes and delivers what is left. FailedPrecondition if no depth or no colour frame came.
  Status Finish();

  // From any thread: ends the computation under way, and the stream, with kCancelled.
  void Cancel();
  // Facts worth telling the user, such as an implausible depth_scale. Known from the first frame delivered on.
  const std::vector<std::string>& warnings() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_DEPTHTWEEN_H_
