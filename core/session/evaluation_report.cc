// The two forms of an evaluation: JSON for programs, tables for people.
#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/metrics/sensor_floor.h"
#include "core/session/evaluation.h"

namespace depthtween {
namespace {

using nlohmann::json;

// The numbers that claims are made of, as ratios ours / baseline.
struct RatioOf {
  const char* key;
  const char* title;
  double (*value)(const MethodScore& method);
};
constexpr std::array kRatios = {
    RatioOf{"rmse", "RMSE", [](const MethodScore& m) { return m[Region::kAll].rmse_mm; }},
    RatioOf{"mae", "MAE", [](const MethodScore& m) { return m[Region::kAll].mae_mm; }},
    RatioOf{"edge_band_rmse", "edge band", [](const MethodScore& m) { return m[Region::kEdgeBand].rmse_mm; }},
    RatioOf{"interior_rmse", "interior", [](const MethodScore& m) { return m[Region::kInterior].rmse_mm; }},
    RatioOf{"median", "median", [](const MethodScore& m) { return m[Region::kAll].median_mm; }},
};

json ScoreToJson(const DepthScore& score) {
  return {{"pixels", score.pixels},       {"rmse_mm", score.rmse_mm},       {"mae_mm", score.mae_mm},
          {"median_mm", score.median_mm}, {"within_1cm", score.within_1cm}, {"within_5cm", score.within_5cm}};
}

json UncertaintyToJson(const UncertaintyScore& score) {
  json coverage = json::array(), reliability = json::array();
  for (const auto& at : score.coverage)
    coverage.push_back({{"k", at.k}, {"share", at.share}, {"gaussian", at.gaussian}});
  for (const auto& bin : score.reliability)
    reliability.push_back({{"pixels", bin.pixels}, {"sigma_mm", bin.sigma_mm}, {"rmse_mm", bin.rmse_mm}});
  return {{"pixels", score.pixels},
          {"coverage", std::move(coverage)},
          {"mean_coverage_gap", score.mean_coverage_gap},
          {"reliability", std::move(reliability)},
          {"sparsification_mm", score.sparsification_mm},
          {"oracle_mm", score.oracle_mm},
          {"sparsification_area_mm", score.sparsification_area_mm},
          {"oracle_area_mm", score.oracle_area_mm}};
}

json MethodToJson(const MethodScore& method) {
  json out = {{"name", method.name}, {"completeness", method.completeness}, {"regions", json::object()}};
  for (Region region : kRegions)
    if (method[region].pixels > 0) out["regions"][std::string(RegionName(region))] = ScoreToJson(method[region]);
  if (method.edges.true_edges > 0)
    out["edges"] = {{"f1", method.edges.f1},
                    {"precision", method.edges.precision},
                    {"recall", method.edges.recall},
                    {"true_edges", method.edges.true_edges},
                    {"found_edges", method.edges.found_edges}};
  if (method[Region::kAll].pixels > 0)
    out["error_curve"] = {{"at_most_mm", kErrorCurveMm}, {"share", method.errors_below}};
  if (method.flicker_mm) out["flicker_mm"] = *method.flicker_mm;
  if (method.uncertainty.pixels > 0) out["uncertainty"] = UncertaintyToJson(method.uncertainty);
  return out;
}

std::string Percent(double share) { return absl::StrFormat("%.1f", 100.0 * share); }
std::string Number(double value) { return absl::StrFormat(value < 9.995 ? "%.2f" : "%.1f", value); }

// Right-aligned columns under a first, left-aligned one.
std::string Columns(const std::vector<std::vector<std::string>>& rows) {
  std::vector<size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  }
  std::string text;
  for (const auto& row : rows) {
    absl::StrAppendFormat(&text, "%-*s", static_cast<int>(widths[0]), row[0]);
    for (size_t c = 1; c < row.size(); ++c) absl::StrAppendFormat(&text, "  %*s", static_cast<int>(widths[c]), row[c]);
    text += '\n';
  }
  return text;
}

std::string ScoreTable(const Evaluation& evaluation) {
  std::vector<std::vector<std::string>> rows = {
      {"", "RMSE", "MAE", "edge band", "interior", "median", "<1 cm", "<5 cm", "edge F1", "complete"},
      {"method", "mm", "mm", "RMSE mm", "RMSE mm", "mm", "%", "%", "%", "%"}};
  for (const MethodScore& m : evaluation.score.methods) {
    const DepthScore& all = m[Region::kAll];
    rows.push_back({m.name, Number(all.rmse_mm), Number(all.mae_mm), Number(m[Region::kEdgeBand].rmse_mm),
                    Number(m[Region::kInterior].rmse_mm), Number(all.median_mm), Percent(all.within_1cm),
                    Percent(all.within_5cm), m.edges.true_edges > 0 ? Percent(m.edges.f1) : "-",
                    Percent(m.completeness)});
  }
  return Columns(rows);
}

std::string RatioTable(const Evaluation& evaluation) {
  const auto& methods = evaluation.score.methods;
  if (methods.size() < 2) return "";
  std::vector<std::vector<std::string>> rows = {{"ratio"}};
  for (const RatioOf& ratio : kRatios) rows[0].push_back(ratio.title);
  for (size_t m = 1; m < methods.size(); ++m) {
    auto& row = rows.emplace_back();
    row.push_back(methods[0].name + " / " + methods[m].name);
    for (const RatioOf& ratio : kRatios) {
      const double theirs = ratio.value(methods[m]);
      row.push_back(theirs > 0.0 ? absl::StrFormat("%.3f", ratio.value(methods[0]) / theirs) : "-");
    }
  }
  return "\n" + Columns(rows);
}

// RMSE by kind of motion, and flicker; only rendered sequences know them.
std::string MotionTable(const Evaluation& evaluation) {
  const auto& methods = evaluation.score.methods;
  const bool known = std::any_of(methods.begin(), methods.end(), [](const MethodScore& m) {
    return m.flicker_mm.has_value() || m[Region::kMoving].pixels + m[Region::kStatic].pixels > 0;
  });
  if (!known) return "";
  std::vector<std::vector<std::string>> rows = {
      {"", "moving", "fast", "static", "disoccluded", "untextured", "flicker"},
      {"method", "RMSE mm", "RMSE mm", "RMSE mm", "RMSE mm", "RMSE mm", "mm"}};
  const auto cell = [](const DepthScore& score) { return score.pixels > 0 ? Number(score.rmse_mm) : std::string("-"); };
  for (const MethodScore& m : methods)
    rows.push_back({m.name, cell(m[Region::kMoving]), cell(m[Region::kFast]), cell(m[Region::kStatic]),
                    cell(m[Region::kDisoccluded]), cell(m[Region::kUntextured]),
                    m.flicker_mm ? Number(*m.flicker_mm) : "-"});
  return "\n" + Columns(rows);
}

std::string UncertaintyLine(const MethodScore& method) {
  const UncertaintyScore& score = method.uncertainty;
  if (score.pixels == 0) return "";
  std::vector<std::string> shares;
  for (const auto& at : score.coverage)
    if (at.k == 1.0 || at.k == 2.0 || at.k == 3.0)
      shares.push_back(
          absl::StrFormat("%.1f %% below %g sigma (Gaussian: %.1f %%)", 100 * at.share, at.k, 100 * at.gaussian));
  return absl::StrFormat("\nuncertainty of %s: error %s; area under sparsification curve %s mm, best possible %s mm\n",
                         method.name, absl::StrJoin(shares, ", "), Number(score.sparsification_area_mm),
                         Number(score.oracle_area_mm));
}

std::string WorstFrames(const Evaluation& evaluation, int count) {
  if (count <= 0) return "";
  std::vector<size_t> order(evaluation.score.frames.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return evaluation.score.frames[a].rmse_mm[0] > evaluation.score.frames[b].rmse_mm[0];
  });
  order.resize(std::min<size_t>(order.size(), count));
  std::vector<std::vector<std::string>> rows = {{"worst frames, RMSE mm"}};
  for (const MethodScore& m : evaluation.score.methods) rows[0].push_back(m.name);
  for (size_t i : order) {
    auto& row = rows.emplace_back();
    row.push_back(evaluation.frame_stems[i]);
    for (double rmse_mm : evaluation.score.frames[i].rmse_mm) row.push_back(Number(rmse_mm));
  }
  return "\n" + Columns(rows);
}

