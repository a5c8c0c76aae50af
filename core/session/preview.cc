#include "core/session/preview.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

// Matrices here hold RGB, as Rgb8 does; OpenCV's drawing does not care what the channels mean.
using Color = cv::Scalar;
const Color kBackground(24, 24, 28);
const Color kText(235, 235, 235);
const Color kFaint(150, 150, 158);
const Color kKeyColor(120, 220, 140);
const Color kHeldColor(255, 176, 64);
constexpr Rgb8 kUnknown{56, 56, 60};

constexpr double kSigmaMin_m = 0.001, kSigmaMax_m = 1.0;

constexpr int kMargin = 12;        // around everything
constexpr int kGap = 16;           // between panels
constexpr int kTitleHeight = 30;   // a line of text above panels
constexpr int kLegendHeight = 52;  // bar, ticks and their labels
constexpr int kBarHeight = 12;
constexpr int kVideoPanelMin = 400,
              kVideoPanelMax = 640;    // three fit a full-HD screen; smaller ones leave labels no room
constexpr int kSheetPanelWidth = 300;  // five fit the width of a README
constexpr double kFontScale = 0.5;
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

using Palette = std::array<Rgb8, 256>;

Palette MakePalette(int map) {
  cv::Mat ramp(1, 256, CV_8UC1), bgr;
  for (int i = 0; i < 256; ++i) ramp.at<uint8_t>(i) = static_cast<uint8_t>(i);
  cv::applyColorMap(ramp, bgr, map);
  Palette palette;
  for (int i = 0; i < 256; ++i) {
    const auto& entry = bgr.at<cv::Vec3b>(i);
    palette[i] = {entry[2], entry[1], entry[0]};
  }
  return palette;
}

Rgb8 At(const Palette& palette, double fraction) {
  return palette[static_cast<size_t>(std::lround(std::clamp(fraction, 0.0, 1.0) * 255))];
}

// Where a depth lies between the ends of the range, by ratio: a centimetre near by shows as much as three far away.
double DepthFraction(double depth_m, const PreviewRange& range) {
  return std::log(depth_m / range.near_m) / std::log(static_cast<double>(range.far_m) / range.near_m);
}

Rgb8 DepthColor(float depth_m, const PreviewRange& range) {
  static const Palette palette = MakePalette(cv::COLORMAP_TURBO);
  // The ends of Turbo are nearly black; its first and last twentieth would read as unknown.
  const double fraction = 1.0 - DepthFraction(depth_m, range);
  return At(palette, 0.05 + 0.9 * std::clamp(fraction, 0.0, 1.0));
}

Rgb8 SigmaColor(float sigma_m) {
  static const Palette palette = MakePalette(cv::COLORMAP_INFERNO);
  return At(palette, std::log(sigma_m / kSigmaMin_m) / std::log(kSigmaMax_m / kSigmaMin_m));
}

template <typename ColorOf>
Image<Rgb8> Colorize(ImageView<const float> values, ColorOf color_of) {
  Image<Rgb8> out(values.width(), values.height(), kUnknown);
  for (int y = 0; y < values.height(); ++y)
    for (int x = 0; x < values.width(); ++x)
      if (values(x, y) > 0) out(x, y) = color_of(values(x, y));
  return out;
}

// Blue over white to red, for [0,1]; the ends are dark enough to tell from unknown by their hue.
Rgb8 ErrorColor(double fraction) {
  constexpr double kBlue[] = {33, 102, 172}, kWhite[] = {247, 247, 247}, kRed[] = {178, 24, 43};  // ColorBrewer RdBu
  const double t = std::clamp(2 * fraction - 1, -1.0, 1.0);
  const double* const end = t < 0 ? kBlue : kRed;
  const auto mix = [&](int c) {
    return static_cast<uint8_t>(std::lround(kWhite[c] + std::abs(t) * (end[c] - kWhite[c])));
  };
  return {mix(0), mix(1), mix(2)};
}

