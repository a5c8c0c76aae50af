// The forms of a benchmark: JSON for programs, Markdown with plots for people.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/io/file.h"
#include "core/io/png.h"
#include "core/session/evaluation.h"
#include "tests/bench/benchmark.h"
#include "tests/bench/svg_plot.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr std::array kKinds = {ClipKind::kScene, ClipKind::kRendered, ClipKind::kReal};
// What the paper's geometric mean of RMSE(ours) / RMSE(dolson) comes to over its six sequences (0.39 0.15 0.32 0.15
// 0.51 0.32).
constexpr char kPaperBaseline[] = "dolson";
constexpr double kPaperRatio = 0.28;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// A measure of one method; NaN where it was not measured.
using Measure = std::function<double(const MethodScore&)>;
Measure RmseIn(Region region) {
  return [region](const MethodScore& m) { return m[region].pixels > 0 ? m[region].rmse_mm : kNone; };
}
double MaeOf(const MethodScore& m) { return m[Region::kAll].pixels > 0 ? m[Region::kAll].mae_mm : kNone; }

// Of the positive values among them; NaN of none.
double GeometricMean(const std::vector<double>& values) {
  double sum = 0.0;
  int count = 0;
  for (const double value : values)
    if (value > 0.0 && std::isfinite(value)) sum += std::log(value), ++count;
  return count > 0 ? std::exp(sum / count) : kNone;
}

// A number with `decimals`, or a hyphen where nothing was measured.
std::string Cell(double value, int decimals) {
  return std::isfinite(value) ? absl::StrFormat("%.*f", decimals, value) : "-";
}
std::string Millimetres(double value) { return Cell(value, std::abs(value) < 9.995 ? 2 : 1); }

using Rows = std::vector<std::vector<std::string>>;

// The first row is the head; numbers are right-aligned, `words` first columns are not.
std::string Table(const Rows& rows, int words) {
  std::string text;
  for (size_t r = 0; r < rows.size(); ++r) {
    absl::StrAppend(&text, "| ", absl::StrJoin(rows[r], " | "), " |\n");
    if (r > 0) continue;
    text += "|";
    for (size_t c = 0; c < rows[0].size(); ++c) text += static_cast<int>(c) < words ? "---|" : "---:|";
    text += "\n";
  }
  return text;
}

const MethodScore* Find(const ClipScores& scores, const std::string& name) {
  for (const MethodScore& method : scores.score.methods)
    if (method.name == name) return &method;
  return nullptr;
}

// Letters, digits, dots and hyphens of a name, for a file.
std::string FileStem(const std::string& name) {
  std::string stem;
  for (const char c : name) stem += absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' ? c : '-';
  return stem;
}

std::string Input(const ClipBenchmark& clip) {
  return clip.key_every == 1 ? "all" : absl::StrFormat("1 in %d", clip.key_every);
}

class Report {
 public:
  Report(const Benchmark& benchmark, const std::string& dir) : benchmark_(benchmark), dir_(dir) {}

  absl::StatusOr<std::string> Markdown(const std::string& command) {
    std::string text = absl::StrFormat(
        "# Benchmark of depthtween %s\n\nMade by `%s`.\n\nErrors in mm, pooled over all frames between the first and "
        "the "
        "last key, on the pixels that all methods of a table fill. Edge band: within %d px of a depth jump over %g cm; "
        "interior: the rest; moving and fast: more than %g and %g px per colour frame; disoccluded: not seen by the "
        "key "
        "before; untextured: luma varies by less than %g levels around the pixel. Numbers do not depend on threads; "
        "times do.\n",
        DEPTHTWEEN_VERSION, command, kEdgeBandPx, 100 * kEdgeJumpM, kMovingPx, kFastPx, kUntexturedLevels);
    for (const auto& part : {&Report::Depth, &Report::Uncertainty, &Report::Ablation, &Report::Parameters,
                             &Report::Ratios, &Report::SceneFlow, &Report::Times}) {
      ASSIGN_OR_RETURN(const std::string section, (this->*part)());
      text += section;
    }
    return text;
  }