double CommonShare(const ComparisonScore& score) {
  return score.truth_pixels > 0 ? static_cast<double>(score.common_pixels) / static_cast<double>(score.truth_pixels)
                                : 0.0;
}

double RmseLessNoise(const ClipScores& scores, size_t method) {
  return LessTruthNoise(scores.score.methods[method][Region::kAll].rmse_mm, scores.sensor_floor->rmse_mm);
}

}  // namespace

json ToJson(const ClipScores& scores) {
  const ComparisonScore& score = scores.score;
  json out = {{"key_every", scores.key_every},
              {"truth", scores.truth},
              {"far_m", scores.far_m},
              {"notes", scores.notes},
              {"frames_scored", score.frames.size()},
              {"truth_pixels", score.truth_pixels},
              {"common_pixels", score.common_pixels},
              {"methods", json::array()},
              {"ratios", json::object()},
              {"frames", json::array()}};
  for (const MethodScore& method : score.methods) out["methods"].push_back(MethodToJson(method));
  for (size_t m = 1; m < score.methods.size(); ++m) {
    json& ratios = out["ratios"][score.methods[m].name] = json::object();
    for (const RatioOf& ratio : kRatios)
      if (const double theirs = ratio.value(score.methods[m]); theirs > 0.0)
        ratios[ratio.key] = ratio.value(score.methods[0]) / theirs;
  }
  for (size_t i = 0; i < score.frames.size(); ++i) {
    json rmse_mm = json::object();
    for (size_t m = 0; m < score.methods.size(); ++m) rmse_mm[score.methods[m].name] = score.frames[i].rmse_mm[m];
    out["frames"].push_back(
        {{"stem", scores.frame_stems[i]}, {"pixels", score.frames[i].pixels}, {"rmse_mm", std::move(rmse_mm)}});
  }
  if (scores.sensor_floor) {
    out["sensor_floor"] = ScoreToJson(*scores.sensor_floor);
    for (size_t m = 0; m < score.methods.size(); ++m)
      out["methods"][m]["rmse_less_truth_noise_mm"] = RmseLessNoise(scores, m);
  }
  return out;
}

