#include "core/capture/register.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/capture/edge_fit.h"
#include "core/capture/registration_search.h"
#include "core/fill/key_cleaning.h"

namespace depthtween {
namespace {

// How late the depth camera's clock, or the last row of colour, may well be; how far edges may lie outside of objects.
constexpr double kLagMs = 5.0, kOutsidePx = 2.0;

struct Key {
  int color = -1;
  double apart_ms = 0.0, place = 0.0;
  std::vector<DepthEdge> edges;
  EdgeScene scene;
  MovingPicture picture;
};

absl::StatusOr<Key> ReadKey(const FrameSource& source, int depth_index, double place, size_t max_edges) {
  const Sequence& sequence = source.sequence();
  Key key{.color = NearestColor(sequence, sequence.depth[depth_index].time_ns), .place = place};
  key.apart_ms = Milliseconds(sequence.color[key.color].time_ns - sequence.depth[depth_index].time_ns);
  ASSIGN_OR_RETURN(const Image<float> depth, source.Depth(depth_index));
  key.edges = FindDepthEdges(RemoveFlyingPixels(depth, DepthNoise(), 1));
  ASSIGN_OR_RETURN(const Image<Rgb8> color, source.Color(key.color));
  key.scene = EdgeScene(color, key.edges, max_edges);
  // Motion is no more than a cause beside others here, so that half the resolution tells enough of it.
  if (sequence.color.size() > 1) {
    ASSIGN_OR_RETURN(key.picture, ColorReader(source).Read(key.color, {.finest_scale = 1, .refinement_iterations = 0}));
  } else {
    ASSIGN_OR_RETURN(key.picture, MovingPicture::Make(color, color, 1.0, {.finest_scale = 3}));
  }
  return key;
}

// How far a registration moves the edges, and how far `covariance` leaves that open: root mean square, pixels.
struct Moves {
  double px = 0.0, sigma_px = 0.0;
};
Moves MovesOf(const std::vector<Key>& keys, const Registration& registration, const CauseMatrix& covariance, int width,
              int height) {
  const double middle_x = 0.5 * (width - 1), middle_y = 0.5 * (height - 1);
  double squares = 0, variance = 0, edges = 0;
  for (const Key& key : keys)
    for (const DepthEdge& edge : key.edges) {
      const Flow2 move = registration.Displacement(width, height, edge.x, edge.y, edge.near_m);
      squares += move.u * move.u + move.v * move.v;
      const double nearness = Nearness(edge, registration.reference_m);
      Causes x = Causes::Zero(), y = Causes::Zero();
      x(kRight) = 1, x(kLarger) = (edge.x - middle_x) / middle_x, x(kNearX) = nearness;
      y(kDown) = 1, y(kLarger) = (edge.y - middle_y) / middle_x, y(kNearY) = nearness;
      variance += x.dot(covariance * x) + y.dot(covariance * y);
      edges += 1;
    }
  if (edges == 0) return {};
  return {std::sqrt(squares / edges), std::sqrt(variance / edges)};
}

// All that is known of a recording's registration, as the fit goes on.
class Fitting {
 public:
  Fitting(std::vector<Key> keys, const Sequence& sequence, Registration start, int threads)
      : keys_(std::move(keys)),
        width_(sequence.camera.width),
        height_(sequence.camera.height),
        registration_(start),
        comparisons_(keys_.size()) {
    // The search was exact to about a cell of its own.
    const double cell = EdgeScene::CellPx(width_);
    options_ = {.widest_px = std::min(kReachPx, 3.0F * static_cast<float>(cell)),
                .parts = Parts::kOfTheImage,
                .threads = threads};
    options_.sigma << kLagMs, 0, kLagMs, kOutsidePx, cell, cell, cell, cell, cell;
  }

  EdgeFit Settle() {
    constexpr int kRounds = 3;
    for (int round = 0; round < kRounds; ++round) {
      Compare();
      registration_ = Corrected(registration_, FitCauses(comparisons_, options_), width_);
    }
    Compare();
    // What the search says holds back each step, and is no knowledge beside it.
    EdgeFitOptions free = options_;
    for (const Cause cause : {kRight, kDown, kLarger, kNearX, kNearY})
      if (free.sigma(cause) > 0) free.sigma(cause) = std::numeric_limits<double>::infinity();
    return FitWithCovariance(comparisons_, free);
  }
  // Takes scale and parallax for none where they cannot be told from it; whether anything changed.
  bool DropWhatIsNotTold(const EdgeFit& fit) {
    constexpr double kSignificant = 3.0;
    const auto told = [&](Cause cause, double px) {
      return std::abs(px) > kSignificant * std::sqrt(fit.covariance(cause, cause));
    };
    bool dropped = false;
    if (options_.sigma(kLarger) > 0 && !told(kLarger, (registration_.scale - 1) * 0.5 * (width_ - 1)))
      registration_.scale = 1, options_.sigma(kLarger) = 0, dropped = true;
    const double reference = registration_.reference_m;
    if (options_.sigma(kNearX) > 0 && !told(kNearX, registration_.parallax_x_px_m / reference))
      registration_.parallax_x_px_m = 0, options_.sigma(kNearX) = 0, dropped = true;
    if (options_.sigma(kNearY) > 0 && !told(kNearY, registration_.parallax_y_px_m / reference))
      registration_.parallax_y_px_m = 0, options_.sigma(kNearY) = 0, dropped = true;
    return dropped;
  }

  const std::vector<Key>& keys() const { return keys_; }
  const Registration& registration() const { return registration_; }
  int64_t edges() const {
    int64_t edges = 0;
    for (const Comparisons& of_key : comparisons_) edges += static_cast<int64_t>(of_key.size());
    return edges;
  }