// The image's pixels as a matrix; valid while the image lives.
cv::Mat AsMat(const Image<Rgb8>& image) {
  return cv::Mat(image.height(), image.width(), CV_8UC3, const_cast<Rgb8*>(image.data()));
}

cv::Size TextSize(const std::string& text) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, kFontScale, 1, &baseline);
}

enum class Align { kLeft, kCenter, kRight };

// One line of text, vertically centred on `y`; `x` is its left end, centre or right end.
void DrawText(cv::Mat& canvas, const std::string& text, int x, int y, const Color& color, Align align = Align::kLeft) {
  const cv::Size size = TextSize(text);
  if (align == Align::kCenter) x -= size.width / 2;
  if (align == Align::kRight) x -= size.width;
  cv::putText(canvas, text, {x, y + size.height / 2}, kFont, kFontScale, color, 1, cv::LINE_AA);
}

// Shrinks by averaging; enlarges without inventing values between pixels.
void DrawPanel(cv::Mat& canvas, const cv::Rect& where, const Image<Rgb8>& image) {
  const int how = image.width() > where.width ? cv::INTER_AREA : cv::INTER_NEAREST;
  cv::Mat panel = canvas(where);
  cv::resize(AsMat(image), panel, where.size(), 0, 0, how);
}

struct Tick {
  double fraction;
  std::string label;
};

// At most six round values between the ends.
std::vector<Tick> DepthTicks(const PreviewRange& range) {
  const double span = range.far_m - range.near_m;
  double step = std::pow(10.0, std::floor(std::log10(span / 6)));
  for (const double factor : {2.0, 2.5, 2.0}) {  // 1, 2, 5, 10
    if (span / step <= 6) break;
    step *= factor;
  }
  const int decimals = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  std::vector<Tick> ticks;
  for (double value = std::ceil(range.near_m / step - 1e-6) * step; value <= range.far_m + 1e-6; value += step)
    ticks.push_back({DepthFraction(value, range), absl::StrFormat("%.*f m", decimals, value)});
  return ticks;
}

std::vector<Tick> SigmaTicks() { return {{0, "1 mm"}, {1.0 / 3, "1 cm"}, {2.0 / 3, "10 cm"}, {1, "1 m"}}; }

// A bar of colours with labelled ticks, and what unknown looks like. `color_at` maps [0,1] along the bar to its colour.
template <typename ColorAt>
void DrawLegend(cv::Mat& canvas, int x, int y, int width, const std::vector<Tick>& ticks, ColorAt color_at) {
  const std::string unknown = "unknown";
  const int unknown_width = kBarHeight + 6 + TextSize(unknown).width;
  const int bar_width = width - unknown_width - 2 * kMargin;
  for (int i = 0; i < bar_width; ++i) {
    const Rgb8 color = color_at(static_cast<double>(i) / (bar_width - 1));
    cv::line(canvas, {x + i, y}, {x + i, y + kBarHeight - 1}, Color(color.r, color.g, color.b));
  }
  int labelled_to = x - kMargin;  // labels that would touch the one before are left out, their ticks stay
  for (const Tick& tick : ticks) {
    const int at = x + static_cast<int>(std::lround(tick.fraction * (bar_width - 1)));
    cv::line(canvas, {at, y + kBarHeight}, {at, y + kBarHeight + 4}, kFaint);
    const int half = TextSize(tick.label).width / 2;
    const int center = std::clamp(at, x + half, x + width - half);
    if (center - half < labelled_to + kMargin) continue;
    DrawText(canvas, tick.label, center, y + kBarHeight + 15, kText, Align::kCenter);
    labelled_to = center + half;
  }
  const int swatch = x + width - unknown_width;
  cv::rectangle(canvas, cv::Rect(swatch, y, kBarHeight, kBarHeight), Color(kUnknown.r, kUnknown.g, kUnknown.b),
                cv::FILLED);
  cv::rectangle(canvas, cv::Rect(swatch, y, kBarHeight, kBarHeight), kFaint);
  DrawText(canvas, unknown, x + width, y + kBarHeight / 2, kFaint, Align::kRight);
}

