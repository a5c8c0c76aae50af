#include "core/capture/synchronise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/capture/depth_edges.h"
#include "core/capture/edge_fit.h"
#include "core/capture/moving_picture.h"
#include "core/capture/registration_search.h"
#include "core/fill/key_cleaning.h"

namespace depthtween {
namespace {

struct KeyEdges {
  int depth_index = -1;
  double place = 0.0;  // of its stamp in the clip: -1 first .. 1 last
  std::vector<DepthEdge> edges;
};

// ---- Search ---------------------------------------------------------------------------------------------------------

// Shifts of a depth stamp that are tried, milliseconds: -half * step .. half * step.
struct ShiftGrid {
  double step_ms = 0.0;
  int half = 0;
  int count() const { return 2 * half + 1; }
  double At(int i) const { return (i - half) * step_ms; }
};

// How well the edges of a key meet those of colour, for each shift of its stamp: every edge has one vote, which it
// shares out among the shifts by the contrast found there. Edges that stand still give every shift the same.
absl::StatusOr<std::vector<float>> VotesForShifts(const FrameSource& source, const KeyEdges& key, const ShiftGrid& grid,
                                                  const Registration& registration) {
  constexpr DenseFlowOptions kQuickFlow{.finest_scale = 2, .descent_iterations = 12, .refinement_iterations = 0};
  constexpr size_t kMaxEdges = 1000;  // a vote of so many is sharp enough to tell where to look
  const Sequence& sequence = source.sequence();
  const double color_ms = Milliseconds(MedianPeriodNs(sequence.color));
  const int64_t stamp = sequence.depth[key.depth_index].time_ns;
  const size_t every = key.edges.size() / kMaxEdges + 1, edge_count = (key.edges.size() + every - 1) / every;
  std::vector<float> contrast(edge_count * grid.count(), 0.0F);
  ColorReader reader(source);
  MovingPicture picture;
  int held = -1;
  for (int i = 0; i < grid.count() && edge_count > 0; ++i) {
    const int64_t time = stamp + std::llround(1e6 * grid.At(i));
    const int color = NearestColor(sequence, time);
    const double apart_ms = Milliseconds(sequence.color[color].time_ns - time);
    if (std::abs(apart_ms) > color_ms) continue;  // beyond the stream there is nothing to compare with
    if (color != held) {
      ASSIGN_OR_RETURN(picture, reader.Read(color, kQuickFlow));
      held = color;
    }
    for (size_t e = 0; e < edge_count; ++e) {
      const DepthEdge edge =
          Registered(key.edges[e * every], registration, sequence.camera.width, sequence.camera.height);
      if (!picture.Contains(edge.x, edge.y, 0)) continue;
      const MovingPicture::Moved moved = picture.Move(edge, apart_ms);
      if (!picture.Contains(moved.x, moved.y, 3)) continue;
      float best = 0;
      for (const float m : {-1.0F, 0.0F, 1.0F})
        best = std::max(best, picture.Contrast2(moved.x + m * edge.normal_x, moved.y + m * edge.normal_y, edge.normal_x,
                                                edge.normal_y));
      contrast[e * grid.count() + i] = best;
    }
  }
  std::vector<float> votes(grid.count(), 0.0F);
  for (size_t e = 0; e < edge_count; ++e) {
    const float* of_edge = &contrast[e * grid.count()];
    float sum = kNoiseContrast2;
    for (int i = 0; i < grid.count(); ++i) sum += of_edge[i];
    for (int i = 0; i < grid.count(); ++i) votes[i] += of_edge[i] / sum;
  }
  return votes;
}

float VoteAt(const std::vector<float>& votes, const ShiftGrid& grid, double shift_ms) {
  const double at = std::clamp(shift_ms / grid.step_ms + grid.half, 0.0, static_cast<double>(grid.count() - 1));
  const int i = std::min(static_cast<int>(at), grid.count() - 2);
  const auto a = static_cast<float>(at - i);
  return (1 - a) * votes[i] + a * votes[i + 1];
}

// What stamps are to be shifted by: in the middle of the clip, and how much more at its end.
struct Line {
  double middle_ms = 0.0, growth_ms = 0.0;
  double At(double place) const { return middle_ms + growth_ms * place; }
};

// The line that collects most votes, among those whose growth is at most `max_growth_ms`; stamps as they are unless it
// beats them beyond doubt.
Line FindLine(const std::vector<std::vector<float>>& votes, const std::vector<double>& places, const ShiftGrid& grid,
              double max_growth_ms) {
  const auto vote = [&](size_t k, const Line& line) { return VoteAt(votes[k], grid, line.At(places[k])); };
  const double step = 0.5 * grid.step_ms, reach = grid.At(grid.count() - 1);
  const int middles = 2 * grid.half, growths = static_cast<int>(std::min(max_growth_ms, reach) / step);
  Line best;
  double best_sum = -1.0;
  for (int i = -middles; i <= middles; ++i)
    for (int j = -growths; j <= growths; ++j) {
      const Line line{i * step, j * step};
      if (std::abs(line.middle_ms) + std::abs(line.growth_ms) > reach) continue;
      double sum = 0;
      for (size_t k = 0; k < votes.size(); ++k) sum += vote(k, line);
      if (sum > best_sum) best_sum = sum, best = line;
    }
  // The gain must be that of all parts of the clip, not that of a few chance meetings of edges. The best of a thousand
  // lines is 3 deviations above the mean by chance alone.
  constexpr double kBeyondChance = 4.0;
  double sum = 0, squares = 0;
  for (size_t k = 0; k < votes.size(); ++k) {
    const double gain = vote(k, best) - vote(k, Line());
    sum += gain, squares += gain * gain;
  }
  const double variance = std::max(0.0, squares - sum * sum / static_cast<double>(votes.size()));
  return sum > kBeyondChance * std::sqrt(variance) ? best : Line();
}

// ---- Fit ------------------------------------------------------------------------------------------------------------

absl::StatusOr<Comparisons> Compare(const FrameSource& source, const KeyEdges& key, double shift_ms,
                                    const Registration& registration) {
  constexpr DenseFlowOptions kFlow{.finest_scale = 0};
  const Sequence& sequence = source.sequence();
  const int64_t time = sequence.depth[key.depth_index].time_ns + std::llround(1e6 * shift_ms);
  const int color = NearestColor(sequence, time);
  const double apart_ms = Milliseconds(sequence.color[color].time_ns - time);
  if (key.edges.empty() || std::abs(apart_ms) > Milliseconds(MedianPeriodNs(sequence.color))) return Comparisons();
  ASSIGN_OR_RETURN(const MovingPicture picture, ColorReader(source).Read(color, kFlow));
  return CompareEdges(picture, key.edges,
                      {.apart_ms = apart_ms,
                       .place = key.place,
                       .width = sequence.camera.width,
                       .height = sequence.camera.height,
                       .registration = registration});
}

// A drift known no better than this is not known: crystals are within a few hundred of one another, and cameras that
// count frames at a nominal rate within some thousand.
constexpr double kTellingDriftPpm = 1000.0;

// ---- All together ---------------------------------------------------------------------------------------------------

// Depth frames that are searched in time, which is the dearest part: each looks at four periods of depth. And in place.
constexpr int kMaxSearchedInTime = 48, kMaxSearchedInPlace = 24;

std::vector<int> Spread(int count, int wanted) {
  const int n = std::min(count, wanted);
  std::vector<int> picked;
  picked.reserve(n);
  for (int i = 0; i < n; ++i) picked.push_back(static_cast<int>(static_cast<int64_t>(i) * (count - 1) / (n - 1)));
  return picked;
}

// Counts what is done, and runs bodies on all threads between two counts.
class Counter {
 public:
  Counter(const SynchroniseOptions& options, int total) : options_(options), total_(total) {}
  // Calls body(i) for i in [0, count). The first error in order is returned.
  absl::Status For(int count, const std::function<absl::Status(int)>& body) {
    for (int begin = 0; begin < count; begin += options_.threads) {
      if (options_.stop.stop_requested()) return absl::CancelledError("stopped");
      const int size = std::min(options_.threads, count - begin);
      std::vector<absl::Status> statuses(size);
      ParallelFor(size, options_.threads, [&](int i) { statuses[i] = body(begin + i); });
      for (const absl::Status& status : statuses) RETURN_IF_ERROR(status);
      done_ += size;
      if (options_.on_progress) options_.on_progress(done_, total_);
    }
    return absl::OkStatus();
  }