 private:
  // Writes the plot beside the report and returns the Markdown that shows it.
  template <typename Plot>
  absl::StatusOr<std::string> Show(const Plot& plot, const std::string& stem) {
    const std::string file = FileStem(stem) + ".svg";
    RETURN_IF_ERROR(WriteFile(JoinPath(dir_, file), DrawSvg(plot)));
    return absl::StrFormat("\n![%s](%s)\n", plot.title, file);
  }

  std::vector<const ClipBenchmark*> Clips(ClipKind kind, const std::function<bool(const ClipBenchmark&)>& has) const {
    std::vector<const ClipBenchmark*> clips;
    for (const ClipBenchmark& clip : benchmark_.clips)
      if (clip.kind == kind && has(clip)) clips.push_back(&clip);
    return clips;
  }

  absl::StatusOr<std::string> Depth() {
    const auto has = [](const ClipBenchmark& clip) { return clip.depth.has_value(); };
    if (std::none_of(benchmark_.clips.begin(), benchmark_.clips.end(), has)) return std::string();
    std::string text = "\n## Depth\n\n";
    Rows rows = {{"clip", "input", "method", "RMSE", "MAE", "median", "edge band", "interior", "moving", "fast",
                  "static", "disoccluded", "untextured", "flicker", "edge F1 %", "complete %"}};
    for (const ClipBenchmark& clip : benchmark_.clips) {
      if (!clip.depth) continue;
      for (const MethodScore& m : clip.depth->score.methods) {
        std::vector<std::string> row = {clip.name,
                                        Input(clip),
                                        m.name,
                                        Millimetres(RmseIn(Region::kAll)(m)),
                                        Millimetres(MaeOf(m)),
                                        Millimetres(m[Region::kAll].median_mm)};
        for (const Region region : {Region::kEdgeBand, Region::kInterior, Region::kMoving, Region::kFast,
                                    Region::kStatic, Region::kDisoccluded, Region::kUntextured})
          row.push_back(Millimetres(RmseIn(region)(m)));
        row.push_back(Millimetres(m.flicker_mm.value_or(kNone)));
        row.push_back(Cell(m.edges.true_edges > 0 ? 100 * m.edges.f1 : kNone, 1));
        row.push_back(Cell(100 * m.completeness, 1));
        rows.push_back(std::move(row));
      }
    }
    text += Table(rows, 3);
    for (const ClipBenchmark& clip : benchmark_.clips)
      if (clip.depth && clip.depth->sensor_floor)
        absl::StrAppendFormat(
            &text, "\nSensor floor of %s: consecutive depth maps differ by %s mm RMSE where nothing moves.\n",
            clip.name, Millimetres(clip.depth->sensor_floor->rmse_mm));
    for (const ClipBenchmark& clip : benchmark_.clips)
      for (const std::string& note : clip.depth ? clip.depth->notes : std::vector<std::string>())
        absl::StrAppendFormat(&text, "\n%s: %s.\n", clip.name, note);
    text += "\n### Ours / baseline\n\n" + RatioTable();
    for (const ClipBenchmark& clip : benchmark_.clips) {
      if (!clip.depth) continue;
      LinePlot plot{.title = absl::StrCat("Absolute errors, ", clip.name),
                    .x = {.title = "absolute error, mm", .logarithmic = true},
                    .y = {.title = "pixels with at most this error, %"}};
      for (const MethodScore& m : clip.depth->score.methods) {
        PlotSeries& series = plot.series.emplace_back(PlotSeries{.name = m.name});
        for (size_t i = 0; i < m.errors_below.size(); ++i)
          series.points.emplace_back(kErrorCurveMm[i], 100 * m.errors_below[i]);
      }
      ASSIGN_OR_RETURN(const std::string shown, Show(plot, "errors-" + clip.name));
      text += shown;
      if (clip.strip.empty()) continue;
      const std::string file = FileStem("strip-" + clip.name) + ".png";
      RETURN_IF_ERROR(WritePngRgb8(JoinPath(dir_, file), clip.strip));
      absl::StrAppendFormat(&text, "\n![Colour, depth and errors, %s](%s)\n", clip.name, file);
    }
    return text;
  }