void DrawDepthLegend(cv::Mat& canvas, int x, int y, int width, const PreviewRange& range) {
  DrawLegend(canvas, x, y, width, DepthTicks(range), [&](double fraction) {
    return DepthColor(static_cast<float>(range.near_m * std::pow(range.far_m / range.near_m, fraction)), range);
  });
}

void DrawSigmaLegend(cv::Mat& canvas, int x, int y, int width) {
  DrawLegend(canvas, x, y, width, SigmaTicks(), [](double fraction) {
    return SigmaColor(static_cast<float>(kSigmaMin_m * std::pow(kSigmaMax_m / kSigmaMin_m, fraction)));
  });
}

void DrawErrorLegend(cv::Mat& canvas, int x, int y, int width) {
  const double shown_cm = 100 * kErrorShownM;
  std::vector<Tick> ticks;
  for (const double fraction : {0.0, 0.25, 0.5, 0.75, 1.0})
    ticks.push_back(
        {fraction, fraction == 0.5 ? std::string(1, '0') : absl::StrFormat("%+g cm", (2 * fraction - 1) * shown_cm)});
  DrawLegend(canvas, x, y, width, ticks, ErrorColor);
}

std::string Seconds(int64_t time_ns) { return absl::StrFormat("%.3f s", static_cast<double>(time_ns) * 1e-9); }

struct KindLabel {
  const char* text;
  Color color;
};

KindLabel LabelOf(FrameKind kind) {
  switch (kind) {
    case FrameKind::kKey:
      return {"depth frame", kKeyColor};
    case FrameKind::kHeld:
      return {"held", kHeldColor};
    case FrameKind::kBetween:
      break;
  }
  return {"in between", kFaint};
}

void DrawTimeline(cv::Mat& canvas, int x, int y, int width, const PreviewFrame& frame,
                  const PreviewTimeline& timeline) {
  const auto at = [&](int64_t time_ns) {
    const double fraction = static_cast<double>(time_ns) / static_cast<double>(timeline.duration_ns);
    return x + static_cast<int>(std::lround(std::clamp(fraction, 0.0, 1.0) * (width - 1)));
  };
  const int middle = y + kBarHeight / 2, playhead = at(frame.time_ns);
  cv::line(canvas, {x, middle}, {x + width - 1, middle}, kFaint);
  cv::line(canvas, {x, middle}, {playhead, middle}, kText);
  for (const int64_t key : timeline.key_times_ns)
    cv::line(canvas, {at(key), middle - 5}, {at(key), middle + 5}, kKeyColor);
  cv::circle(canvas, {playhead, middle}, 4, kText, cv::FILLED, cv::LINE_AA);
  const int label_y = y + kBarHeight + 15;
  DrawText(canvas, "0 s", x, label_y, kFaint);
  DrawText(canvas, "| depth frames", x + width / 2, label_y, kKeyColor, Align::kCenter);
  DrawText(canvas, Seconds(timeline.duration_ns), x + width, label_y, kFaint, Align::kRight);
}

int EvenUp(int value) { return value + value % 2; }

}  // namespace

Image<Rgb8> ColorizeDepth(ImageView<const float> depth_m, const PreviewRange& range) {
  return Colorize(depth_m, [&](float depth) { return DepthColor(depth, range); });
}

Image<Rgb8> ColorizeSigma(ImageView<const float> sigma_m) { return Colorize(sigma_m, SigmaColor); }

