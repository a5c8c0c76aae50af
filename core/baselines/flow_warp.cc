#include "core/baselines/flow_warp.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/baselines/frame_steps.h"
#include "core/flow/dense_flow.h"
#include "core/flow/one_opencv_thread.h"
#include "opencv2/core.hpp"
#include "opencv2/video/tracking.hpp"

namespace depthtween {
namespace {

constexpr float kAgreement = 0.05F;   // of the nearer depth
constexpr int kSmallestForFlow = 16;  // DIS needs room for its 8-pixel patches at the half resolution it ends on
constexpr int kFlowsPerFrame = 4;     // two keys, both ways

// Flow from one frame to the other with the preset common in practice. Zero where the image is too small for its
// patches.
absl::StatusOr<Image<Flow2>> DisMedium(const Image<uint8_t>& from, const Image<uint8_t>& to) {
  Image<Flow2> flow(from.width(), from.height());
  if (std::min(from.width(), from.height()) < kSmallestForFlow) return flow;
  const auto as_mat = [](const Image<uint8_t>& image) {
    return cv::Mat(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.data()));  // only read
  };
  const OneOpenCvThread one_thread;
  try {
    cv::Mat out;
    cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)->calc(as_mat(from), as_mat(to), out);
    for (int y = 0; y < flow.height(); ++y) {
      const cv::Vec2f* row = out.ptr<cv::Vec2f>(y);
      for (int x = 0; x < flow.width(); ++x)
        if (std::isfinite(row[x][0]) && std::isfinite(row[x][1])) flow(x, y) = {row[x][0], row[x][1]};
    }
  } catch (const cv::Exception& e) {
    return absl::InternalError(absl::StrFormat("OpenCV's DIS flow failed: %s", e.what()));
  }
  return flow;
}

absl::StatusOr<Image<uint8_t>> ReadLuma(const FrameSource& source, int color_index) {
  ASSIGN_OR_RETURN(const Image<Rgb8> color, ReadColor(source, color_index));
  return Luma(color);
}

struct FlowPair {
  Image<Flow2> to_key, from_key;
};

// One key's estimate of one pixel.
struct Sample {
  float depth_m = 0.0F;     // 0: the flow leaves the image, or the key knows nothing there
  double log_weight = 0.0;  // exp(-e^2) itself vanishes at large errors, where the smaller one must still win
};

Sample SampleKey(ImageView<const float> key_m, const FlowPair& flow, int x, int y, double closeness) {
  const Flow2 there = flow.to_key(x, y);
  const float landing_x = static_cast<float>(x) + there.u, landing_y = static_cast<float>(y) + there.v;
  const int key_x = static_cast<int>(std::lround(landing_x)), key_y = static_cast<int>(std::lround(landing_y));
  if (!key_m.Contains(key_x, key_y)) return {};
  const Flow2 back = SampleFlow(flow.from_key, landing_x, landing_y);
  const float error_u = there.u + back.u, error_v = there.v + back.v;
  return {.depth_m = key_m(key_x, key_y),
          .log_weight = std::log(closeness) - static_cast<double>(error_u * error_u + error_v * error_v)};
}

PixelAnswer Blend(const Sample& a, const Sample& b) {
  if (a.depth_m > 0.0F && b.depth_m > 0.0F) {
    const bool agree = std::abs(a.depth_m - b.depth_m) <= kAgreement * std::min(a.depth_m, b.depth_m);
    if (!agree) return {(a.log_weight >= b.log_weight ? a : b).depth_m, Provenance::kOne};
    const double share_b = 1.0 / (1.0 + std::exp(a.log_weight - b.log_weight));
    return {static_cast<float>((1.0 - share_b) * a.depth_m + share_b * b.depth_m), Provenance::kBoth};
  }
  return {std::max(a.depth_m, b.depth_m), Provenance::kOne};
}

DepthResult WarpFrame(const KeyPair& keys, const FlowPair& before, const FlowPair& after, double tau,
                      DepthResult result, int threads) {
  const int width = result.depth_m.width();
  const NearerKey nearer(keys.before_m, keys.after_m, tau);
  ParallelRows(result.depth_m.height(), threads, [&](int first_row, int last_row) {
    for (int y = first_row; y < last_row; ++y) {
      for (int x = 0; x < width; ++x) {
        const PixelAnswer warped =
            Blend(SampleKey(keys.before_m, before, x, y, 1.0 - tau), SampleKey(keys.after_m, after, x, y, tau));
        const PixelAnswer answer = nearer.Complete(warped, static_cast<size_t>(y) * width + x);
        result.depth_m(x, y) = answer.depth_m;
        result.provenance(x, y) = answer.provenance;
      }
    }
  });
  return result;
}

}  // namespace

absl::StatusOr<IntervalSummary> FlowWarpBaseline::Run(const FrameSource& source, const ClipConstants& constants,
                                                      const Interval& interval, const RunContext& context,
                                                      const FrameSink& sink) const {
  if (interval.Held()) return HoldInterval(source, constants, interval, context, sink);
  StageRunner stages(context);
  stages.Begin("read");
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(const KeyPair keys, ReadKeys(source, interval));
  const std::array key_frames = {NearestColorFrame(sequence, keys.before_ns),
                                 NearestColorFrame(sequence, keys.after_ns)};
  std::array<Image<uint8_t>, 2> key_luma;
  for (int k = 0; k < 2; ++k) {
    ASSIGN_OR_RETURN(key_luma[k], ReadLuma(source, key_frames[k]));
  }

  // As many frames at a time as keep all threads busy.
  const int batch = (std::max(context.threads, 1) + kFlowsPerFrame - 1) / kFlowsPerFrame;
  for (int done = 0; done < interval.frame_count; done += batch) {
    const int first = interval.first_frame + done;
    const int count = std::min(batch, interval.frame_count - done);
    RETURN_IF_ERROR(stages.CheckStop());
    stages.Begin("read");
    std::vector<Image<uint8_t>> luma(count);
    for (int i = 0; i < count; ++i) {
      ASSIGN_OR_RETURN(luma[i], ReadLuma(source, first + i));
    }

    stages.Begin("flow");
    std::vector<std::array<FlowPair, 2>> flow(count);
    std::vector<absl::Status> failures(static_cast<size_t>(count) * kFlowsPerFrame);
    ParallelFor(count * kFlowsPerFrame, context.threads, [&](int item) {
      const int i = item / kFlowsPerFrame, k = item / 2 % 2;
      const bool to_key = item % 2 == 0;
      Image<Flow2>& out = to_key ? flow[i][k].to_key : flow[i][k].from_key;
      if (first + i == key_frames[k]) {
        out = Image<Flow2>(luma[i].width(), luma[i].height());  // the key's own frame does not move
        return;
      }
      auto computed = to_key ? DisMedium(luma[i], key_luma[k]) : DisMedium(key_luma[k], luma[i]);
      if (computed.ok())
        out = *std::move(computed);
      else
        failures[item] = computed.status();
    });
    for (const absl::Status& failure : failures) RETURN_IF_ERROR(failure);

    for (int i = 0; i < count; ++i) {
      stages.Begin("warp");
      const double tau = keys.Tau(sequence.color[first + i].time_ns);
      DepthResult result =
          WarpFrame(keys, flow[i][0], flow[i][1], tau, BlankResult(source, first + i), context.threads);
      PredictMeasurementNoise(constants, result);
      RETURN_IF_ERROR(sink(std::move(result)));
    }
  }
  return stages.Complete(interval.frame_count);
}

}  // namespace depthtween
