// What a person is told while a run goes on.
#include "core/tools/progress_bar.h"

#include <gtest/gtest.h>

namespace depthtween::tools {
namespace {

TEST(Progress, LineSaysWhatIsDoneAndWhatIsLeft) {
  const Progress progress{
      .frames_done = 16, .frame_count = 64, .intervals_done = 2, .interval_count = 8, .seconds = 4.0, .stage = "flow"};
  EXPECT_EQ(FormatProgressBar(progress, 200),
            "[=====>              ]  25 %  frame 16/64  interval 3/8  4.0 fps  0:12 left  flow");
  EXPECT_EQ(FormatProgressBar(progress, 20).size(), 20U);
  EXPECT_EQ(FormatProgressLine(progress), "16 of 64 frames, 2 of 8 intervals, 4.0 fps, 0:12 left");
  // Before the first frame there is no speed to tell, and none is invented.
  EXPECT_EQ(FormatProgressLine({.frame_count = 64, .interval_count = 8, .seconds = 1.0}),
            "0 of 64 frames, 0 of 8 intervals");
}

}  // namespace
}  // namespace depthtween::tools