  std::string RatioTable() const {
    std::vector<std::string> baselines;
    for (const ClipBenchmark& clip : benchmark_.clips)
      for (size_t m = 1; clip.depth && m < clip.depth->score.methods.size(); ++m)
        if (const std::string& name = clip.depth->score.methods[m].name;
            std::find(baselines.begin(), baselines.end(), name) == baselines.end())
          baselines.push_back(name);
    if (baselines.empty()) return "No baseline was asked for.\n";
    Rows rows = {{"RMSE / MAE / edge band"}};
    for (const std::string& name : baselines) rows[0].push_back("ours / " + name);
    const auto ratio = [](const ClipBenchmark& clip, const std::string& baseline, const Measure& measure) {
      const MethodScore* const theirs = Find(*clip.depth, baseline);
      return theirs == nullptr ? kNone : measure(clip.depth->score.methods[0]) / measure(*theirs);
    };
    const std::array<Measure, 3> measures = {RmseIn(Region::kAll), MaeOf, RmseIn(Region::kEdgeBand)};
    const auto has = [](const ClipBenchmark& clip) { return clip.depth.has_value(); };
    for (const ClipKind kind : kKinds) {
      const std::vector<const ClipBenchmark*> clips = Clips(kind, has);
      for (const ClipBenchmark* clip : clips) {
        auto& row = rows.emplace_back(std::vector<std::string>{clip->name});
        for (const std::string& name : baselines) {
          std::vector<std::string> cells;
          for (const Measure& measure : measures) cells.push_back(Cell(ratio(*clip, name, measure), 3));
          row.push_back(absl::StrJoin(cells, " / "));
        }
      }
      if (clips.empty()) continue;
      auto& row = rows.emplace_back(
          std::vector<std::string>{absl::StrFormat("**geometric mean, %s**", std::string(ClipKindName(kind)))});
      for (const std::string& name : baselines) {
        std::vector<std::string> cells;
        for (const Measure& measure : measures) {
          std::vector<double> values;
          for (const ClipBenchmark* clip : clips) values.push_back(ratio(*clip, name, measure));
          cells.push_back(Cell(GeometricMean(values), 3));
        }
        row.push_back(absl::StrCat("**", absl::StrJoin(cells, " / "), "**"));
      }
    }
    std::string text = Table(rows, 1);
    if (std::find(baselines.begin(), baselines.end(), kPaperBaseline) != baselines.end())
      absl::StrAppendFormat(&text,
                            "\nThe paper reports ours / %s = %.2f, the geometric mean of RMSE over its own six "
                            "sequences.\n",
                            kPaperBaseline, kPaperRatio);
    return text;
  }

