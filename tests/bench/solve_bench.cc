// The joint optimisation by itself: what it finds on the library's scenes, and its time beside Ceres'.
//
//   solve_bench accuracy [SCENES [NAME=VALUE...]]
//       For the first interval of each scene (comma separated; default all that move): error of the motion of the key's
//       points, in millimetres to the other key and in the middle, of composed flow with the other key's depth at its
//       end, and of the solve. Trimmed at kWorstM: a point on the wrong surface is wrong, not infinitely so. Masks:
//       seen in both keys; hidden in the other; within 8 px of a depth jump; elsewhere. Also processor seconds per key,
//       beside one DIS-medium flow. NAME=VALUE sets a field of SolveOptions; without=PART,... switches parts off,
//       literal=NAME,... takes choices as printed.
//   solve_bench ceres [POINTS_X POINTS_Y]
//       Processor seconds, on one thread, until the cost of a frozen energy is within 1 % of the least: of a turning,
//       accelerating plane in four frames, one track in eleven wrong, from its tracks and from a start that is off by
//       0.01 m and rad in each coefficient. Ours, and Ceres with automatic derivatives and whichever of its linear
//       solvers is fastest there, each stopped at the first iterate that is good enough; building Ceres' problem is not
//       counted. Medians of 5. Default: three sizes of each model.
//
// Build: cmake -S . -B build/bench -G Ninja -DCMAKE_BUILD_TYPE=Release -DDEPTHTWEEN_RPC=OFF && ninja -C build/bench
// solve_bench
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "core/flow/dense_flow.h"
#include "core/solve/solve.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/choose.h"
#include "core/upsample/keys.h"
#include "core/upsample/upsampler.h"
#include "opencv2/core.hpp"
#include "opencv2/video/tracking.hpp"
#include "tests/bench/timing.h"
#include "tests/core/solve/ceres_energy.h"
#include "tests/core/solve/some_level.h"

