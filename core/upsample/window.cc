#include "core/upsample/window.h"

#include <algorithm>

#include "core/flow/dense_flow.h"

namespace depthtween {

int Window::ThreadsPerTarget(int threads) const { return std::max(1, threads / std::max(1, target_count)); }

absl::StatusOr<Window> ReadWindow(const FrameSource& source, const Interval& interval, const StageRunner& run) {
  const Sequence& sequence = source.sequence();
  const std::array<int, 2> depth_index = {interval.key_before, interval.key_after};
  Window window;
  int first = interval.first_frame, last = interval.first_frame + interval.frame_count - 1;
  for (int side = 0; side < 2; ++side) {
    const Key& key = window.located[side] = LocateKey(sequence, depth_index[side]);
    for (const int index : {key.color_index, key.toward})
      if (index >= 0) first = std::min(first, index), last = std::max(last, index);
  }
  window.first = first;
  window.first_target = interval.first_frame - first;
  window.target_count = interval.frame_count;

  const int count = last - first + 1;
  const int64_t begin_ns = window.located[0].time_ns, end_ns = window.located[1].time_ns;
  for (int i = 0; i < count; ++i) {
    const auto since = static_cast<double>(sequence.color[first + i].time_ns - begin_ns);
    window.tau.push_back(static_cast<float>(std::clamp(since / static_cast<double>(end_ns - begin_ns), 0.0, 1.0)));
  }
  window.color.resize(count);
  window.luma.resize(count);
  RETURN_IF_ERROR(run.SideBySide(count + 2, [&](int i) -> absl::Status {
    if (i < 2) {
      ASSIGN_OR_RETURN(window.measured_m[i], ReadDepthFrame(source, depth_index[i]));
      return absl::OkStatus();
    }
    ASSIGN_OR_RETURN(window.color[i - 2], source.Color(first + i - 2));
    window.luma[i - 2] = Luma(window.color[i - 2]);
    return absl::OkStatus();
  }));
  return window;
}

}  // namespace depthtween
