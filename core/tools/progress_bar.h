// Tells a person at a terminal how a run gets on: one line that redraws itself, or plain lines where output is not a
// terminal.
#ifndef DEPTHTWEEN_CORE_TOOLS_PROGRESS_BAR_H_
#define DEPTHTWEEN_CORE_TOOLS_PROGRESS_BAR_H_

#include <chrono>
#include <string>

#include "core/session/upsample_run.h"

namespace depthtween::tools {

struct Progress {
  int frames_done = 0, frame_count = 0;
  int intervals_done = 0, interval_count = 0;
  double seconds = 0.0;  // since the run began
  std::string stage;     // what is being done now; may be empty
};

// "[==========>         ]  50 %  frame 16/33  interval 2/4  12.5 fps  0:01 left  flow", cut to `columns` characters.
std::string FormatProgressBar(const Progress& progress, int columns);
// "16 of 33 frames, 2 of 4 intervals, 12.5 fps, 0:01 left".
std::string FormatProgressLine(const Progress& progress);

// Draws to stderr, so that stdout stays for results. Leaves the cursor at the start of an empty line when destroyed.
class ProgressBar : public RunObserver {
 public:
  explicit ProgressBar(const ClipPlan& plan);
  ~ProgressBar() override;
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void OnStage(int interval, std::string_view stage) override;
  void OnFrame(int interval, int frame) override;
  absl::Status OnIntervalDone(const IntervalReport& report) override;

 private:
  using Clock = std::chrono::steady_clock;
  void Show();

  const bool terminal_;
  const Clock::time_point start_ = Clock::now();
  Clock::time_point last_shown_ = start_;
  Progress progress_;
};

// One line on stderr that counts: redrawn on a terminal, now and then elsewhere.
class CountLine {
 public:
  // "scored", "frames": scored 3 of 8 frames.
  CountLine(std::string did, std::string what);
  ~CountLine();
  CountLine(const CountLine&) = delete;
  CountLine& operator=(const CountLine&) = delete;

  void Show(int done, int total);

 private:
  const std::string did_, what_;
  const bool terminal_;
  bool drawn_ = false;
  std::chrono::steady_clock::time_point shown_ = std::chrono::steady_clock::now();
};

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_PROGRESS_BAR_H_
