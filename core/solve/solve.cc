#include "core/solve/solve.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/options/upsample_options.h"
#include "core/solve/association.h"
#include "core/solve/level.h"

namespace depthtween {
namespace {

absl::Status Check(const SolveProblem& problem, const SolveOptions& options) {
  RETURN_IF_ERROR(problem.camera.Validate());
  RETURN_IF_ERROR(options.Validate());
  const auto error = [](const char* field, double value, const std::string& rule) {
    return absl::InvalidArgumentError(absl::StrFormat("SolveProblem.%s = %g, must be %s", field, value, rule));
  };
  const int width = problem.camera.width, height = problem.camera.height;
  if (problem.step < 1 || problem.step > 16) return error("step", problem.step, "between 1 and 16");
  for (const SolveKey* key : {&problem.key, &problem.other}) {
    if (key->depth_m.width() != width || key->depth_m.height() != height)
      return error("depth_m.width", key->depth_m.width(), absl::StrFormat("of a %d x %d image", width, height));
    if (!key->color.SameSize(key->depth_m)) return error("color.width", key->color.width(), "as wide as depth_m");
  }
  if (problem.frames.empty()) return error("frames.size", 0, "at least 1");
  float before = 0;
  for (const SolveFrame& frame : problem.frames) {
    if (!(frame.time > before)) return error("frames.time", frame.time, "positive and ascending");
    before = frame.time;
    if (frame.track.width() < 1 || (frame.track.width() - 1) * problem.step >= width ||
        (frame.track.height() - 1) * problem.step >= height || !frame.track.SameSize(problem.frames[0].track))
      return error("frames.track.width", frame.track.width(), "the grid's: one point per step pixels");
    if (options.weights.opti > 0 && frame.luma.width() != width && !frame.luma.empty())
      return error("frames.luma.width", frame.luma.width(), "the camera's");
    for (const auto* flow : {&frame.forward, &frame.back})
      if (!flow->empty() && !flow->SameSize(problem.key.depth_m))
        return error("frames.forward.width", flow->width(), "the camera's, as back's");
  }
  if (!problem.key.luma.empty() && !problem.key.luma.SameSize(problem.key.depth_m))
    return error("key.luma.width", problem.key.luma.width(), "the camera's");
  return absl::OkStatus();
}

struct SolvePart {
  std::string_view name;
  float TermWeights::*weight;    // of a term, ...
  bool SolveOptions::*detector;  // ... else null
};
constexpr SolvePart kSolveParts[] = {
    {"opti", &TermWeights::opti, nullptr},         {"point", &TermWeights::point, nullptr},
    {"plane", &TermWeights::plane, nullptr},       {"proj", &TermWeights::proj, nullptr},
    {"rigid", &TermWeights::rigid, nullptr},       {"reg", &TermWeights::reg, nullptr},
    {"short", &TermWeights::shortest, nullptr},    {"occlusion", nullptr, &SolveOptions::occlusion},
    {"topology", nullptr, &SolveOptions::topology}};

const SolvePart* FindSolvePart(std::string_view name) {
  const auto* const part =
      std::find_if(std::begin(kSolveParts), std::end(kSolveParts), [&](const SolvePart& p) { return p.name == name; });
  return part == std::end(kSolveParts) ? nullptr : part;
}

// What LiteralNames() names.
struct LiteralChoice {
  std::string_view name;
  bool PrintedChoices::*choice;
};
constexpr LiteralChoice kLiteralChoices[] = {
    {"closest", &PrintedChoices::closest},  {"coherence", &PrintedChoices::coherence},
    {"kernels", &PrintedChoices::kernels},  {"occlusion", &PrintedChoices::occlusion},
    {"point", &PrintedChoices::point},      {"proj", &PrintedChoices::proj},
    {"rigid", &PrintedChoices::rigid},      {"short", &PrintedChoices::shortest},
    {"topology", &PrintedChoices::topology}};

}  // namespace

absl::Status SolveOptions::TakeLiterally(std::string_view choice) {
  for (const LiteralChoice& known : kLiteralChoices)
    if (known.name == choice) return printed.*known.choice = true, absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("'%s' is no choice of the paper that can be taken literally: those are %s", std::string(choice),
                      absl::StrJoin(LiteralNames(), ", ")));
}

const std::vector<std::string>& SolvePartNames() {
  static const auto* const kNames = [] {
    auto* const names = new std::vector<std::string>;
    for (const SolvePart& part : kSolveParts) names->emplace_back(part.name);
    return names;
  }();
  return *kNames;
}

SolveOptions SolveOptions::Reference() {
  return {.model = MotionModel::kPerFrame,
          .levels = 3,
          .outer_iterations = 5,
          .newton_iterations = 1,
          .conjugate_iterations = 10};
}

bool SolveOptions::Uses(std::string_view part) const {
  const SolvePart* const known = FindSolvePart(part);
  if (known == nullptr) return false;
  return known->detector != nullptr ? this->*known->detector : weights.*known->weight > 0;
}

absl::Status SolveOptions::SwitchOff(std::string_view part) {
  const SolvePart* const known = FindSolvePart(part);
  if (known == nullptr)
    return absl::InvalidArgumentError(absl::StrFormat("'%s' is no part of the solve: the parts are %s",
                                                      std::string(part), absl::StrJoin(SolvePartNames(), ", ")));
  if (known->detector != nullptr) {
    this->*known->detector = false;
  } else {
    weights.*known->weight = 0;
  }
  return absl::OkStatus();
}