 private:
  const SynchroniseOptions& options_;
  const int total_;
  int done_ = 0;
};

// The time that a recording spans, and its frames' periods.
struct Span {
  explicit Span(const Sequence& sequence)
      : first_ns(sequence.depth.front().time_ns),
        last_ns(sequence.depth.back().time_ns),
        half_ms(0.5 * Milliseconds(last_ns - first_ns)),
        color_ms(Milliseconds(MedianPeriodNs(sequence.color))),
        depth_ms(Milliseconds(MedianPeriodNs(sequence.depth))) {}
  // Of a depth stamp: -1 at the first, 1 at the last.
  double Place(int64_t time_ns) const { return Milliseconds(time_ns - first_ns) / half_ms - 1; }

  int64_t first_ns, last_ns;
  double half_ms, color_ms, depth_ms;
};

absl::StatusOr<std::vector<KeyEdges>> ReadKeyEdges(const FrameSource& source, const std::vector<int>& picked,
                                                   const Span& span, Counter& counter) {
  std::vector<KeyEdges> keys(picked.size());
  RETURN_IF_ERROR(counter.For(static_cast<int>(picked.size()), [&](int k) -> absl::Status {
    keys[k].depth_index = picked[k];
    keys[k].place = span.Place(source.sequence().depth[picked[k]].time_ns);
    ASSIGN_OR_RETURN(const Image<float> depth, source.Depth(picked[k]));
    keys[k].edges = FindDepthEdges(RemoveFlyingPixels(depth, DepthNoise(), 1));
    return absl::OkStatus();
  }));
  return keys;
}

// The line of shifts that most of the `searched` keys vote for, to a step of the search.
absl::StatusOr<Line> SearchLine(const FrameSource& source, const std::vector<KeyEdges>& keys,
                                const std::vector<int>& searched, const Registration& registration, const Span& span,
                                Counter& counter) {
  // An edge must not jump over another from one shift to the next: eight steps between depth frames at least.
  const double step_ms = std::min(span.color_ms, span.depth_ms / 8);
  const ShiftGrid grid{.step_ms = step_ms, .half = static_cast<int>(std::lround(2 * span.depth_ms / step_ms))};
  std::vector<std::vector<float>> votes(searched.size());
  RETURN_IF_ERROR(counter.For(static_cast<int>(searched.size()), [&](int i) -> absl::Status {
    ASSIGN_OR_RETURN(votes[i], VotesForShifts(source, keys[searched[i]], grid, registration));
    return absl::OkStatus();
  }));
  std::vector<double> places;
  places.reserve(searched.size());
  for (const int k : searched) places.push_back(keys[k].place);
  constexpr double kMaxDrift = 0.01;
  return FindLine(votes, places, grid, kMaxDrift * span.half_ms);
}

// The registration under which most edges of the `searched` keys meet those of the colour frames that `line` says.
absl::StatusOr<RegistrationSearch> SearchPlace(const FrameSource& source, const std::vector<KeyEdges>& keys,
                                               const std::vector<int>& searched, const Line& line, double reference_m,
                                               int threads, Counter& counter) {
  constexpr size_t kMaxEdges = 6000;  // of all keys: a vote of so many is sharp enough
  const Sequence& sequence = source.sequence();
  std::vector<EdgeScene> scenes(searched.size());
  RETURN_IF_ERROR(counter.For(static_cast<int>(searched.size()), [&](int i) -> absl::Status {
    const KeyEdges& key = keys[searched[i]];
    const int64_t time = sequence.depth[key.depth_index].time_ns + std::llround(1e6 * line.At(key.place));
    ASSIGN_OR_RETURN(const Image<Rgb8> color, source.Color(NearestColor(sequence, time)));
    scenes[i] = EdgeScene(color, key.edges, kMaxEdges / searched.size() + 1);
    return absl::OkStatus();
  }));
  return SearchRegistration(scenes, reference_m, threads);
}

// When and where depth frames belong, to a step of the searches.
struct Place {
  Line line;
  RegistrationSearch registration;
};

// An error of time looks like one of place and the other way round, wherever things move. So both are tried first, and
// the one under which more edges meet is the answer; two of them where the images bear out both.
absl::StatusOr<std::vector<Place>> SearchBoth(const FrameSource& source, const std::vector<KeyEdges>& keys,
                                              const Span& span, int threads, Counter& counter) {
  const int count = static_cast<int>(keys.size());
  const std::vector<int> in_time = Spread(count, kMaxSearchedInTime), in_place = Spread(count, kMaxSearchedInPlace);
  std::vector<DepthEdge> edges;
  for (const KeyEdges& key : keys) edges.insert(edges.end(), key.edges.begin(), key.edges.end());
  const double reference_m = MedianNearM(edges);
  const auto place_at = [&](const Line& line) {
    return SearchPlace(source, keys, in_place, line, reference_m, threads, counter);
  };
  ASSIGN_OR_RETURN(const RegistrationSearch place_first, place_at(Line()));
  std::vector<Place> places(place_first.best.IsIdentity() ? 1 : 2);
  for (size_t i = 0; i < places.size(); ++i) {
    const Registration start = i == 0 ? place_first.best : Registration{.reference_m = reference_m};
    ASSIGN_OR_RETURN(places[i].line, SearchLine(source, keys, in_time, start, span, counter));
    ASSIGN_OR_RETURN(places[i].registration, place_at(places[i].line));
  }
  if (places.size() == 1) return places;
  if (places[1].registration.met > places[0].registration.met) std::swap(places[0], places[1]);
  constexpr double kAsGood = 0.95;
  const bool same = std::abs(places[0].line.middle_ms - places[1].line.middle_ms) <= span.color_ms;
  if (same || places[1].registration.met < kAsGood * places[0].registration.met) places.pop_back();
  return places;
}

absl::StatusOr<std::vector<Comparisons>> CompareAll(const FrameSource& source, const std::vector<KeyEdges>& keys,
                                                    const Line& line, const Registration& registration,
                                                    Counter& counter) {
  std::vector<Comparisons> comparisons(keys.size());
  RETURN_IF_ERROR(counter.For(static_cast<int>(keys.size()), [&](int k) -> absl::Status {
    ASSIGN_OR_RETURN(comparisons[k], Compare(source, keys[k], line.At(keys[k].place), registration));
    return absl::OkStatus();
  }));
  return comparisons;
}

// Standard deviations from which on a difference counts.
constexpr double kSignificant = 3.0;

// Writes the clock that shifts stamps by `line` and by what was fitted beyond it: a corrected stamp is
// stamp + middle + growth * place.
void DescribeClock(const Line& line, double growth_ms, const EdgeFit& fitted, const Span& span, int height,
                   ClockEstimate& estimate) {
  const double middle_ms = line.middle_ms + fitted.causes(kMiddle);
  const auto sigma_at = [&](double place) {
    return std::sqrt(fitted.covariance(kMiddle, kMiddle) + 2 * place * fitted.covariance(kMiddle, kGrowth) +
                     place * place * fitted.covariance(kGrowth, kGrowth));
  };
  const double drift = -growth_ms / (span.half_ms + growth_ms);
  const int64_t middle_ns = span.first_ns + (span.last_ns - span.first_ns) / 2;
  const auto middle_since_ns = static_cast<double>(middle_ns - estimate.model.reference_ns);
  estimate.model.drift_ppm = 1e6 * drift;
  estimate.model.offset_ns = -(1 + drift) * 1e6 * middle_ms - drift * middle_since_ns;
  const double reference_place = -1 - Milliseconds(span.first_ns - estimate.model.reference_ns) / span.half_ms;
  estimate.offset_sigma_ns = 1e6 * sigma_at(reference_place);
  estimate.stamp_sigma_ns = 1e6 * std::max(sigma_at(-1), sigma_at(1));
  const double ns_per_row = 1e6 / (0.5 * (height - 1));
  estimate.row_time_ns = -ns_per_row * fitted.causes(kRows);
  estimate.row_time_sigma_ns = ns_per_row * std::sqrt(fitted.covariance(kRows, kRows));
}

// Why the estimate must not be used; empty if it may be.
std::string WhyUnusable(const ClockEstimate& estimate, const Span& span, int height) {
  // A stamp that is surer than half a step of colour says which colour frame a depth frame belongs to.
  if (!(estimate.stamp_sigma_ns < 0.5e6 * span.color_ms))
    return absl::StrFormat(
        "too little moves: stamps would be corrected to +-%.3g ms, and half a colour frame is %.3g ms",
        1e-6 * estimate.stamp_sigma_ns, 0.5 * span.color_ms);
  // A camera has read one frame when it begins the next. Edges that seem to say otherwise are not where things moved.
  const double least_readout_ms =
      1e-6 * (height - 1) * (std::abs(estimate.row_time_ns) - kSignificant * estimate.row_time_sigma_ns);
  if (least_readout_ms > span.color_ms)
    return absl::StrFormat(
        "too little moves: the images would say that a colour frame takes at least %.3g ms to be read, and the next "
        "one comes after %.3g ms",
        least_readout_ms, span.color_ms);
  return {};
}

}  // namespace

absl::Status SynchroniseOptions::Validate() const {
  if (max_keys < kMinSynchroniseKeys)
    return absl::InvalidArgumentError(
        absl::StrFormat("SynchroniseOptions.max_keys = %d, must be >= %d", max_keys, kMinSynchroniseKeys));
  if (threads < 1)
    return absl::InvalidArgumentError(absl::StrFormat("SynchroniseOptions.threads = %d, must be > 0", threads));
  return absl::OkStatus();
}

absl::StatusOr<ClockEstimate> EstimateClock(const FrameSource& source, const SynchroniseOptions& options) {
  RETURN_IF_ERROR(options.Validate());
  const Sequence& sequence = source.sequence();
  ClockEstimate estimate{.model = {.reference_ns = sequence.color.front().time_ns}};
  const int depth_count = static_cast<int>(sequence.depth.size());
  if (sequence.color.size() < 2 || depth_count < kMinSynchroniseKeys) {
    estimate.reason = absl::StrFormat("%d colour and %d depth frames are too few to tell clocks by: at least 2 and %d",
                                      sequence.color.size(), depth_count, kMinSynchroniseKeys);
    return estimate;
  }
  const Span span(sequence);
  const std::vector<int> picked = Spread(depth_count, options.max_keys);
  const int count = static_cast<int>(picked.size());
  constexpr int kRounds = 3;  // of comparing; the last only where there is no drift
  const int in_time = std::min(count, kMaxSearchedInTime), in_place = std::min(count, kMaxSearchedInPlace);
  // At most: the second look in time and place is taken where the first finds depth elsewhere.
  Counter counter(options, (1 + kRounds) * count + 2 * in_time + 3 * in_place);

  ASSIGN_OR_RETURN(const std::vector<KeyEdges> keys, ReadKeyEdges(source, picked, span, counter));
  ASSIGN_OR_RETURN(const std::vector<Place> places, SearchBoth(source, keys, span, options.threads, counter));
  if (places.size() > 1) {
    estimate.reason = absl::StrFormat(
        "the images are explained as well by stamps that are %.1f ms off as by %.1f ms with depth beside colour",
        places[0].line.middle_ms, places[1].line.middle_ms);
    return estimate;
  }
  Line line = places.front().line;
  Registration registration = places.front().registration.best;
  // Colour frames are looked up anew where the first fit puts the keys.
  EdgeFitOptions fit{.threads = options.threads};
  ASSIGN_OR_RETURN(std::vector<Comparisons> comparisons, CompareAll(source, keys, line, registration, counter));
  const Causes first_fit = FitCauses(comparisons, fit);
  line = {line.middle_ms + first_fit(kMiddle), line.growth_ms + first_fit(kGrowth)};
  registration = Corrected(registration, first_fit, sequence.camera.width);
  ASSIGN_OR_RETURN(comparisons, CompareAll(source, keys, line, registration, counter));
  for (const auto& of_key : comparisons) {
    estimate.keys += of_key.empty() ? 0 : 1;
    estimate.edges += static_cast<int64_t>(of_key.size());
  }
  if (estimate.edges == 0) {
    estimate.reason = "no depth frame has an edge that colour shows too";
    return estimate;
  }
  EdgeFit fitted = FitWithCovariance(comparisons, fit);
  // The drift of real clocks is told apart from none, or taken for none: over a short clip it would be anything.
  const double growth_sigma_ms = std::sqrt(fitted.covariance(kGrowth, kGrowth));
  estimate.drift_sigma_ppm = 1e6 * growth_sigma_ms / span.half_ms;
  double growth_ms = line.growth_ms + fitted.causes(kGrowth);
  if (!(std::abs(growth_ms) > kSignificant * growth_sigma_ms && estimate.drift_sigma_ppm < kTellingDriftPpm)) {
    line.growth_ms = growth_ms = 0;
    fit.sigma(kGrowth) = 0;
    ASSIGN_OR_RETURN(comparisons, CompareAll(source, keys, line, registration, counter));
    fitted = FitWithCovariance(comparisons, fit);
  }
  DescribeClock(line, growth_ms, fitted, span, sequence.camera.height, estimate);
  estimate.reason = WhyUnusable(estimate, span, sequence.camera.height);
  return estimate;
}

}  // namespace depthtween
