#include "client/cli/progress_line.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace depthtween::cli {
namespace {

constexpr int kBarCells = 24;
constexpr std::chrono::milliseconds kRedraw{100};
constexpr std::chrono::seconds kPlainLine{5};

int TerminalColumns() {
  winsize size{};
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) return 80;
  return size.ws_col;
}

}  // namespace

std::string FormatProgressLine(const std::string& what, double fraction, const std::string& facts, int columns) {
  const double share = std::clamp(fraction, 0.0, 1.0);
  const int cells = static_cast<int>(share * kBarCells);
  std::string bar(cells, '=');
  if (cells < kBarCells) bar += '>';
  bar.resize(kBarCells, ' ');
  // Floor: 100 % means that nothing is left.
  std::string line =
      absl::StrFormat("[%s] %3d %%  %s  %s", bar, static_cast<int>(std::floor(share * 100)), what, facts);
  if (static_cast<int>(line.size()) > columns) line.resize(std::max(columns, 0));
  return line;
}

ProgressLine::ProgressLine(std::string what) : what_(std::move(what)), terminal_(isatty(STDERR_FILENO) == 1) {}

ProgressLine::~ProgressLine() {
  if (!shown_) Draw();
  if (terminal_ && drawn_) std::cerr << std::endl;
}

void ProgressLine::Show(double fraction, const std::string& facts) {
  if (fraction == fraction_ && facts == facts_ && drawn_) return;
  fraction_ = fraction;
  facts_ = facts;
  shown_ = false;
  const Clock::duration pause = terminal_ ? Clock::duration(kRedraw) : Clock::duration(kPlainLine);
  if (Clock::now() - last_drawn_ >= pause) Draw();
}

void ProgressLine::Say(const std::string& text) {
  if (terminal_ && drawn_) std::cerr << "\r\x1b[K";
  std::cerr << text << std::flush;
  if (terminal_ && drawn_) Draw();
}

void ProgressLine::Draw() {
  if (terminal_) {
    // One column less than there are: a full line would make some terminals wrap.
    std::cerr << "\r" << FormatProgressLine(what_, fraction_, facts_, TerminalColumns() - 1) << "\x1b[K" << std::flush;
  } else {
    std::cerr << what_ << ": " << facts_ << std::endl;
  }
  shown_ = drawn_ = true;
  last_drawn_ = Clock::now();
}

}  // namespace depthtween::cli