absl::Status SolveOptions::Validate() const {
  const auto error = [](const char* field, double value, const char* rule) {
    return absl::InvalidArgumentError(absl::StrFormat("SolveOptions.%s = %g, must be %s", field, value, rule));
  };
  const std::pair<const char*, float> kWeights[] = {
      {"opti", weights.opti},   {"point", weights.point}, {"plane", weights.plane},   {"proj", weights.proj},
      {"rigid", weights.rigid}, {"reg", weights.reg},     {"short", weights.shortest}};
  for (const auto& [name, value] : kWeights)
    if (!(value >= 0 && value <= 1e6F)) return error(name, value, "between 0 and 1e6");
  const std::pair<const char*, float> kDeviations[] = {{"step_sigma_px", step_sigma_px},
                                                       {"brightness_sigma", brightness_sigma},
                                                       {"strain_sigma", strain_sigma},
                                                       {"acceleration_sigma_px", acceleration_sigma_px},
                                                       {"point_sigma_footprints", point_sigma_footprints},
                                                       {"edge_sigma_m", edge_sigma_m}};
  for (const auto& [name, value] : kDeviations)
    if (!(value > 0 && value <= 1e6F)) return error(name, value, "above 0 and at most 1e6");
  if (levels < 1 || levels > 8) return error("levels", levels, "between 1 and 8");
  if (outer_iterations < 1 || outer_iterations > 100) return error("outer_iterations", outer_iterations, "1 to 100");
  if (newton_iterations < 1 || newton_iterations > 1000)
    return error("newton_iterations", newton_iterations, "1 to 1000");
  if (conjugate_iterations < 1 || conjugate_iterations > 10000)
    return error("conjugate_iterations", conjugate_iterations, "1 to 10000");
  return absl::OkStatus();
}

absl::StatusOr<SolveResult> Solve(const SolveProblem& problem, const SolveOptions& options) {
  RETURN_IF_ERROR(Check(problem, options));
  const auto start = std::chrono::steady_clock::now();
  IdealPixels pixels(problem.camera);
  const PartnerSurface other{problem.other.depth_m, problem.other.color, &pixels, problem.noise, problem.step};
  const Evidence evidence = GatherEvidence(problem, options, pixels);
  std::vector<Image<int32_t>> sources = DecimatePoints(evidence, problem.noise, options.levels);
  SolveSummary summary{.cut_edges = 0};
  Level level;
  Planes unknowns;
  for (int l = static_cast<int>(sources.size()) - 1; l >= 0; --l) {
    const auto level_start = std::chrono::steady_clock::now();
    Level next = MakeLevel(problem, options, pixels, evidence, std::move(sources[l]), 1 << l);
    Planes start_unknowns(next.data.grid, next.data.unknowns());
    if (unknowns.empty()) {
      StartFromTracks(problem, evidence, other, next, start_unknowns);
    } else {
      Prolong(level, unknowns, evidence, problem.noise, next, start_unknowns);
    }
    level = std::move(next);
    unknowns = std::move(start_unknowns);
    SolveLevelSummary total{.width = level.data.grid.width, .height = level.data.grid.height};
    for (int outer = 0; outer < options.outer_iterations; ++outer) {
      summary.partners = Associate(problem, options, pixels, evidence, other, unknowns, level);
      if (options.topology && outer == 0)
        summary.cut_edges = options.printed.topology ? WeighTopologyAsPrinted(evidence, level)
                                                     : CutTorn(problem, pixels, evidence, level);
      const SolveLevelSummary once =
          Minimise(level.data, options.newton_iterations, options.conjugate_iterations, unknowns, summary.termination);
      if (outer == 0) total.first_cost = once.first_cost;
      total.last_cost = once.last_cost;
      total.newton_steps += once.newton_steps;
      total.conjugate_steps += once.conjugate_steps;
      total.refused_steps += once.refused_steps;
    }
    total.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - level_start).count();
    summary.levels.push_back(total);
  }
  summary.points = 0;
  for (size_t p = 0; p < level.source.pixel_count(); ++p) summary.points += level.source.data()[p] >= 0;
  summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return SolveResult{SolvedMotion(std::move(pixels), std::move(level.data), std::move(unknowns)), std::move(summary)};
}

void SolvedMotion::At(int frame, Image<Flow2>& position, Image<float>& depth_m) const {
  const Grid& grid = data_.grid;
  position = Image<Flow2>(grid.width, grid.height);
  depth_m = Image<float>(grid.width, grid.height);
  for (int j = 0; j < grid.height; ++j)
    for (int i = 0; i < grid.width; ++i) {
      if (data_.exists[0][grid.at(i, j)] == 0) continue;
      const Triple<float> p = PointAt(i, j) + MotionOf(i, j, frame);
      if (!(p.z > 0)) continue;
      const PixelOf<float> ideal = Project(data_.camera, p);
      const PixelOf<float> seen = pixels_.Seen(ideal.u, ideal.v);
      position(i, j) = {seen.u, seen.v};
      depth_m(i, j) = p.z;
    }
}

Triple<float> SolvedMotion::PointAt(int i, int j) const {
  const ptrdiff_t at = data_.grid.at(i, j);
  return {data_.point[0][at], data_.point[1][at], data_.point[2][at]};
}

Triple<float> SolvedMotion::MotionOf(int i, int j, int frame) const {
  const ptrdiff_t at = data_.grid.at(i, j);
  Triple<float> motion{};
  for (int k = data_.basis.First(frame); k < data_.basis.End(frame); ++k) {
    const float b = data_.basis(frame, k);
    motion.x += b * unknowns_[3 * k][at], motion.y += b * unknowns_[3 * k + 1][at];
    motion.z += b * unknowns_[3 * k + 2][at];
  }
  return motion;
}

}  // namespace depthtween