 private:
  void Compare() {
    ParallelFor(static_cast<int>(keys_.size()), options_.threads, [&](int k) {
      comparisons_[k] = CompareEdges(keys_[k].picture, keys_[k].edges,
                                     {.apart_ms = keys_[k].apart_ms,
                                      .place = keys_[k].place,
                                      .width = width_,
                                      .height = height_,
                                      .registration = registration_});
    });
  }

  const std::vector<Key> keys_;
  const int width_, height_;
  Registration registration_;
  EdgeFitOptions options_;
  std::vector<Comparisons> comparisons_;
};

absl::StatusOr<std::vector<Key>> ReadKeys(const FrameSource& source, const RegisterOptions& options) {
  constexpr size_t kMaxSearchedEdges = 6000;  // of all keys: a vote of so many is sharp enough
  constexpr int64_t kMostPixels = int64_t{20} * 640 * 480, kFewestKeys = 4;
  const Camera& camera = source.sequence().camera;
  const int64_t affordable = std::max(kFewestKeys, kMostPixels / (int64_t{camera.width} * camera.height));
  const int total = static_cast<int>(source.sequence().depth.size());
  const int count = static_cast<int>(std::min<int64_t>({options.max_keys, total, affordable}));
  std::vector<Key> keys(count);
  std::vector<absl::Status> statuses(count);
  ParallelFor(count, options.threads, [&](int k) {
    const double along = count == 1 ? 0.5 : static_cast<double>(k) / (count - 1);
    auto key = options.stop.stop_requested()
                   ? absl::CancelledError("stopped")
                   : ReadKey(source, static_cast<int>(std::lround(along * (total - 1))), 2 * along - 1,
                             kMaxSearchedEdges / static_cast<size_t>(count) + 1);
    if (key.ok())
      keys[k] = *std::move(key);
    else
      statuses[k] = key.status();
  });
  for (const absl::Status& status : statuses) RETURN_IF_ERROR(status);
  return keys;
}

}  // namespace

absl::Status RegisterOptions::Validate() const {
  if (max_keys < 1)
    return absl::InvalidArgumentError(absl::StrFormat("RegisterOptions.max_keys = %d, must be > 0", max_keys));
  if (threads < 1)
    return absl::InvalidArgumentError(absl::StrFormat("RegisterOptions.threads = %d, must be > 0", threads));
  return absl::OkStatus();
}

absl::StatusOr<RegistrationEstimate> EstimateRegistration(const FrameSource& source, const RegisterOptions& options) {
  RETURN_IF_ERROR(options.Validate());
  const Sequence& sequence = source.sequence();
  ASSIGN_OR_RETURN(std::vector<Key> keys, ReadKeys(source, options));
  RegistrationEstimate estimate;
  std::vector<EdgeScene> scenes;
  std::vector<DepthEdge> edges;
  for (Key& key : keys) {
    estimate.keys += key.edges.empty() ? 0 : 1;
    edges.insert(edges.end(), key.edges.begin(), key.edges.end());
    scenes.push_back(std::move(key.scene));
  }
  if (edges.empty()) {
    estimate.reason = "no depth frame has an edge";
    return estimate;
  }
  const double reference_m = MedianNearM(edges);
  const RegistrationSearch search = SearchRegistration(scenes, reference_m, options.threads);
  if (options.stop.stop_requested()) return absl::CancelledError("stopped");

  Fitting fitting(std::move(keys), sequence, search.best, options.threads);
  EdgeFit fit = fitting.Settle();
  if (fitting.DropWhatIsNotTold(fit)) fit = fitting.Settle();
  const int width = sequence.camera.width;
  const Moves moves = MovesOf(fitting.keys(), fitting.registration(), fit.covariance, width, sequence.camera.height);
  const auto sigma = [&](Cause cause) { return std::sqrt(fit.covariance(cause, cause)); };
  estimate.model = fitting.registration();
  estimate.shift_sigma_px = std::max(sigma(kRight), sigma(kDown));
  estimate.scale_sigma = sigma(kLarger) / (0.5 * (width - 1));
  estimate.parallax_sigma_px_m = reference_m * std::max(sigma(kNearX), sigma(kNearY));
  estimate.moves_px = moves.px;
  estimate.moves_sigma_px = moves.sigma_px;
  estimate.edges = fitting.edges();

  const double all = estimate.moves_px + estimate.moves_sigma_px + estimate.shift_sigma_px + estimate.scale_sigma +
                     estimate.parallax_sigma_px_m + estimate.model.right_px + estimate.model.down_px +
                     estimate.model.scale + estimate.model.parallax_x_px_m + estimate.model.parallax_y_px_m;
  if (!std::isfinite(all)) return RegistrationEstimate{.reason = "depth beyond all reason", .keys = estimate.keys};

  // What the fit makes of a search must not be worse than it; and edges that hardly meet colour anywhere tell nothing.
  constexpr double kKept = 0.8, kTellingPx = 1.0, kTellingShare = 0.2;
  const double met = MeanVote(scenes, estimate.model);
  if (estimate.edges == 0)
    estimate.reason = "no depth frame has an edge that colour shows too";
  else if (met < kLeastMet)
    estimate.reason = "no shift, scale and parallax brings the edges of depth to those of colour";
  else if (met < kKept * search.best_met)
    estimate.reason = "another place may be better, and too few edges tell";
  else if (!(estimate.moves_sigma_px < std::max(kTellingPx, kTellingShare * estimate.moves_px)))
    estimate.reason =
        absl::StrFormat("too few edges: where they belong is known to +-%.1f px", estimate.moves_sigma_px);
  return estimate;
}

}  // namespace depthtween