Image<Rgb8> DrawVideoFrame(const PreviewFrame& frame, const PreviewTimeline& timeline, const PreviewRange& range) {
  const int width = frame.color.width(), height = frame.color.height();
  const int panel_width =
      width < kVideoPanelMin ? (kVideoPanelMin + width - 1) / width * width : std::min(width, kVideoPanelMax);
  const int panel_height =
      std::max(1, static_cast<int>(std::lround(static_cast<double>(height) * panel_width / width)));
  Image<Rgb8> out(EvenUp(2 * kMargin + 3 * panel_width + 2 * kGap),
                  EvenUp(kMargin + kTitleHeight + panel_height + kGap + kLegendHeight));
  cv::Mat canvas = AsMat(out);
  canvas = kBackground;

  const int title_y = kMargin / 2 + kTitleHeight / 2;
  const int panel_y = kMargin + kTitleHeight - kMargin / 2;
  const int legend_y = panel_y + panel_height + kGap + 4;
  const int x[] = {kMargin, kMargin + panel_width + kGap, kMargin + 2 * (panel_width + kGap)};
  const KindLabel kind = LabelOf(frame.kind);
  DrawText(canvas, absl::StrFormat("frame %d   %s", frame.index, Seconds(frame.time_ns)), x[0], title_y, kText);
  DrawText(canvas, kind.text, x[0] + panel_width, title_y, kind.color, Align::kRight);
  DrawText(canvas, "depth", x[1], title_y, kText);
  DrawText(canvas, "uncertainty, one standard deviation", x[2], title_y, kText);

  DrawPanel(canvas, {x[0], panel_y, panel_width, panel_height}, frame.color);
  DrawPanel(canvas, {x[1], panel_y, panel_width, panel_height}, ColorizeDepth(frame.depth_m, range));
  DrawPanel(canvas, {x[2], panel_y, panel_width, panel_height}, ColorizeSigma(frame.sigma_m));
  if (frame.kind == FrameKind::kHeld)
    cv::rectangle(canvas, cv::Rect(x[1], panel_y, panel_width, panel_height), kHeldColor, 2);

  DrawTimeline(canvas, x[0], legend_y, panel_width, frame, timeline);
  DrawDepthLegend(canvas, x[1], legend_y, panel_width, range);
  DrawSigmaLegend(canvas, x[2], legend_y, panel_width);
  return out;
}

Image<Rgb8> DrawContactSheet(const std::vector<PreviewFrame>& frames, const PreviewRange& range) {
  const int width = frames.front().color.width(), height = frames.front().color.height();
  const int panel_height =
      std::max(1, static_cast<int>(std::lround(static_cast<double>(height) * kSheetPanelWidth / width)));
  const int columns = static_cast<int>(frames.size());
  const int content_width = columns * kSheetPanelWidth + (columns - 1) * kGap;
  const int legend_width = std::min(content_width, 2 * kSheetPanelWidth);
  // Titles share a line with the legend where there is room; a sheet of one column is too narrow.
  const bool legend_beside = content_width >= 3 * kSheetPanelWidth;
  const int legend_line = legend_beside ? kLegendHeight : kLegendHeight + kTitleHeight;
  const int row_height = panel_height + kGap;
  Image<Rgb8> out(2 * kMargin + content_width, kTitleHeight + kMargin + row_height + 2 * (legend_line + row_height));
  cv::Mat canvas = AsMat(out);
  canvas = kBackground;

  const int color_y = kMargin / 2 + kTitleHeight;
  const int depth_line_y = color_y + row_height;
  const int depth_y = depth_line_y + legend_line;
  const int sigma_line_y = depth_y + row_height;
  const int sigma_y = sigma_line_y + legend_line;
  for (int i = 0; i < columns; ++i) {
    const PreviewFrame& frame = frames[i];
    const int x = kMargin + i * (kSheetPanelWidth + kGap);
    const int title_y = kMargin / 2 + kTitleHeight / 2;
    const KindLabel kind = LabelOf(frame.kind);
    DrawText(canvas, absl::StrFormat("%s  frame %d", Seconds(frame.time_ns), frame.index), x, title_y, kText);
    DrawText(canvas, kind.text, x + kSheetPanelWidth, title_y, kind.color, Align::kRight);
    DrawPanel(canvas, {x, color_y, kSheetPanelWidth, panel_height}, frame.color);
    DrawPanel(canvas, {x, depth_y, kSheetPanelWidth, panel_height}, ColorizeDepth(frame.depth_m, range));
    DrawPanel(canvas, {x, sigma_y, kSheetPanelWidth, panel_height}, ColorizeSigma(frame.sigma_m));
    if (frame.kind != FrameKind::kBetween)
      cv::rectangle(canvas, cv::Rect(x, depth_y, kSheetPanelWidth, panel_height), kind.color, 2);
  }
  const int legend_x = kMargin + content_width - legend_width;
  const int legend_offset = legend_line - kLegendHeight + 10;
  DrawText(canvas, "depth", kMargin, depth_line_y + 16, kText);
  DrawDepthLegend(canvas, legend_x, depth_line_y + legend_offset, legend_width, range);
  DrawText(canvas, "uncertainty, one standard deviation", kMargin, sigma_line_y + 16, kText);
  DrawSigmaLegend(canvas, legend_x, sigma_line_y + legend_offset, legend_width);
  return out;
}

