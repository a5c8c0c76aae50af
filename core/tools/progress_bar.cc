#include "core/tools/progress_bar.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/tools/freed_memory.h"

namespace depthtween::tools {
namespace {

constexpr int kBarCells = 20;                           // all but a long stage name fits 80 columns
constexpr std::chrono::milliseconds kRedraw{100};       // faster than this only flickers
constexpr auto kLineEvery = std::chrono::seconds(2);    // a log is read later: few lines
constexpr std::chrono::milliseconds kCountEvery{5000};  // likewise

int TerminalColumns() {
  winsize size = {};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

std::string MinutesSeconds(double seconds) {
  const auto whole = static_cast<int64_t>(std::ceil(seconds));
  return absl::StrFormat("%d:%02d", whole / 60, whole % 60);
}

// Speed and what it implies for the rest: empty until there is a frame to measure by.
std::string Pace(const Progress& progress, const char* separator) {
  if (progress.frames_done == 0 || progress.seconds <= 0) return "";
  const double fps = progress.frames_done / progress.seconds;
  std::string pace = absl::StrFormat("%s%.1f fps", separator, fps);
  const int frames_left = progress.frame_count - progress.frames_done;
  if (frames_left > 0) absl::StrAppend(&pace, separator, MinutesSeconds(frames_left / fps), " left");
  return pace;
}

}  // namespace

std::string FormatProgressBar(const Progress& progress, int columns) {
  const double fraction =
      progress.frame_count > 0 ? static_cast<double>(progress.frames_done) / progress.frame_count : 0.0;
  const int filled = static_cast<int>(fraction * kBarCells);
  std::string bar(filled, '=');
  if (filled < kBarCells) bar += '>';
  bar.resize(kBarCells, ' ');
  const int interval = std::min(progress.intervals_done + 1, progress.interval_count);
  std::string line = absl::StrFormat("[%s] %3d %%  frame %d/%d  interval %d/%d%s", bar,
                                     static_cast<int>(fraction * 100), progress.frames_done, progress.frame_count,
                                     interval, progress.interval_count, Pace(progress, "  "));
  if (!progress.stage.empty()) absl::StrAppend(&line, "  ", progress.stage);
  if (static_cast<int>(line.size()) > columns) line.resize(std::max(columns, 0));
  return line;
}

std::string FormatProgressLine(const Progress& progress) {
  return absl::StrFormat("%d of %d frames, %d of %d intervals%s", progress.frames_done, progress.frame_count,
                         progress.intervals_done, progress.interval_count, Pace(progress, ", "));
}

ProgressBar::ProgressBar(const ClipPlan& plan) : terminal_(isatty(STDERR_FILENO) == 1) {
  progress_.interval_count = static_cast<int>(plan.intervals.size());
  for (const Interval& interval : plan.intervals) progress_.frame_count += interval.frame_count;
}

ProgressBar::~ProgressBar() {
  if (terminal_) std::fputs("\r\x1b[K", stderr);
}

void ProgressBar::OnStage(int, std::string_view stage) {
  progress_.stage = stage;
  if (terminal_) Show();
}

void ProgressBar::OnFrame(int, int) {
  ++progress_.frames_done;
  if (terminal_) Show();
}

absl::Status ProgressBar::OnIntervalDone(const IntervalReport&) {
  ++progress_.intervals_done;
  progress_.stage.clear();
  Show();
  ReturnFreedMemory();
  return absl::OkStatus();
}

void ProgressBar::Show() {
  const auto now = Clock::now();
  const bool last = progress_.intervals_done == progress_.interval_count;
  const auto pause = terminal_ ? std::chrono::duration_cast<Clock::duration>(kRedraw) : kLineEvery;
  if (now - last_shown_ < pause && !last) return;
  last_shown_ = now;
  progress_.seconds = std::chrono::duration<double>(now - start_).count();
  // One column stays free: a line that fills the terminal wraps, and then \r no longer returns to its start.
  if (terminal_)
    std::fprintf(stderr, "\r%s\x1b[K", FormatProgressBar(progress_, TerminalColumns() - 1).c_str());
  else
    std::fprintf(stderr, "%s\n", FormatProgressLine(progress_).c_str());
}

CountLine::CountLine(std::string did, std::string what)
    : did_(std::move(did)), what_(std::move(what)), terminal_(isatty(STDERR_FILENO) == 1) {}

CountLine::~CountLine() {
  if (terminal_ && drawn_) std::fputs("\r\x1b[K", stderr);
}

void CountLine::Show(int done, int total) {
  const auto now = std::chrono::steady_clock::now();
  if (now - shown_ < (terminal_ ? kRedraw : kCountEvery)) return;
  shown_ = now;
  drawn_ = true;
  std::fprintf(stderr, terminal_ ? "\r%s %d of %d %s\x1b[K" : "%s %d of %d %s\n", did_.c_str(), done, total,
               what_.c_str());
}

}  // namespace depthtween::tools
