// Any bytes as rgb.txt: problems and frames; every frame's name is safe, and the frames are written and read to
// themselves.
#include "core/io/frame_list.h"

#include <cstdlib>

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const FrameList list = ParseFrameList({reinterpret_cast<const char*>(data), size});
  for (const FrameRef& frame : list.frames) {
    if (!CheckFrameName(frame.path).ok()) std::abort();
  }
  const FrameList again = ParseFrameList(FormatFrameList(list.frames));
  if (!again.problems.empty() || again.frames.size() != list.frames.size()) std::abort();
  for (size_t i = 0; i < list.frames.size(); ++i) {
    if (again.frames[i].time_ns != list.frames[i].time_ns || again.frames[i].path != list.frames[i].path) std::abort();
  }
  return 0;
}