namespace depthtween {
namespace {

constexpr double kWorstM = 0.5;
constexpr int kConjugateSteps = 500, kCeresIterations = 50;
constexpr int kFrames = 8, kStep = 2, kNearJumpPx = 8;
constexpr const char* kScenes = "kick,bounce,cloth,turntable,pan";

// Of this thread's work: neighbours on the machine do not count.
template <typename Body>
double ProcessorSeconds(const Body& body) {
  const std::clock_t start = std::clock();
  body();
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

// One interval as the pipeline sees it, and the truth.
struct Clip {
  Camera camera;
  DepthNoise noise;
  Key keys[2];
  std::vector<Image<Rgb8>> color;
  std::vector<Image<uint8_t>> luma;
  std::vector<Image<Flow2>> forward, back, tracks;
  MotionTruth to_other, to_middle;
  Image<uint8_t> near_jump;
};

absl::StatusOr<Clip> MakeClip(const std::string& scene) {
  SyntheticOptions options;
  options.scene = scene;
  options.frames = kFrames + 1;
  ASSIGN_OR_RETURN(const auto rendered, SyntheticSequence::Create(options, 2));
  ASSIGN_OR_RETURN(const ClipConstants constants, EstimateClipConstants(*rendered));
  Clip clip{.camera = rendered->sequence().camera,
            .noise = {static_cast<float>(constants.noise_a_m), static_cast<float>(constants.noise_b_per_m)}};
  for (int s = 0; s <= kFrames; ++s) {
    ASSIGN_OR_RETURN(clip.color.emplace_back(), rendered->Color(s));
    clip.luma.push_back(Luma(clip.color.back()));
  }
  for (int side = 0; side < 2; ++side) {
    clip.keys[side] = LocateKey(rendered->sequence(), side);
    ASSIGN_OR_RETURN(const Image<float> depth, rendered->Depth(side));
    PrepareKey(depth, clip.color[side * kFrames], clip.noise, 2, clip.keys[side]);
  }
  const DenseFlowOptions neighbours{
      .finest_scale = 1, .patch_stride = 4, .descent_iterations = 16, .refinement_iterations = 0};
  clip.tracks.emplace_back(clip.camera.width / kStep, clip.camera.height / kStep);
  for (int s = 0; s < kFrames; ++s) {
    ASSIGN_OR_RETURN(clip.forward.emplace_back(), DenseFlow(clip.luma[s], clip.luma[s + 1], neighbours));
    ASSIGN_OR_RETURN(clip.back.emplace_back(), DenseFlow(clip.luma[s + 1], clip.luma[s], neighbours));
    clip.tracks.push_back(Compose(clip.tracks.back(), clip.forward.back(), kStep));
  }
  const Renderer key = rendered->ColorView(0);
  clip.to_other = key.MotionTo(rendered->ColorView(kFrames), 2);
  clip.to_middle = key.MotionTo(rendered->ColorView(kFrames / 2), 2);
  clip.near_jump = NearDepthJumps(key.Surface(2).depth_m, kNearJumpPx, clip.noise, 2);
  return clip;
}

SolveProblem ProblemOf(const Clip& clip) {
  SolveProblem problem{.camera = clip.camera,
                       .step = kStep,
                       .key = {clip.keys[0].depth_m, clip.color.front(), clip.luma.front()},
                       .other = {clip.keys[1].depth_m, clip.color.back(), clip.luma.back()},
                       .noise = clip.noise};
  for (int s = 1; s <= kFrames; ++s)
    problem.frames.push_back(
        {static_cast<float>(s) / kFrames, clip.luma[s], clip.tracks[s], clip.forward[s - 1], clip.back[s - 1]});
  return problem;
}

// Mean errors in the masks: seen, hidden, near a jump, elsewhere.
struct Errors {
  double sum[4] = {}, count[4] = {};
  void Add(double error, bool hidden, bool near) {
    for (const int mask : {hidden ? 1 : 0, near ? 2 : 3}) sum[mask] += std::min(error, kWorstM), count[mask] += 1;
  }
};

// `motion(i, j, frame)` of a point of the grid, metres.
template <typename Motion>
Errors ErrorsOf(const Clip& clip, const MotionTruth& truth, int frame, const Motion& motion) {
  Errors errors;
  for (int j = 0; j < clip.tracks[0].height(); ++j)
    for (int i = 0; i < clip.tracks[0].width(); ++i) {
      const int x = i * kStep, y = j * kStep;
      if (!truth.valid(x, y)) continue;
      const Float3 t = truth.scene_flow(x, y);
      const Triple<float> m = motion(i, j, frame);
      errors.Add(std::sqrt((m.x - t.x) * (m.x - t.x) + (m.y - t.y) * (m.y - t.y) + (m.z - t.z) * (m.z - t.z)),
                 truth.occluded(x, y) > 0, clip.near_jump(x, y) > 0);
    }
  return errors;
}

// Composed flow; depth linear in time towards the other key's at its end, if that is its layer.
Triple<float> TrackMotion(const Clip& clip, const IdealPixels& pixels, int i, int j, int frame) {
  constexpr float kSameSurface = 0.2F;
  const auto x = static_cast<float>(i * kStep), y = static_cast<float>(j * kStep);
  const Flow2 now = clip.tracks[frame](i, j), end = clip.tracks[kFrames](i, j);
  const float z = clip.keys[0].depth_m(i * kStep, j * kStep);
  const float z_end = SampleDepthInLayer(clip.keys[1].depth_m, x + end.u, y + end.v, clip.noise);
  const bool same = z > 0 && z_end > 0 && std::abs(z_end - z) < kSameSurface * std::min(z, z_end);
  const float depth = same ? z + static_cast<float>(frame) / kFrames * (z_end - z) : z;
  return pixels.PointAt(x + now.u, y + now.v, depth) - pixels.PointAt(x, y, z);
}

absl::Status SetOption(const std::string& argument, SolveOptions& options) {
  const std::vector<std::string> words = absl::StrSplit(argument, absl::MaxSplits('=', 1));
  if (words.size() != 2) return absl::InvalidArgumentError(argument + ": must be NAME=VALUE");
  if (words[0] == "without") {
    for (const std::string& part : std::vector<std::string>(absl::StrSplit(words[1], ',')))
      RETURN_IF_ERROR(options.SwitchOff(part));
    return absl::OkStatus();
  }
  if (words[0] == "literal") {
    for (const std::string& choice : std::vector<std::string>(absl::StrSplit(words[1], ',')))
      RETURN_IF_ERROR(options.TakeLiterally(choice));
    return absl::OkStatus();
  }
  const double value = std::atof(words[1].c_str());
  const std::pair<const char*, float*> kNumbers[] = {{"opti", &options.weights.opti},
                                                     {"point", &options.weights.point},
                                                     {"plane", &options.weights.plane},
                                                     {"proj", &options.weights.proj},
                                                     {"rigid", &options.weights.rigid},
                                                     {"reg", &options.weights.reg},
                                                     {"short", &options.weights.shortest},
                                                     {"step_sigma_px", &options.step_sigma_px},
                                                     {"brightness_sigma", &options.brightness_sigma},
                                                     {"strain_sigma", &options.strain_sigma},
                                                     {"acceleration_sigma_px", &options.acceleration_sigma_px},
                                                     {"point_sigma_footprints", &options.point_sigma_footprints}};
  const std::pair<const char*, int*> kCounts[] = {{"levels", &options.levels},
                                                  {"outer_iterations", &options.outer_iterations},
                                                  {"newton_iterations", &options.newton_iterations},
                                                  {"conjugate_iterations", &options.conjugate_iterations}};
  for (const auto& [name, field] : kNumbers)
    if (words[0] == name) return *field = static_cast<float>(value), absl::OkStatus();
  for (const auto& [name, field] : kCounts)
    if (words[0] == name) return *field = static_cast<int>(value), absl::OkStatus();
  if (words[0] == "per_frame")
    return options.model = value > 0 ? MotionModel::kPerFrame : MotionModel::kTrajectory, absl::OkStatus();
  return absl::InvalidArgumentError(words[0] + ": not an option of the solve");
}

absl::Status Accuracy(const std::string& scenes, const SolveOptions& options) {
  std::printf("| scene | motion | to the other key: seen / hidden / near / elsewhere, mm | to the middle | s |\n");
  std::printf("|---|---|---|---|---|\n");
  double log_sum = 0;
  int count = 0;
  for (const std::string& scene : std::vector<std::string>(absl::StrSplit(scenes, ','))) {
    ASSIGN_OR_RETURN(const Clip clip, MakeClip(scene));
    const IdealPixels pixels(clip.camera);
    std::vector<double> seconds;
    absl::StatusOr<SolveResult> result = absl::UnknownError("not run");
    for (int round = 0; round < 3; ++round)
      seconds.push_back(ProcessorSeconds([&] { result = Solve(ProblemOf(clip), options); }));
    RETURN_IF_ERROR(result.status());
    const double flow_seconds = ProcessorSeconds([&] {
      const auto mat = [&](const Image<uint8_t>& image) {
        return cv::Mat(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.data()));
      };
      cv::Mat flow;
      cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)->calc(mat(clip.luma[0]), mat(clip.luma[1]), flow);
    });
    const auto print = [&](const char* name, const auto& motion, double time) {
      std::printf("| %s | %s |", scene.c_str(), name);
      double all = 0;
      for (const bool middle : {false, true}) {
        const Errors errors =
            ErrorsOf(clip, middle ? clip.to_middle : clip.to_other, middle ? kFrames / 2 : kFrames, motion);
        for (int mask = 0; mask < 4; ++mask)
          std::printf("%s%.1f", mask ? " / " : " ", 1000 * errors.sum[mask] / std::max(1.0, errors.count[mask]));
        std::printf(" |");
        all += (errors.sum[0] + errors.sum[1]) / (errors.count[0] + errors.count[1]);
      }
      std::printf(" %.3f |\n", time);
      return all;
    };
    const double tracks = print(
        "composed flow", [&](int i, int j, int s) { return TrackMotion(clip, pixels, i, j, s); }, flow_seconds);
    const double solved = print(
        "solve", [&](int i, int j, int s) { return result->motion.MotionOf(i, j, s - 1); }, Median(seconds));
    log_sum += std::log(solved / tracks), ++count;
    const SolveSummary& summary = result->summary;
    std::fprintf(stderr, "%s: %s, %d points, %d partners, %d edges cut;", scene.c_str(), summary.termination.c_str(),
                 summary.points, summary.partners, summary.cut_edges);
    for (const SolveLevelSummary& level : summary.levels)
      std::fprintf(stderr, " %dx%d: %.0f -> %.0f (%d newton, %d cg, %d refused, %.3f s)", level.width, level.height,
                   level.first_cost, level.last_cost, level.newton_steps, level.conjugate_steps, level.refused_steps,
                   level.seconds);
    std::fprintf(stderr, "\n");
  }
  std::printf("\nGeometric mean of the solve's error over composed flow's: %.3f\n", std::exp(log_sum / count));
  return absl::OkStatus();
}

// Ends Ceres at the first iterate whose energy (twice Ceres' cost) is at most `bound`.
class StopAt : public ceres::IterationCallback {
 public:
  explicit StopAt(double bound) : bound_(bound) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    iterations_ = summary.iteration;
    reached_ = 2 * summary.cost <= bound_;
    return reached_ ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }
  int iterations() const { return iterations_; }
  bool reached() const { return reached_; }

