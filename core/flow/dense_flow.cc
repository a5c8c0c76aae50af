#include "core/flow/dense_flow.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "core/flow/one_opencv_thread.h"
#include "opencv2/core.hpp"
#include "opencv2/video/tracking.hpp"

namespace depthtween {

static_assert(sizeof(Flow2) == sizeof(cv::Vec2f), "Flow2 is read and written as two floats");

namespace {

// OpenCV's object holds a pyramid of buffers, and mapping them anew for each call can take as long as the flow itself:
// each thread keeps its own. An object used with a start allocates again when called without one, so there are two.
// Results do not depend on earlier calls.
cv::DISOpticalFlow& ThreadsOwnFlow(bool with_start) {
  thread_local cv::Ptr<cv::DISOpticalFlow> own[2];
  cv::Ptr<cv::DISOpticalFlow>& flow = own[with_start ? 1 : 0];
  if (!flow) flow = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  return *flow;
}

}  // namespace

absl::Status DenseFlowOptions::Validate() const {
  const auto error = [](const char* field, int value, const char* rule) {
    return absl::InvalidArgumentError(absl::StrFormat("DenseFlowOptions.%s = %d, must be %s", field, value, rule));
  };
  if (finest_scale < 0 || finest_scale > 5) return error("finest_scale", finest_scale, "between 0 and 5");
  if (patch_stride < 1 || patch_stride > 8)
    return error("patch_stride", patch_stride, "between 1 and 8 (the patch size)");
  if (descent_iterations < 1) return error("descent_iterations", descent_iterations, "> 0");
  if (refinement_iterations < 0) return error("refinement_iterations", refinement_iterations, ">= 0");
  return absl::OkStatus();
}

Image<uint8_t> Luma(ImageView<const Rgb8> color) {
  Image<uint8_t> luma(color.width(), color.height());
  for (int y = 0; y < color.height(); ++y) {
    const Rgb8* in = color.row(y);
    uint8_t* out = luma.row(y);
    for (int x = 0; x < color.width(); ++x)
      out[x] = static_cast<uint8_t>((4899 * in[x].r + 9617 * in[x].g + 1868 * in[x].b + 8192) >> 14);
  }
  return luma;
}

absl::StatusOr<Image<Flow2>> DenseFlow(ImageView<const uint8_t> from, ImageView<const uint8_t> to,
                                       const DenseFlowOptions& options, const Image<Flow2>* start) {
  RETURN_IF_ERROR(options.Validate());
  if (!from.SameSize(to))
    return absl::InvalidArgumentError(absl::StrFormat("flow between images of %d x %d and %d x %d, must be of one size",
                                                      from.width(), from.height(), to.width(), to.height()));
  Image<Flow2> flow = start != nullptr ? start->Clone() : Image<Flow2>(from.width(), from.height());
  if (from.width() < 16 || from.height() < 16) return flow;
  const OneOpenCvThread one_thread;
  try {
    cv::DISOpticalFlow& dis = ThreadsOwnFlow(start != nullptr);
    dis.setFinestScale(options.finest_scale);
    dis.setPatchStride(options.patch_stride);
    dis.setGradientDescentIterations(options.descent_iterations);
    dis.setVariationalRefinementIterations(options.refinement_iterations);
    const auto mat = [](ImageView<const uint8_t> v) {
      return cv::Mat(v.height(), v.width(), CV_8UC1, const_cast<uint8_t*>(v.data()), v.stride());
    };
    cv::Mat result(flow.height(), flow.width(), CV_32FC2, flow.data());
    if (start == nullptr) result = cv::Mat();
    dis.calc(mat(from), mat(to), result);
    if (reinterpret_cast<const Flow2*>(result.data) != flow.data())
      for (int y = 0; y < flow.height(); ++y) std::copy_n(result.ptr<Flow2>(y), flow.width(), flow.row(y));
  } catch (const cv::Exception& e) {
    return absl::InternalError(absl::StrCat("dense flow failed in OpenCV: ", e.what()));
  }
  // A flat image has no gradient to divide by; no NaN leaves a stage.
  for (size_t i = 0; i < flow.pixel_count(); ++i) {
    Flow2& f = flow.data()[i];
    if (!std::isfinite(f.u) || !std::isfinite(f.v)) f = {};
  }
  return flow;
}

Flow2 SampleFlow(ImageView<const Flow2> flow, float x, float y) {
  x = std::clamp(x, 0.0F, static_cast<float>(flow.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(flow.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, flow.width() - 1), y1 = std::min(y0 + 1, flow.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  const Flow2 a = flow(x0, y0), b = flow(x1, y0), c = flow(x0, y1), d = flow(x1, y1);
  return {w00 * a.u + w10 * b.u + w01 * c.u + w11 * d.u, w00 * a.v + w10 * b.v + w01 * c.v + w11 * d.v};
}

Image<Flow2> Compose(ImageView<const Flow2> ab, ImageView<const Flow2> bc, int step) {
  Image<Flow2> ac(ab.width(), ab.height());
  for (int y = 0; y < ab.height(); ++y)
    for (int x = 0; x < ab.width(); ++x) {
      const Flow2 first = ab(x, y);
      const Flow2 second =
          SampleFlow(bc, static_cast<float>(x * step) + first.u, static_cast<float>(y * step) + first.v);
      ac(x, y) = {first.u + second.u, first.v + second.v};
    }
  return ac;
}

Flow2 FollowFlows(const std::vector<ImageView<const Flow2>>& steps, int x, int y) {
  Flow2 motion = steps[0](x, y);
  for (size_t i = 1; i < steps.size(); ++i) {
    const Flow2 next = SampleFlow(steps[i], static_cast<float>(x) + motion.u, static_cast<float>(y) + motion.v);
    motion = {motion.u + next.u, motion.v + next.v};
  }
  return motion;
}

}  // namespace depthtween