Image<Rgb8> ColorizeError(ImageView<const float> estimate_m, ImageView<const float> truth_m) {
  Image<Rgb8> out(truth_m.width(), truth_m.height(), kUnknown);
  for (int y = 0; y < truth_m.height(); ++y)
    for (int x = 0; x < truth_m.width(); ++x)
      if (estimate_m(x, y) > 0 && truth_m(x, y) > 0)
        out(x, y) = ErrorColor(0.5 + 0.5 * (estimate_m(x, y) - truth_m(x, y)) / kErrorShownM);
  return out;
}

Image<Rgb8> DrawErrorStrip(const std::vector<StripFrame>& frames, const std::vector<std::string>& methods,
                           const PreviewRange& range) {
  const int width = frames.front().color.width(), height = frames.front().color.height();
  // As large as the recording where it is small: errors are a few pixels wide.
  const int panel_width = std::clamp(width, kSheetPanelWidth, kVideoPanelMax);
  const int panel_height =
      std::max(1, static_cast<int>(std::lround(static_cast<double>(height) * panel_width / width)));
  const int columns = static_cast<int>(frames.size()), method_count = static_cast<int>(methods.size());
  const int content_width = columns * panel_width + (columns - 1) * kGap;
  const int row_height = kTitleHeight + panel_height;
  Image<Rgb8> out(2 * kMargin + content_width, kMargin + (2 + method_count) * row_height + 2 * kLegendHeight + kGap);
  cv::Mat canvas = AsMat(out);
  canvas = kBackground;

  const int legend_width = std::min(content_width, 2 * kSheetPanelWidth);
  const int depth_y = kMargin + row_height, errors_y = depth_y + row_height + kLegendHeight;
  for (int i = 0; i < columns; ++i) {
    const StripFrame& frame = frames[i];
    const int x = kMargin + i * (panel_width + kGap);
    // A title, and below it a panel.
    const auto draw = [&](int y, const std::string& title, const Image<Rgb8>& picture) {
      DrawText(canvas, title, x, y + kTitleHeight / 2, kText);
      DrawPanel(canvas, {x, y + kTitleHeight, panel_width, panel_height}, picture);
    };
    DrawText(canvas, absl::StrFormat("%s  frame %d", Seconds(frame.time_ns), frame.index), x,
             kMargin + kTitleHeight / 2, kText);
    DrawPanel(canvas, {x, kMargin + kTitleHeight, panel_width, panel_height}, frame.color);
    draw(depth_y, "depth, " + methods[0], ColorizeDepth(frame.estimates_m[0], range));
    for (int m = 0; m < method_count; ++m)
      draw(errors_y + m * row_height, "error, " + methods[m], ColorizeError(frame.estimates_m[m], frame.truth_m));
  }
  DrawDepthLegend(canvas, kMargin, depth_y + row_height + kMargin, legend_width, range);
  DrawErrorLegend(canvas, kMargin, errors_y + method_count * row_height + kMargin, legend_width);
  return out;
}

}  // namespace depthtween