json ToJson(const Evaluation& evaluation) {
  json out = ToJson(static_cast<const ClipScores&>(evaluation));
  out["result"] = evaluation.result_dir;
  out["reference"] = evaluation.reference_dir;
  out["method"] = evaluation.method;
  return out;
}

std::string FormatTable(const Evaluation& evaluation, int worst_frames) {
  const ComparisonScore& score = evaluation.score;
  std::string text = absl::StrFormat(
      "%s against %s: %d frames, truth: %s, input: %s\n"
      "scored where truth is known within %g m and all methods answer: %.1f %% of %d pixels\n\n",
      evaluation.result_dir, evaluation.reference_dir, score.frames.size(), evaluation.truth,
      evaluation.key_every == 1 ? std::string("all depth maps")
                                : absl::StrFormat("1 in %d depth maps", evaluation.key_every),
      evaluation.far_m, 100.0 * CommonShare(score), score.truth_pixels);
  text += ScoreTable(evaluation) + RatioTable(evaluation) + MotionTable(evaluation) + UncertaintyLine(score.methods[0]);
  if (evaluation.sensor_floor)
    absl::StrAppendFormat(
        &text, "\nsensor floor: consecutive depth maps differ by %s mm RMSE, %s mm MAE where nothing moves\n",
        Number(evaluation.sensor_floor->rmse_mm), Number(evaluation.sensor_floor->mae_mm));
  if (evaluation.sensor_floor) {
    text += "RMSE less the truth's own noise, in mm:";
    for (size_t m = 0; m < score.methods.size(); ++m)
      absl::StrAppend(&text, m == 0 ? " " : ", ", score.methods[m].name, " ", Number(RmseLessNoise(evaluation, m)));
    text += "\n";
  }
  for (const std::string& note : evaluation.notes) text += "note: " + note + "\n";
  return text + WorstFrames(evaluation, worst_frames);
}

}  // namespace depthtween