  absl::StatusOr<std::string> Uncertainty() {
    Rows rows = {{"clip", "mean gap of coverage", "< 1 sigma %", "< 2 sigma %", "< 3 sigma %", "RMS sigma / RMSE",
                  "sparsification mm", "best possible mm"}};
    LinePlot reliability{.title = "Reliability of the predicted deviation",
                         .x = {.title = "predicted standard deviation, mm", .logarithmic = true},
                         .y = {.title = "RMSE of pixels with that prediction, mm", .logarithmic = true}};
    double low = std::numeric_limits<double>::max(), high = 0.0;
    std::string plots;
    for (const ClipBenchmark& clip : benchmark_.clips) {
      if (!clip.depth) continue;
      const UncertaintyScore& score = clip.depth->score.methods[0].uncertainty;
      if (score.pixels == 0) continue;
      double sum_sigma2 = 0.0, sum_error2 = 0.0;
      PlotSeries& series = reliability.series.emplace_back(PlotSeries{.name = clip.name, .marked = true});
      for (const auto& bin : score.reliability) {
        const auto pixels = static_cast<double>(bin.pixels);
        sum_sigma2 += pixels * bin.sigma_mm * bin.sigma_mm;
        sum_error2 += pixels * bin.rmse_mm * bin.rmse_mm;
        // Bins of a handful of pixels show chance, not reliability.
        if (pixels < 1e-4 * static_cast<double>(score.pixels)) continue;
        series.points.emplace_back(bin.sigma_mm, bin.rmse_mm);
        low = std::min(low, bin.sigma_mm), high = std::max(high, bin.sigma_mm);
      }
      std::vector<std::string> row = {clip.name, Cell(score.mean_coverage_gap, 3)};
      for (const auto& at : score.coverage)
        if (at.k == 1.0 || at.k == 2.0 || at.k == 3.0) row.push_back(Cell(100 * at.share, 1));
      row.push_back(Cell(sum_error2 > 0 ? std::sqrt(sum_sigma2 / sum_error2) : kNone, 2));
      row.push_back(Millimetres(score.sparsification_area_mm));
      row.push_back(Millimetres(score.oracle_area_mm));
      rows.push_back(std::move(row));

      LinePlot sparsification{
          .title = absl::StrCat("Sparsification, ", clip.name),
          .x = {.title = "pixels taken away, the least sure first, %"},
          .y = {.title = "RMSE of the rest, mm", .from_zero = true},
          .series = {{.name = "by predicted deviation"}, {.name = "best possible", .points = {}, .dashed = true}}};
      for (size_t i = 0; i < score.sparsification_mm.size(); ++i) {
        sparsification.series[0].points.emplace_back(static_cast<double>(i), score.sparsification_mm[i]);
        sparsification.series[1].points.emplace_back(static_cast<double>(i), score.oracle_mm[i]);
      }
      ASSIGN_OR_RETURN(const std::string shown, Show(sparsification, "sparsification-" + clip.name));
      plots += shown;
    }
    if (rows.size() == 1) return std::string();
    reliability.series.push_back({.name = "as predicted", .points = {{low, low}, {high, high}}, .dashed = true});
    ASSIGN_OR_RETURN(const std::string shown, Show(reliability, "reliability"));
    return "\n## Predicted uncertainty of ours\n\nA Gaussian has 68.3, 95.4 and 99.7 % below 1, 2 and 3 sigma. "
           "Sparsification: the mean RMSE while the least sure pixels are taken away step by step.\n\n" +
           Table(rows, 1) + shown + plots;
  }

  absl::StatusOr<std::string> Ablation() {
    const auto has = [](const ClipBenchmark& clip) { return clip.ablation.has_value(); };
    std::vector<std::string> parts;
    for (const ClipBenchmark& clip : benchmark_.clips)
      for (size_t m = 1; parts.size() + 1 < (clip.ablation ? clip.ablation->score.methods.size() : 0); ++m)
        parts.push_back(clip.ablation->score.methods[m].name);
    if (parts.empty()) return std::string();
    struct Column {
      const char* title;
      Measure measure;
    };
    const std::array<Column, 6> columns = {{{"RMSE", RmseIn(Region::kAll)},
                                            {"MAE", MaeOf},
                                            {"edge band", RmseIn(Region::kEdgeBand)},
                                            {"disoccluded", RmseIn(Region::kDisoccluded)},
                                            {"untextured", RmseIn(Region::kUntextured)},
                                            {"fast", RmseIn(Region::kFast)}}};
    // What is without / what is with, in percent more.
    const auto effect = [](const ClipBenchmark& clip, const std::string& part, const Measure& measure) {
      const MethodScore* const without = Find(*clip.ablation, part);
      return without == nullptr ? kNone : measure(*without) / measure(clip.ablation->score.methods[0]);
    };
    const auto percent = [](double ratio) {
      return std::isfinite(ratio) ? absl::StrFormat("%+.1f", 100 * (ratio - 1)) : "-";
    };

    std::string text =
        "\n## Ablation\n\nHow much larger an error is without the part, in percent: above zero, the part helps. "
        "The last row leaves the flow's motion alone.\n";
    BarPlot plot{.title = "RMSE without a part", .y_title = "more than with all parts, %", .groups = parts};
    for (const ClipKind kind : kKinds) {
      const std::vector<const ClipBenchmark*> clips = Clips(kind, has);
      if (clips.empty()) continue;
      Rows rows = {{"without"}};
      for (const Column& column : columns) rows[0].emplace_back(column.title);
      for (const ClipBenchmark* clip : clips) rows[0].push_back("RMSE " + clip->name);
      auto& series = plot.series.emplace_back(BarPlot::Series{.name = std::string(ClipKindName(kind))});
      for (const std::string& part : parts) {
        auto& row = rows.emplace_back(std::vector<std::string>{part});
        for (const Column& column : columns) {
          std::vector<double> values;
          for (const ClipBenchmark* clip : clips) values.push_back(effect(*clip, part, column.measure));
          const double mean = GeometricMean(values);
          if (&column == columns.data()) series.values.push_back(100 * (mean - 1));
          row.push_back(percent(mean));
        }
        for (const ClipBenchmark* clip : clips) row.push_back(percent(effect(*clip, part, columns[0].measure)));
      }
      absl::StrAppendFormat(&text, "\nGeometric mean over %d %s, and RMSE of each:\n\n%s", clips.size(),
                            std::string(ClipKindName(kind)), Table(rows, 1));
    }
    ASSIGN_OR_RETURN(const std::string shown, Show(plot, "ablation"));
    return text + shown;
  }

