#include "tests/bench/svg_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

// All lengths in SVG units, which viewers show as pixels.
constexpr double kWidth = 760, kHeight = 420;
constexpr double kLeft = 76, kRight = 190, kTop = 44,
                 kBottom = 58;  // around the plot's frame; the legend is right of it
constexpr double kFrameWidth = kWidth - kLeft - kRight, kFrameHeight = kHeight - kTop - kBottom;
constexpr double kLegendLine = 20;
// A character of the smaller text is about this wide: what labels of groups have room for.
constexpr double kCharacterWidth = 6.5;
// Okabe and Ito's colours, which colour-blind readers can tell apart, without yellow, which is too pale on white.
constexpr std::array kColors = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#555555", "#8B4513"};

std::string Escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else {
      out += c;
    }
  }
  return out;
}

constexpr char kReferenceColor[] = "#777777";

const char* ColorOf(size_t series) { return kColors[series % kColors.size()]; }

// An axis with its range, mapped to [0,1].
struct Scale {
  double low = 0.0, high = 1.0;
  bool logarithmic = false;

  double At(double value) const {
    if (logarithmic) return std::log(value / low) / std::log(high / low);
    return (value - low) / (high - low);
  }
  std::vector<double> Ticks(int count) const {
    return logarithmic ? LogarithmicTicks(low, high) : LinearTicks(low, high, count);
  }
};

bool Shown(double value, const PlotAxis& axis) { return std::isfinite(value) && (!axis.logarithmic || value > 0); }

Scale Fit(const PlotAxis& axis, double low, double high) {
  if (low > high) return {.low = axis.logarithmic ? 1.0 : 0.0, .high = axis.logarithmic ? 10.0 : 1.0};
  if (axis.logarithmic) {
    // A little air, so that no curve runs along the frame.
    const double air = std::max(std::pow(high / low, 0.03), 1.05);
    return {.low = low / air, .high = high * air, .logarithmic = true};
  }
  if (axis.from_zero) low = std::min(low, 0.0);
  const double span = high > low ? high - low : std::max(std::abs(high), 1.0);
  return {.low = axis.from_zero && low == 0.0 ? 0.0 : low - 0.04 * span, .high = high + 0.04 * span};
}

std::string Text(double x, double y, const std::string& text, const char* anchor, int size, const char* more = "") {
  return absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" font-size=\"%d\"%s>%s</text>\n", x, y, anchor,
                         size, more, Escaped(text));
}

std::string Line(double x1, double y1, double x2, double y2, const char* color, double width) {
  return absl::StrFormat("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" stroke-width=\"%g\"/>\n",
                         x1, y1, x2, y2, color, width);
}

double FrameX(double fraction) { return kLeft + fraction * kFrameWidth; }
double FrameY(double fraction) { return kTop + (1 - fraction) * kFrameHeight; }

std::string Begin(const std::string& title) {
  return absl::StrFormat(
             "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %g %g\" width=\"%g\" height=\"%g\" "
             "font-family=\"Helvetica, Arial, sans-serif\" fill=\"#222222\">\n"
             "<rect width=\"100%%\" height=\"100%%\" fill=\"#ffffff\"/>\n",
             kWidth, kHeight, kWidth, kHeight) +
         Text(kLeft, 26, title, "start", 16, " font-weight=\"bold\"");
}

std::string YAxis(const std::string& title, const Scale& scale) {
  std::string out;
  for (const double tick : scale.Ticks(6)) {
    const double y = FrameY(scale.At(tick));
    out += Line(kLeft, y, kLeft + kFrameWidth, y, "#dddddd", 1);
    out += Text(kLeft - 8, y + 4, absl::StrFormat("%g", tick), "end", 12);
  }
  const double middle = kTop + kFrameHeight / 2;
  return out +
         Text(20, middle, title, "middle", 13, absl::StrFormat(" transform=\"rotate(-90 20 %.1f)\"", middle).c_str());
}

std::string XAxis(const std::string& title, const Scale& scale) {
  std::string out;
  for (const double tick : scale.Ticks(7)) {
    const double x = FrameX(scale.At(tick));
    out += Line(x, kTop, x, kTop + kFrameHeight, "#dddddd", 1);
    out += Text(x, kTop + kFrameHeight + 18, absl::StrFormat("%g", tick), "middle", 12);
  }
  return out + Text(kLeft + kFrameWidth / 2, kHeight - 14, title, "middle", 13);
}

std::string Frame() {
  return absl::StrFormat(
      "<rect x=\"%g\" y=\"%g\" width=\"%g\" height=\"%g\" fill=\"none\" stroke=\"#555555\" stroke-width=\"1\"/>\n",
      kLeft, kTop, kFrameWidth, kFrameHeight);
}

double LegendY(size_t entry) { return kTop + 8 + kLegendLine * static_cast<double>(entry); }
constexpr double kLegendX = kLeft + kFrameWidth + 14;

std::string Nothing() {
  return Text(kLeft + kFrameWidth / 2, kTop + kFrameHeight / 2, "nothing was measured", "middle", 14);
}

}  // namespace

std::vector<double> LinearTicks(double low, double high, int count) {
  const double least = (high - low) / std::max(count, 1);
  double step = std::pow(10.0, std::floor(std::log10(least)));
  for (const double factor : {2.0, 2.5, 2.0}) {  // 1, 2, 5, 10
    if (step >= least) break;
    step *= factor;
  }
  std::vector<double> ticks;
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i)
    ticks.push_back(i == 0 ? 0 : i * step);
  return ticks;
}

