// Seconds per 8-frame interval of the pipeline, whole and by stage, beside 16 dense flows of OpenCV's DIS (preset
// medium) timed in the same run: absolute times drift with the machine, the ratio does not.
//
// Scene: `kick`, 17 colour frames, 512 x 424, seed 1, Kinect-like noise, rendered into memory first. For 1 and 2
// threads, `rounds` times in turn: the interval, then the flows (as many at a time as there are threads). Medians are
// printed.
//
// Usage: interval_bench [rounds, default 5]
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "core/flow/dense_flow.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/pipeline.h"
#include "opencv2/core.hpp"
#include "opencv2/video/tracking.hpp"
#include "tests/bench/timing.h"

namespace depthtween {
namespace {

absl::StatusOr<std::unique_ptr<MemorySource>> RenderClip() {
  SyntheticOptions options;
  options.scene = "kick";
  options.frames = 17;
  ASSIGN_OR_RETURN(const auto rendered, SyntheticSequence::Create(options, AvailableThreads()));
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth;
  for (size_t i = 0; i < rendered->sequence().color.size(); ++i) {
    ASSIGN_OR_RETURN(color.emplace_back(), rendered->Color(static_cast<int>(i)));
  }
  for (size_t k = 0; k < rendered->sequence().depth.size(); ++k) {
    ASSIGN_OR_RETURN(depth.emplace_back(), rendered->Depth(static_cast<int>(k)));
  }
  return std::make_unique<MemorySource>(rendered->sequence(), std::move(color), std::move(depth));
}

// The yardstick: both directions between the nine colour frames of an interval.
double SixteenFlows(const std::vector<Image<uint8_t>>& luma, int threads) {
  return Seconds([&] {
    ParallelFor(16, threads, [&](int i) {
      const auto mat = [&](int frame) {
        const Image<uint8_t>& image = luma[frame];
        return cv::Mat(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.data()));
      };
      const int pair = i / 2;
      cv::Mat flow;
      cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)
          ->calc(mat(pair + i % 2), mat(pair + 1 - i % 2), flow);
    });
  });
}

absl::Status Run(int rounds) {
  ASSIGN_OR_RETURN(const auto clip, RenderClip());
  const MemorySource& source = *clip;
  ASSIGN_OR_RETURN(const ClipConstants constants, EstimateClipConstants(source));
  const Interval interval = PlanIntervals(source.sequence())[0];
  std::vector<Image<uint8_t>> luma;
  for (int i = 0; i < 9; ++i) {
    ASSIGN_OR_RETURN(const Image<Rgb8> color, source.Color(i));
    luma.push_back(Luma(color));
  }
  const auto pipeline = MakePipeline();
  std::printf("kick, 512 x 424, interval of %d frames, %d rounds, medians\n\n", interval.frame_count, rounds);
  std::printf("| threads | interval, s | 16 DIS flows, s | ratio | stages, s |\n|---|---|---|---|---|\n");
  for (const int threads : {1, 2}) {
    std::vector<double> whole, flows, ratios;
    std::map<std::string, std::vector<double>> stages;
    for (int round = 0; round <= rounds; ++round) {
      absl::Status status;
      const double seconds = Seconds([&] {
        const auto summary = pipeline->Run(source, constants, interval, {.threads = threads},
                                           [](const DepthResult&) { return absl::OkStatus(); });
        status = summary.status();
        if (!status.ok() || round == 0) return;
        for (const auto& [stage, stage_seconds] : summary->stage_seconds) stages[stage].push_back(stage_seconds);
      });
      RETURN_IF_ERROR(status);
      const double yardstick = SixteenFlows(luma, threads);
      if (round == 0) continue;  // warms caches and thread pools
      whole.push_back(seconds);
      flows.push_back(yardstick);
      ratios.push_back(seconds / yardstick);
    }
    std::string by_stage;
    for (const auto& [stage, seconds] : stages) {
      char text[64];
      std::snprintf(text, sizeof(text), "%s%s %.3f", by_stage.empty() ? "" : ", ", stage.c_str(), Median(seconds));
      by_stage += text;
    }
    std::printf("| %d | %.3f | %.3f | %.2f | %s |\n", threads, Median(whole), Median(flows), Median(ratios),
                by_stage.c_str());
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  const int rounds = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  const absl::Status status = depthtween::Run(rounds);
  if (!status.ok()) std::fprintf(stderr, "interval_bench: %s\n", std::string(status.message()).c_str());
  return status.ok() ? 0 : 1;
}