  absl::StatusOr<std::string> Parameters() {
    std::vector<const ClipBenchmark*> clips;
    for (const ClipBenchmark& clip : benchmark_.clips)
      if (!clip.parameters.empty()) clips.push_back(&clip);
    if (clips.empty()) return std::string();
    std::string text = "\n## Parameters\n\nRMSE in mm over the range of each number; the preset's value is in bold.\n";
    for (size_t p = 0; p < clips[0]->parameters.size(); ++p) {
      const ClipBenchmark::Parameter& first = clips[0]->parameters[p];
      Rows rows = {{first.name}};
      LinePlot plot{.title = absl::StrCat("RMSE over ", first.name),
                    .x = {.title = first.name},
                    .y = {.title = "RMSE, % of the preset's"}};
      for (size_t v = 0; v < first.scores.size(); ++v) {
        const double value = first.scores[v].first;
        rows.push_back({value == first.preset_value ? absl::StrFormat("**%g**", value) : absl::StrFormat("%g", value)});
      }
      for (const ClipBenchmark* clip : clips) {
        const ClipBenchmark::Parameter& parameter = clip->parameters[p];
        rows[0].push_back(clip->name);
        double at_preset = kNone;
        for (const auto& [value, score] : parameter.scores)
          if (value == parameter.preset_value) at_preset = score[Region::kAll].rmse_mm;
        PlotSeries& series = plot.series.emplace_back(PlotSeries{.name = clip->name, .marked = true});
        for (size_t v = 0; v < parameter.scores.size(); ++v) {
          const double rmse_mm = parameter.scores[v].second[Region::kAll].rmse_mm;
          rows[v + 1].push_back(Millimetres(rmse_mm));
          series.points.emplace_back(parameter.scores[v].first, 100 * rmse_mm / at_preset);
        }
      }
      ASSIGN_OR_RETURN(const std::string shown, Show(plot, "parameter-" + first.name));
      absl::StrAppend(&text, "\n", Table(rows, 1), shown);
    }
    return text;
  }

