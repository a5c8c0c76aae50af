// Depth edges beside the edges of colour: why they lie apart, fitted for all edges of a recording together.
//
// The distance from a depth edge to its colour edge, along the normal, is a sum of causes, each of which moves edges in
// its own way: a clock that is late moves them by their speed, a camera beside the other by their nearness, and so on.
// Robust: each edge is drawn to the changes of colour around where the causes put it (mean shift).
//
// Units: pixels, milliseconds.  Threads: pure.
#ifndef DEPTHTWEEN_CORE_CAPTURE_EDGE_FIT_H_
#define DEPTHTWEEN_CORE_CAPTURE_EDGE_FIT_H_

#include <array>
#include <limits>
#include <vector>

#include <Eigen/Core>

#include "core/capture/depth_edges.h"
#include "core/capture/moving_picture.h"
#include "core/geometry/camera.h"
#include "core/sequence/registration.h"

namespace depthtween {

// What moves depth edges away from those of colour.
enum Cause {
  kMiddle,   // milliseconds by which the depth frame is later than thought, in the middle of the clip
  kGrowth,   // how much later at its end
  kRows,     // the same milliseconds, from the middle row to the last
  kOutside,  // pixels that depth edges lie outside of objects
  kRight,    // pixels that the depth image is shifted, where depth is the reference
  kDown,
  kLarger,  // pixels that it is too large by, at half its width from the middle
  kNearX,   // pixels that what is twice as near as the reference is shifted by, beyond the others
  kNearY,
  kCauses
};
using Causes = Eigen::Matrix<double, kCauses, 1>;
using CauseMatrix = Eigen::Matrix<double, kCauses, kCauses>;

inline constexpr float kReachPx = 6.0F, kSampleStepPx = 0.5F;
inline constexpr int kSamples = 2 * static_cast<int>(kReachPx / kSampleStepPx) + 1;

// One depth edge: how far each cause moves it, and where along its normal colour changes.
struct Comparison {
  Causes causes;
  std::array<float, kSamples> share;  // of all change there, for each place; sums to less than 1
  int part = 0;                       // of the image, below kParts
};
using Comparisons = std::vector<Comparison>;

// Parts of a recording that the spread of an estimate is taken from: runs of neighbouring keys, which see the same
// things, or parts of the image.
inline constexpr int kParts = 12;

// The edges of one depth frame as a picture shows them.
struct EdgeLook {
  double apart_ms = 0.0;  // the picture was taken so much later than the depth frame, as far as is known
  double place = 0.0;     // of the depth frame in the clip: -1 first .. 1 last
  int width = 0, height = 0;
  Registration registration;  // by which edges are moved before they are compared
};
Comparisons CompareEdges(const MovingPicture& picture, const std::vector<DepthEdge>& edges, const EdgeLook& look);

// How much nearer than the reference an edge is, as a share of how near that is; at most 100, since what is nearer
// still is a depth of next to nothing.
double Nearness(const DepthEdge& edge, double reference_m);

// Where an edge is seen once `registration` is applied.
DepthEdge Registered(DepthEdge edge, const Registration& registration, int width, int height);

// What is left out in turn, to see how much an estimate hangs on it.
enum class Parts { kOfTheClip, kOfTheImage };

struct EdgeFitOptions {
  // How large each cause may well be, one standard deviation: 0 = it is none; infinity = nothing is known.
  Causes sigma = Causes::Constant(std::numeric_limits<double>::infinity());
  float widest_px = kReachPx;  // how far edges may be from where they are looked for
  Parts parts = Parts::kOfTheClip;
  int threads = 1;  // changes nothing
};

struct EdgeFit {
  Causes causes = Causes::Zero();
  CauseMatrix covariance = CauseMatrix::Zero();
};
// One element of `keys` for each depth frame, in order of time.
Causes FitCauses(const std::vector<Comparisons>& keys, const EdgeFitOptions& options);
// With covariance: from what is told without each part in turn, and from how many edges there are.
EdgeFit FitWithCovariance(const std::vector<Comparisons>& keys, const EdgeFitOptions& options);

// The registration once the spatial causes of a fit, made with `registration` applied, are corrected too.
Registration Corrected(Registration registration, const Causes& causes, int width);

// Depth of the nearer surface at the middle one of all edges; 1 if there is none.
double MedianNearM(const std::vector<DepthEdge>& edges);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_EDGE_FIT_H_
