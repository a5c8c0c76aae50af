// Scenes of the library for tests of upsampling: rendered once, with exact truth.
#ifndef DEPTHTWEEN_TESTS_CORE_UPSAMPLE_RENDERED_CLIP_H_
#define DEPTHTWEEN_TESTS_CORE_UPSAMPLE_RENDERED_CLIP_H_

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/upsampler.h"
#include "gtest/gtest.h"

namespace depthtween {

// A recording of a scene in memory: methods read a frame many times, and rendering it is slow.
class RenderedClip {
 public:
  explicit RenderedClip(const SyntheticOptions& options) {
    auto rendered = SyntheticSequence::Create(options, 2);
    EXPECT_TRUE(rendered.ok()) << rendered.status();
    scene_ = *std::move(rendered);
    std::vector<Image<Rgb8>> color;
    std::vector<Image<float>> depth_m;
    for (int i = 0; i < static_cast<int>(scene_->sequence().color.size()); ++i) {
      color.push_back(*scene_->Color(i));
      truth_m_.push_back(scene_->ColorView(i).Surface(2).depth_m.Clone());
    }
    for (int k = 0; k < static_cast<int>(scene_->sequence().depth.size()); ++k) depth_m.push_back(*scene_->Depth(k));
    source_ = std::make_unique<MemorySource>(scene_->sequence(), std::move(color), std::move(depth_m));
  }

  const FrameSource& source() const { return *source_; }
  // Of a colour frame.
  const Image<float>& truth_m(int index) const { return truth_m_[index]; }

 private:
  std::unique_ptr<SyntheticSequence> scene_;
  std::unique_ptr<MemorySource> source_;
  std::vector<Image<float>> truth_m_;
};

enum class Unfilled { kCountsAsError, kIsLeftOut };

// Over all frames and all pixels with truth.
inline double RmseM(const Upsampler& method, const RenderedClip& clip, const ClipConstants& constants,
                    Unfilled unfilled) {
  double sum = 0, count = 0;
  for (const Interval& interval : PlanIntervals(clip.source().sequence())) {
    const auto summary = method.Run(clip.source(), constants, interval, {.threads = 2}, [&](const DepthResult& result) {
      const Image<float>& truth_m = clip.truth_m(result.color_index);
      for (size_t i = 0; i < truth_m.pixel_count(); ++i) {
        const float z = result.depth_m.data()[i];
        if (truth_m.data()[i] <= 0 || (z <= 0 && unfilled == Unfilled::kIsLeftOut)) continue;
        sum += std::pow(z - truth_m.data()[i], 2);
        ++count;
      }
      return absl::OkStatus();
    });
    EXPECT_TRUE(summary.ok()) << summary.status();
  }
  return std::sqrt(sum / count);
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_UPSAMPLE_RENDERED_CLIP_H_