  absl::StatusOr<std::string> Ratios() {
    const auto has = [](const ClipBenchmark& clip) { return !clip.ratios.empty(); };
    if (std::none_of(benchmark_.clips.begin(), benchmark_.clips.end(), has)) return std::string();
    Rows rows = {{"clip", "colour per depth frame", "ours", "flow-warp", "ours / flow-warp", "edge band, ours",
                  "edge band, flow-warp"}};
    Rows growth = {{"clip", "from, to", "ours grows by", "flow-warp grows by"}};
    std::string plots;
    for (const ClipBenchmark& clip : benchmark_.clips) {
      if (!has(clip)) continue;
      LinePlot plot{.title = absl::StrCat("Error over the ratio of the rates, ", clip.name),
                    .x = {.title = "colour frames per depth frame", .from_zero = true},
                    .y = {.title = "RMSE, mm", .from_zero = true}};
      for (const MethodScore& m : clip.ratios[0].scores.score.methods)
        plot.series.push_back({.name = m.name, .points = {}, .marked = true});
      for (const ClipBenchmark::Ratio& ratio : clip.ratios) {
        const auto& methods = ratio.scores.score.methods;
        for (size_t m = 0; m < methods.size(); ++m)
          plot.series[m].points.emplace_back(ratio.color_per_depth, methods[m][Region::kAll].rmse_mm);
        rows.push_back({clip.name, absl::StrCat(ratio.color_per_depth), Millimetres(methods[0][Region::kAll].rmse_mm),
                        Millimetres(methods[1][Region::kAll].rmse_mm),
                        Cell(methods[0][Region::kAll].rmse_mm / methods[1][Region::kAll].rmse_mm, 3),
                        Millimetres(methods[0][Region::kEdgeBand].rmse_mm),
                        Millimetres(methods[1][Region::kEdgeBand].rmse_mm)});
      }
      const auto& from = clip.ratios.front();
      const auto& to = clip.ratios.back();
      const auto grows_mm = [&](size_t m) {
        return to.scores.score.methods[m][Region::kAll].rmse_mm - from.scores.score.methods[m][Region::kAll].rmse_mm;
      };
      growth.push_back({clip.name, absl::StrFormat("%d, %d", from.color_per_depth, to.color_per_depth),
                        Millimetres(grows_mm(0)), Millimetres(grows_mm(1))});
      ASSIGN_OR_RETURN(const std::string shown, Show(plot, "ratio-" + clip.name));
      plots += shown;
    }
    return "\n## Ratio of the rates\n\nFewer keys of the same recording, RMSE in mm; every row of a clip is scored on "
           "the "
           "same frames, at which no row has a key.\n\n" +
           Table(rows, 1) + "\n" + Table(growth, 2) + plots;
  }