 private:
  double bound_;
  int iterations_ = 0;
  bool reached_ = false;
};

struct CeresSolver {
  const char* name;
  ceres::LinearSolverType type;
  ceres::SparseLinearAlgebraLibraryType library = ceres::SUITE_SPARSE;
  ceres::PreconditionerType preconditioner = ceres::JACOBI;
};
constexpr CeresSolver kCeresSolvers[] = {
    {"SPARSE_NORMAL_CHOLESKY, SuiteSparse", ceres::SPARSE_NORMAL_CHOLESKY},
    {"SPARSE_NORMAL_CHOLESKY, Eigen", ceres::SPARSE_NORMAL_CHOLESKY, ceres::EIGEN_SPARSE},
    {"ITERATIVE_SCHUR", ceres::ITERATIVE_SCHUR, ceres::SUITE_SPARSE, ceres::SCHUR_JACOBI},
    {"CGNR", ceres::CGNR}};

absl::Status BesideCeres(MotionModel model, float off, int points_x, int points_y) {
  Planes start;
  const Level level = HardLevel({.model = model}, off, start, points_x, points_y);
  const auto ours = [&](int steps, double* seconds) {
    Planes unknowns = start.Clone();
    std::string termination;
    SolveLevelSummary summary;
    const double spent =
        ProcessorSeconds([&] { summary = Minimise(level.data, steps, kConjugateSteps, unknowns, termination); });
    if (seconds != nullptr) *seconds = spent;
    return summary;
  };
  struct Theirs {
    double seconds;
    int iterations;
    bool reached;
  };
  const auto theirs = [&](const CeresSolver& solver, double bound) {
    CeresEnergy energy(level.data, start);
    StopAt stop(bound);
    ceres::Solver::Options options;
    options.linear_solver_type = solver.type;
    options.sparse_linear_algebra_library_type = solver.library;
    options.preconditioner_type = solver.preconditioner;
    options.num_threads = 1;
    options.max_num_iterations = kCeresIterations;
    options.logging_type = ceres::SILENT;
    options.callbacks.push_back(&stop);
    const double seconds = ProcessorSeconds([&] { energy.Minimise(options); });
    return Theirs{seconds, stop.iterations(), stop.reached()};
  };
  const double least = ours(100, nullptr).last_cost, bound = 1.01 * least;
  int steps = 1;
  while (ours(steps, nullptr).last_cost > bound) ++steps;
  const CeresSolver* fastest = nullptr;
  double shortest = 0;
  for (const CeresSolver& solver : kCeresSolvers) {
    const Theirs tried = theirs(solver, bound);
    if (tried.reached && (fastest == nullptr || tried.seconds < shortest)) fastest = &solver, shortest = tried.seconds;
  }
  if (fastest == nullptr) return absl::InternalError(absl::StrFormat("Ceres did not come near %g", least));
  constexpr int kRounds = 5;
  std::vector<double> our_seconds(kRounds), their_seconds(kRounds);
  Theirs last{};
  SolveLevelSummary summary;
  for (int round = 0; round < kRounds; ++round) {
    summary = ours(steps, &our_seconds[round]);
    last = theirs(*fastest, bound);
    their_seconds[round] = last.seconds;
  }
  std::printf("| %d | %s | %s | %.1f | %.2f (%d, %d) | %.1f (%d, %s) | %.0f |\n",
              level.data.unknowns() * level.data.grid.width * level.data.grid.height,
              model == MotionModel::kTrajectory ? "trajectory" : "per frame", off > 0 ? "off by 0.01" : "tracks", least,
              1000 * Median(our_seconds), summary.newton_steps, summary.conjugate_steps, 1000 * Median(their_seconds),
              last.iterations, fastest->name, Median(their_seconds) / Median(our_seconds));
  std::fflush(stdout);
  return absl::OkStatus();
}