std::vector<double> LogarithmicTicks(double low, double high) {
  const bool dense = std::log10(high / low) < 2.0;  // one power of ten, perhaps, or none
  std::vector<double> ticks;
  for (int exponent = static_cast<int>(std::floor(std::log10(low))); std::pow(10.0, exponent) <= high; ++exponent)
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double tick = factor * std::pow(10.0, exponent);
      if ((factor == 1.0 || dense) && tick >= low * (1 - 1e-9) && tick <= high * (1 + 1e-9)) ticks.push_back(tick);
    }
  return ticks;
}

std::string DrawSvg(const LinePlot& plot) {
  double low_x = std::numeric_limits<double>::max(), high_x = std::numeric_limits<double>::lowest();
  double low_y = low_x, high_y = high_x;
  const auto shown = [&](const std::pair<double, double>& point) {
    return Shown(point.first, plot.x) && Shown(point.second, plot.y);
  };
  for (const PlotSeries& series : plot.series)
    for (const auto& point : series.points)
      if (shown(point)) {
        low_x = std::min(low_x, point.first), high_x = std::max(high_x, point.first);
        low_y = std::min(low_y, point.second), high_y = std::max(high_y, point.second);
      }
  const Scale x_scale = Fit(plot.x, low_x, high_x), y_scale = Fit(plot.y, low_y, high_y);
  std::string out = Begin(plot.title) + YAxis(plot.y.title, y_scale) + XAxis(plot.x.title, x_scale) + Frame();
  if (low_x > high_x) out += Nothing();
  for (size_t s = 0; s < plot.series.size(); ++s) {
    const PlotSeries& series = plot.series[s];
    const char* const dash = series.dashed ? " stroke-dasharray=\"6 4\"" : "";
    const char* const color = series.dashed ? kReferenceColor : ColorOf(s);
    std::string path, dots;
    for (const auto& point : series.points) {
      if (!shown(point)) continue;
      const double x = FrameX(x_scale.At(point.first)), y = FrameY(y_scale.At(point.second));
      absl::StrAppendFormat(&path, "%.1f,%.1f ", x, y);
      if (series.marked)
        absl::StrAppendFormat(&dots, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3.2\" fill=\"%s\"/>\n", x, y, color);
    }
    absl::StrAppendFormat(&out, "<polyline points=\"%s\" fill=\"none\" stroke=\"%s\" stroke-width=\"2\"%s/>\n", path,
                          color, dash);
    out += dots;
    absl::StrAppendFormat(&out, "<line x1=\"%g\" y1=\"%g\" x2=\"%g\" y2=\"%g\" stroke=\"%s\" stroke-width=\"2\"%s/>\n",
                          kLegendX, LegendY(s), kLegendX + 24, LegendY(s), color, dash);
    out += Text(kLegendX + 30, LegendY(s) + 4, series.name, "start", 12);
  }
  return out + "</svg>\n";
}

std::string DrawSvg(const BarPlot& plot) {
  double low = 0.0, high = 0.0;
  for (const auto& series : plot.series)
    for (const double value : series.values)
      if (std::isfinite(value)) low = std::min(low, value), high = std::max(high, value);
  const Scale scale = Fit({.from_zero = true}, low, high > low ? high : 1.0);
  std::string out = Begin(plot.title) + YAxis(plot.y_title, scale);
  if (plot.groups.empty() || plot.series.empty()) out += Nothing();
  const double group_width = kFrameWidth / std::max<double>(1.0, static_cast<double>(plot.groups.size()));
  const double bar_width = 0.8 * group_width / std::max<double>(1.0, static_cast<double>(plot.series.size()));
  const bool upright = std::all_of(plot.groups.begin(), plot.groups.end(), [&](const std::string& name) {
    return static_cast<double>(name.size()) * kCharacterWidth < group_width;
  });
  for (size_t g = 0; g < plot.groups.size(); ++g) {
    const double left = kLeft + group_width * static_cast<double>(g);
    for (size_t s = 0; s < plot.series.size(); ++s) {
      const double value = plot.series[s].values[g];
      if (!std::isfinite(value)) continue;
      const double top = FrameY(scale.At(std::max(value, 0.0))), bottom = FrameY(scale.At(std::min(value, 0.0)));
      absl::StrAppendFormat(&out, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"/>\n",
                            left + 0.1 * group_width + bar_width * static_cast<double>(s), top, bar_width, bottom - top,
                            ColorOf(s));
    }
    const double x = left + group_width / 2, y = kTop + kFrameHeight + 18;
    // Long names lean, so that neighbours do not run into each other.
    out += upright ? Text(x, y, plot.groups[g], "middle", 12)
                   : Text(x + 4, y - 4, plot.groups[g], "end", 11,
                          absl::StrFormat(" transform=\"rotate(-30 %.1f %.1f)\"", x + 4, y - 4).c_str());
  }
  out += Frame() + Line(kLeft, FrameY(scale.At(0)), kLeft + kFrameWidth, FrameY(scale.At(0)), "#555555", 1);
  for (size_t s = 0; s < plot.series.size(); ++s) {
    absl::StrAppendFormat(&out, "<rect x=\"%g\" y=\"%g\" width=\"12\" height=\"12\" fill=\"%s\"/>\n", kLegendX,
                          LegendY(s) - 6, ColorOf(s));
    out += Text(kLegendX + 20, LegendY(s) + 4, plot.series[s].name, "start", 12);
  }
  return out + "</svg>\n";
}

}  // namespace depthtween