  absl::StatusOr<std::string> SceneFlow() {
    Rows rows = {{"clip", "pairs", "method", "EPE3D", "RMSE_V", "median", "visible", "hidden", "near jumps", "moving",
                  "EPE2D px", "AAE (u,v,1) deg", "AAE (S,1) deg", "< 5 cm or 5 %", "< 10 cm or 10 %", "outliers %",
                  "complete %", "s per pair"}};
    Rows bounds = {{"clip", "pairs", "best baseline", "ours / best"}};
    Rows transfer = {
        {"clip", "method", "depth error %", "off by > 5 %", "colour error, levels", "covered %", "s per pair"}};
    std::string strips;
    for (const ClipBenchmark& clip : benchmark_.clips)
      for (const SceneFlowBenchmark& motion : clip.scene_flow) {
        const std::string pairs = absl::StrFormat("%d %s", motion.pairs, std::string(PairStepName(motion.step)));
        const auto epe_mm = [](const SceneFlowComparison::MethodScore& m, MotionRegion region) {
          return m[region].pixels > 0 ? 1000 * m[region].epe3d_m : kNone;
        };
        for (size_t i = 0; i < motion.scores.size(); ++i) {
          const SceneFlowComparison::MethodScore& m = motion.scores[i];
          const SceneFlowScore& all = m[MotionRegion::kAll];
          rows.push_back(
              {clip.name, pairs, m.name, Millimetres(epe_mm(m, MotionRegion::kAll)), Millimetres(1000 * all.rmse_v_m),
               Millimetres(1000 * all.median3d_m), Millimetres(epe_mm(m, MotionRegion::kVisible)),
               Millimetres(epe_mm(m, MotionRegion::kHidden)), Millimetres(epe_mm(m, MotionRegion::kNearJumps)),
               Millimetres(epe_mm(m, MotionRegion::kMoving)), Cell(all.epe2d_px, 3), Cell(all.aae_flow_deg, 2),
               Cell(all.aae_motion_deg, 3), Cell(100 * all.accurate_strict, 1), Cell(100 * all.accurate_relaxed, 1),
               Cell(100 * all.outliers, 1), Cell(100 * m.completeness, 1), Cell(motion.seconds[i], 2)});
        }
        if (motion.scores.size() > 1) {
          const auto best = std::min_element(motion.scores.begin() + 1, motion.scores.end(), [&](auto& a, auto& b) {
            return epe_mm(a, MotionRegion::kAll) < epe_mm(b, MotionRegion::kAll);
          });
          bounds.push_back({clip.name, pairs, best->name,
                            Cell(epe_mm(motion.scores[0], MotionRegion::kAll) / epe_mm(*best, MotionRegion::kAll), 3)});
        }
        for (size_t i = 0; i < motion.transfer.size(); ++i) {
          const TransferScore& t = motion.transfer[i];
          transfer.push_back({clip.name, t.name, Cell(100 * t.depth_error, 3), Cell(100 * t.depth_outliers, 2),
                              Cell(t.color_error, 2), Cell(100 * t.coverage, 1), Cell(motion.seconds[i], 2)});
        }
        if (motion.strip.empty()) continue;
        const std::string file =
            FileStem(absl::StrCat("motion-", clip.name, "-", std::string(PairStepName(motion.step)))) + ".png";
        RETURN_IF_ERROR(WritePngRgb8(JoinPath(dir_, file), motion.strip));
        absl::StrAppendFormat(&strips, "\n![Motion, %s, %s](%s)\n", clip.name, std::string(PairStepName(motion.step)),
                              file);
      }
    if (rows.size() == 1 && transfer.size() == 1) return std::string();
    std::string text =
        "\n## Scene flow\n\npd-flow, sr-flow and layered-flow are re-implementations of the ideas of Jaimez et al. "
        "2015, Quiroga et al. 2014 and Sun et al. 2015, not their authors' code.\n";
    if (rows.size() > 1)
      text +=
          "\nErrors of 3-D motion in mm (EPE3D: mean; visible, hidden, near jumps and moving: EPE3D of those pixels), "
          "pooled over the pairs, on the pixels that all methods answer. Outliers: above 30 cm, or above 1 cm and "
          "10 %.\n\n" +
          Table(rows, 3);
    if (bounds.size() > 1) text += "\n" + Table(bounds, 3);
    if (transfer.size() > 1)
      text +=
          "\nWithout true motion: the first frame's points, moved into the second frame, against what was measured "
          "there.\n\n" +
          Table(transfer, 2);
    return text + strips;
  }

  absl::StatusOr<std::string> Times() {
    if (benchmark_.times.empty()) return std::string();
    Rows rows = {{"preset", "threads", "interval s", "16 DIS flows s", "ratio", "stages s"}};
    for (const TimeBenchmark& time : benchmark_.times) {
      std::vector<std::string> stages;
      for (const auto& [stage, seconds] : time.stage_seconds)
        if (seconds >= 0.0005) stages.push_back(absl::StrFormat("%s %.3f", stage, seconds));
      rows.push_back({time.preset, absl::StrCat(time.threads), Cell(time.seconds, 3), Cell(time.flows_seconds, 3),
                      Cell(time.ratio, 2), absl::StrJoin(stages, ", ")});
    }
    return absl::StrFormat(
               "\n## Time\n\nOne interval of 8 frames of `kick` at %d x %d, beside 16 dense flows of OpenCV's DIS at "
               "preset medium, as many at a time as there are threads, in the same run: times drift with the machine, "
               "the ratio does not. Medians.\n\n",
               benchmark_.timed_width, benchmark_.timed_height) +
           Table(rows, 1);
  }

  const Benchmark& benchmark_;
  const std::string& dir_;
};