absl::Status BesideCeres(int points_x, int points_y) {
  std::printf(
      "| unknowns | model | start | least cost | ours, ms (Newton steps, conjugate ones) | Ceres, ms (iterations) | "
      "Ceres / ours |\n|---:|---|---|---:|---:|---:|---:|\n");
  struct Size {
    int x, y;
  };
  for (const MotionModel model : {MotionModel::kTrajectory, MotionModel::kPerFrame}) {
    std::vector<Size> sizes = {{13, 11}, {24, 20}, {41, 41}};
    if (model == MotionModel::kPerFrame) sizes[2] = {29, 29};  // as many unknowns
    if (points_x > 0) sizes = {{points_x, points_y}};
    for (const Size& size : sizes)
      for (const float off : {0.0F, 0.01F}) RETURN_IF_ERROR(BesideCeres(model, off, size.x, size.y));
  }
  return absl::OkStatus();
}

absl::Status Run(const std::vector<std::string>& arguments) {
  cv::setNumThreads(1);
  if (arguments.size() == 1 && arguments[0] == "ceres") return BesideCeres(0, 0);
  if (arguments.size() == 3 && arguments[0] == "ceres")
    return BesideCeres(std::atoi(arguments[1].c_str()), std::atoi(arguments[2].c_str()));
  if (arguments.empty() || arguments[0] != "accuracy")
    return absl::InvalidArgumentError(
        "usage: solve_bench accuracy [SCENES [NAME=VALUE...]], or solve_bench ceres [X Y]");
  SolveOptions options;
  for (size_t i = 2; i < arguments.size(); ++i) RETURN_IF_ERROR(SetOption(arguments[i], options));
  return Accuracy(arguments.size() > 1 ? arguments[1] : kScenes, options);
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  const absl::Status status = depthtween::Run({argv + 1, argv + argc});
  if (status.ok()) return 0;
  std::fprintf(stderr, "%s\n", std::string(status.message()).c_str());
  return 1;
}
