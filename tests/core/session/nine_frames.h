// A recording whose frames say by their values which they are.
#ifndef DEPTHTWEEN_TESTS_CORE_SESSION_NINE_FRAMES_H_
#define DEPTHTWEEN_TESTS_CORE_SESSION_NINE_FRAMES_H_

#include <utility>
#include <vector>

#include "core/sequence/sequence.h"

namespace depthtween {

// Nine colour frames a millisecond apart, depth with every second one stamped half a millisecond late. A frame's value
// tells which it is.
inline MemorySource NineFrames() {
  Sequence sequence{.camera = {.width = 4, .height = 4, .fx = 4, .fy = 4, .cx = 2, .cy = 2}, .depth_scale = 1000};
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (int i = 0; i < 9; ++i) {
    sequence.color.push_back({i * 1'000'000, "c"});
    color.emplace_back(4, 4, Rgb8{static_cast<uint8_t>(i), 0, 0});
    if (i % 2 != 0) continue;
    sequence.depth.push_back({i * 1'000'000 + 500'000, "d"});
    depth_m.emplace_back(4, 4, 1.0F + static_cast<float>(i));
  }
  return {std::move(sequence), std::move(color), std::move(depth_m)};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_CORE_SESSION_NINE_FRAMES_H_