json ToJson(const SceneFlowBenchmark& motion) {
  json out = {{"pairs", motion.pairs}, {"step", std::string(PairStepName(motion.step))}};
  for (size_t i = 0; i < motion.scores.size(); ++i) {
    json& method = out["methods"].emplace_back(json{{"name", motion.scores[i].name},
                                                    {"completeness", motion.scores[i].completeness},
                                                    {"seconds", motion.seconds[i]}});
    for (const MotionRegion region : kMotionRegions) {
      const SceneFlowScore& score = motion.scores[i][region];
      method["regions"][std::string(MotionRegionName(region))] = {{"pixels", score.pixels},
                                                                  {"epe3d_m", score.epe3d_m},
                                                                  {"rmse_v_m", score.rmse_v_m},
                                                                  {"median3d_m", score.median3d_m},
                                                                  {"epe2d_px", score.epe2d_px},
                                                                  {"aae_flow_deg", score.aae_flow_deg},
                                                                  {"aae_motion_deg", score.aae_motion_deg},
                                                                  {"accurate_strict", score.accurate_strict},
                                                                  {"accurate_relaxed", score.accurate_relaxed},
                                                                  {"outliers", score.outliers}};
    }
  }
  for (size_t i = 0; i < motion.transfer.size(); ++i) {
    const TransferScore& score = motion.transfer[i];
    out["transfer"].push_back({{"name", score.name},
                               {"pixels", score.pixels},
                               {"depth_error", score.depth_error},
                               {"depth_outliers", score.depth_outliers},
                               {"color_error_levels", score.color_error},
                               {"coverage", score.coverage},
                               {"seconds", motion.seconds[i]}});
  }
  return out;
}

}  // namespace

json ToJson(const Benchmark& benchmark) {
  json out = {{"version", DEPTHTWEEN_VERSION}, {"clips", json::array()}, {"times", json::array()}};
  for (const ClipBenchmark& clip : benchmark.clips) {
    json& added = out["clips"].emplace_back(
        json{{"name", clip.name}, {"kind", std::string(ClipKindName(clip.kind))}, {"key_every", clip.key_every}});
    if (clip.depth) added["depth"] = ToJson(*clip.depth);
    if (clip.ablation) added["ablation"] = ToJson(*clip.ablation);
    for (const ClipBenchmark::Parameter& parameter : clip.parameters) {
      json& values = added["parameters"][parameter.name] =
          json{{"preset_value", parameter.preset_value}, {"values", json::array()}};
      for (const auto& [value, score] : parameter.scores)
        values["values"].push_back({{"value", value},
                                    {"rmse_mm", score[Region::kAll].rmse_mm},
                                    {"mae_mm", score[Region::kAll].mae_mm},
                                    {"edge_band_rmse_mm", score[Region::kEdgeBand].rmse_mm}});
    }
    for (const ClipBenchmark::Ratio& ratio : clip.ratios)
      added["ratios"].push_back({{"color_per_depth", ratio.color_per_depth}, {"scores", ToJson(ratio.scores)}});
    for (const SceneFlowBenchmark& motion : clip.scene_flow) added["scene_flow"].push_back(ToJson(motion));
  }
  for (const TimeBenchmark& time : benchmark.times)
    out["times"].push_back({{"preset", time.preset},
                            {"threads", time.threads},
                            {"seconds", time.seconds},
                            {"flows_seconds", time.flows_seconds},
                            {"ratio", time.ratio},
                            {"stage_seconds", time.stage_seconds}});
  return out;
}

absl::Status WriteBenchmarkReport(const Benchmark& benchmark, const std::string& command, const std::string& dir) {
  RETURN_IF_ERROR(MakeFolder(dir));
  ASSIGN_OR_RETURN(const std::string markdown, Report(benchmark, dir).Markdown(command));
  json report = ToJson(benchmark);
  report["command"] = command;
  RETURN_IF_ERROR(WriteFile(JoinPath(dir, "report.json"), report.dump(1) + "\n"));
  return WriteFile(JoinPath(dir, "report.md"), markdown);
}

}  // namespace depthtween
