// Plots as SVG text: lines over linear or logarithmic axes, and grouped bars, with ticks, grid and legend; dark on
// white.
//
// Threads: all functions are pure. Text may hold any UTF-8; it is escaped.
#ifndef DEPTHTWEEN_TESTS_BENCH_SVG_PLOT_H_
#define DEPTHTWEEN_TESTS_BENCH_SVG_PLOT_H_

#include <string>
#include <utility>
#include <vector>

namespace depthtween {

struct PlotAxis {
  std::string title;  // with the unit
  bool logarithmic = false;
  bool from_zero = false;  // a linear axis that begins at 0
};

struct PlotSeries {
  std::string name;
  std::vector<std::pair<double, double>> points;  // x, y
  bool dashed = false;                            // a reference to compare with: grey
  bool marked = false;                            // with a dot at each point: few measurements, not a curve
};

struct LinePlot {
  std::string title;
  PlotAxis x, y;
  std::vector<PlotSeries> series;
};

struct BarPlot {
  std::string title;
  std::string y_title;  // with the unit; bars stand on 0
  std::vector<std::string> groups;
  struct Series {
    std::string name;
    std::vector<double> values;  // one for each group
  };
  std::vector<Series> series;
};

// Points that a logarithmic axis cannot show, and those that are not finite, are left out. A plot of nothing says so.
std::string DrawSvg(const LinePlot& plot);
std::string DrawSvg(const BarPlot& plot);

// Round values (1, 2 or 5 times a power of ten) that lie between the ends, about `count` of them.
std::vector<double> LinearTicks(double low, double high, int count);
// Powers of ten between the ends; with 2 and 5 times them where that leaves few.
std::vector<double> LogarithmicTicks(double low, double high);

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_SVG_PLOT_H_
