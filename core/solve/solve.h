// The joint optimisation: how the surface of a key moves towards the other key, seen by every frame between them.
//
// One direction; the caller runs it from both keys. Each point of the key's depth map, one per `step` pixels, gets a
// trajectory and a rotation in time that together fit the flow, the images, the other key's surface and rigidity around
// the point (energy.h). Gauss-Newton with conjugate gradients, matrix-free, preconditioned point by point and by rigid
// pieces (coarse_space.h), from the coarsest level to the finest; what is looked up in images is renewed in each outer
// iteration.
//
// Shapes:   images W x H of the camera; tracks and results on the grid: point (i, j) is pixel (i step, j step).
// Units:    metres, pixels, intervals.
// Errors:   InvalidArgument when the problem or the options do not validate.
// Threads:  safe to call concurrently; one call runs on one thread, so that sums have one order.
// Source:   Yuan et al., Temporal Upsampling of Depth Maps Using a Hybrid Camera, TVCG 2018, sections 3.1-3.5, 3.7. We
//           differ in the residuals as each term's header says, in the parameterisation, and in levels: a coarse point
//           is one of the fine ones, never a mean across a jump.
#ifndef DEPTHTWEEN_CORE_SOLVE_SOLVE_H_
#define DEPTHTWEEN_CORE_SOLVE_SOLVE_H_

#include <string>
#include <string_view>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/fill/depth_noise.h"
#include "core/geometry/camera.h"
#include "core/solve/energy.h"
#include "core/solve/ideal_pixels.h"

namespace depthtween {

// A depth map made ready as a source, with the colours it is seen in.
struct SolveKey {
  ImageView<const float> depth_m;
  ImageView<const Rgb8> color;
  ImageView<const uint8_t> luma;
};

// A frame after the key, in the direction of the other one.
struct SolveFrame {
  float time = 0;                  // intervals from the key: in (0, 1], the other key's frame at 1
  ImageView<const uint8_t> luma;   // may be empty without the term "opti"
  ImageView<const Flow2> track;    // from the key, on the grid
  ImageView<const Flow2> forward;  // from the frame before (the key, for the first) to this one; may be empty
  ImageView<const Flow2> back;     // from this frame to the one before; may be empty
};

struct SolveProblem {
  Camera camera;
  int step = 2;  // pixels between points
  SolveKey key, other;
  std::vector<SolveFrame> frames;  // ascending in time, the last one the other key's
  DepthNoise noise;
};

enum class MotionModel {
  kTrajectory,  // two coefficients for each point: velocity and acceleration
  kPerFrame,    // positions and rotations of every frame for themselves
};

// Choices of the paper that we differ from; each can be switched to its published form. Not listed: what has no meaning
// as published, such as the projection of a difference of points, and what is not the solver's, such as replacing the
// last frame by the key.
struct PrintedChoices {
  bool closest = false;    // partners are closest to where the point was in the key, not to where it is tracked
  bool coherence = false;  // w_d by distance alone (0.015 m), w_c by single levels of colour, without a rest
  bool kernels = false;    // E_point, E_plane and E_proj are squares
  bool occlusion = false;  // O by divergence of either sign and by brightness, not by the way back or by jumps
  bool point = false;      // E_point counts metres as E_plane does
  bool proj = false;       // E_proj has steps alone, from the second on, and no tracks
  bool rigid = false;      // E_rigid counts metres (SolveOptions::edge_sigma_m), whatever the length of the edge
  bool shortest = false;   // E_short penalises steps, not accelerations
  bool topology = false;   // edges are weighed by how their length changes (0.015 m) along tracks to the last but one
};

struct SolveOptions {
  MotionModel model = MotionModel::kTrajectory;
  // The paper's weights, of residuals in units of their own deviations.
  TermWeights weights{.opti = 8, .point = 9, .plane = 10, .proj = 5, .rigid = 16, .reg = 0.8F, .shortest = 7};
  // Detectors. Without them all data count alike, and only depth and colour cut edges.
  bool occlusion = true;
  bool topology = true;
  PrintedChoices printed;
  // Deviations that residuals are measured in.
  float step_sigma_px = 0.3F;           // of the flow between neighbouring frames; tracks add up their steps'
  float brightness_sigma = 0.02F;       // of image noise and interpolation, [0, 1]
  float strain_sigma = 0.03F;           // of a surface that bends
  float acceleration_sigma_px = 20.0F;  // of what moves, per interval^2
  float point_sigma_footprints = 4.0F;  // how far a surface may slide along its partner
  float edge_sigma_m = 1e-3F;           // of the ends of an edge to each other, where E_rigid is as printed
  // Schedule.
  int levels = 3;
  int outer_iterations = 1;      // per level
  int newton_iterations = 2;     // per outer one
  int conjugate_iterations = 8;  // at most, per Newton step

  // The paper's model and schedule: frames by themselves; on three levels five Gauss-Newton steps of at most ten
  // conjugate ones, what is looked up in images renewed before each.
  static SolveOptions Reference();

  // Switches a term or a detector off: opti, point, plane, proj, rigid, reg, short, occlusion, topology.
  // InvalidArgument lists them if `part` is none of them.
  absl::Status SwitchOff(std::string_view part);
  // False for names that are no part.
  bool Uses(std::string_view part) const;
  // Takes a choice as the paper prints it, one of LiteralNames() (core/options/upsample_options.h). InvalidArgument
  // lists them if `choice` is none of them.
  absl::Status TakeLiterally(std::string_view choice);
  absl::Status Validate() const;
};
const std::vector<std::string>& SolvePartNames();

struct SolveLevelSummary {
  int width = 0, height = 0;
  int newton_steps = 0, conjugate_steps = 0, refused_steps = 0;
  double first_cost = -1, last_cost = -1;  // after the first association, at the end
  double seconds = 0;
};
struct SolveSummary {
  std::string termination = "Solve was not called";  // "converged", "schedule ended" or "no step lowers the cost"
  std::vector<SolveLevelSummary> levels;             // coarsest first
  int points = -1, partners = -1;                    // of the finest level; those with a partner in the other key
  int cut_edges = -1;                                // by the change of topology
  double seconds = 0;
};

// The moving surface.
class SolvedMotion {
 public:
  SolvedMotion(IdealPixels pixels, EnergyData data, Planes unknowns)
      : pixels_(std::move(pixels)), data_(std::move(data)), unknowns_(std::move(unknowns)) {}
  // Where each point of the grid is seen in frame s (index into SolveProblem::frames), and its depth there. Points that
  // the key does not know have depth 0.
  void At(int frame, Image<Flow2>& position, Image<float>& depth_m) const;
  // The point in the key, and its motion to frame s, metres, in the camera's frame.
  Triple<float> PointAt(int i, int j) const;
  Triple<float> MotionOf(int i, int j, int frame) const;
  const EnergyData& data() const { return data_; }
  const Planes& unknowns() const { return unknowns_; }

 private:
  IdealPixels pixels_;
  EnergyData data_;  // of the finest level, as the last iteration saw it
  Planes unknowns_;
};

struct SolveResult {
  SolvedMotion motion;
  SolveSummary summary;
};

absl::StatusOr<SolveResult> Solve(const SolveProblem& problem, const SolveOptions& options);

// What a minimiser does with one frozen energy: up to `newton_iterations` steps from `unknowns` on.
SolveLevelSummary Minimise(const EnergyData& data, int newton_iterations, int conjugate_iterations, Planes& unknowns,
                           std::string& termination);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_SOLVE_H_
