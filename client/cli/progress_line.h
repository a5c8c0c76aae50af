// Progress for a person at a terminal: one line that redraws itself, or an occasional plain line where stderr is not a
// terminal.
#ifndef DEPTHTWEEN_CLIENT_CLI_PROGRESS_LINE_H_
#define DEPTHTWEEN_CLIENT_CLI_PROGRESS_LINE_H_

#include <chrono>
#include <string>

namespace depthtween::cli {

// "[=====>    ]  50 %  upload  1.2 MB of 2.4 MB", cut to `columns` characters.
std::string FormatProgressLine(const std::string& what, double fraction, const std::string& facts, int columns);

class ProgressLine {
 public:
  // `what` is being done: "upload".
  explicit ProgressLine(std::string what);
  // Shows the last state if it is not on the screen yet, and leaves the cursor at the start of an empty line.
  ~ProgressLine();
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // `fraction` from 0 to 1. May be called at any rate: it limits how often it draws.
  void Show(double fraction, const std::string& facts);
  // Prints lines above this one, at once. `text` ends with a newline.
  void Say(const std::string& text);

 private:
  using Clock = std::chrono::steady_clock;
  void Draw();

  const std::string what_;
  const bool terminal_;
  double fraction_ = 0.0;
  std::string facts_;
  bool shown_ = true;  // the last state is on the screen
  bool drawn_ = false;
  Clock::time_point last_drawn_ = Clock::now();
};

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_PROGRESS_LINE_H_
