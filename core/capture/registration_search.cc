#include "core/capture/registration_search.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/capture/moving_picture.h"

namespace depthtween {
namespace {

// A cell is this share of the image's width: fine enough that a wrong place a cell beside counts, coarse enough that an
// edge is met by its own change of colour although scale and parallax are only steps of the search.
constexpr int kCellsAcross = 320;
constexpr float kUsualReach = 0.08F;  // of the width: the surroundings that an edge is compared with

template <typename T, typename Add>
Image<T> BoxMean(const Image<T>& image, int radius, Add add) {
  const int width = image.width(), height = image.height();
  Image<T> rows(width, height), out(width, height);
  for (int y = 0; y < height; ++y) {
    T sum{};
    for (int x = -radius; x < width; ++x) {
      if (x + radius < width) add(sum, image(x + radius, y), 1.0F);
      if (x - radius - 1 >= 0) add(sum, image(x - radius - 1, y), -1.0F);
      if (x >= 0) rows(x, y) = sum;
    }
  }
  const auto area = static_cast<float>((2 * radius + 1) * (2 * radius + 1));
  for (int x = 0; x < width; ++x) {
    T sum{};
    for (int y = -radius; y < height; ++y) {
      if (y + radius < height) add(sum, rows(x, y + radius), 1.0F);
      if (y - radius - 1 >= 0) add(sum, rows(x, y - radius - 1), -1.0F);
      if (y < 0) continue;
      T mean{};
      add(mean, sum, 1.0F / area);
      out(x, y) = mean;
    }
  }
  return out;
}

}  // namespace

int EdgeScene::CellPx(int width) { return std::max(1, (width + kCellsAcross / 2) / kCellsAcross); }

EdgeScene::EdgeScene(ImageView<const Rgb8> color, const std::vector<DepthEdge>& edges, size_t max_edges)
    : width_(color.width()), height_(color.height()), cell_px_(static_cast<float>(CellPx(color.width()))) {
  const int cell = CellPx(width_);
  changes_ = Image<Change>((width_ + cell - 1) / cell, (height_ + cell - 1) / cell);
  const auto at = [&](int x, int y) { return color(std::clamp(x, 0, width_ - 1), std::clamp(y, 0, height_ - 1)); };
  const float of_cell = 1.0F / static_cast<float>(4 * cell * cell);  // central differences are over two pixels
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      const Rgb8 left = at(x - 1, y), right = at(x + 1, y), above = at(x, y - 1), below = at(x, y + 1);
      Change& change = changes_(x / cell, y / cell);
      for (uint8_t Rgb8::*channel : {&Rgb8::r, &Rgb8::g, &Rgb8::b}) {
        const auto gx = static_cast<float>(right.*channel - left.*channel),
                   gy = static_cast<float>(below.*channel - above.*channel);
        change.xx += gx * gx * of_cell, change.xy += gx * gy * of_cell, change.yy += gy * gy * of_cell;
      }
    }
  const size_t every = edges.size() / max_edges + 1;
  const auto add = [](Change& sum, const Change& change, float share) {
    sum.xx += share * change.xx, sum.xy += share * change.xy, sum.yy += share * change.yy;
  };
  const Image<Change> around =
      BoxMean(changes_, std::max(2, static_cast<int>(kUsualReach * static_cast<float>(changes_.width()))), add);
  for (size_t e = 0; e < edges.size(); e += every) {
    const DepthEdge& edge = edges[e];
    const int x = std::clamp(static_cast<int>(edge.x / cell_px_), 0, changes_.width() - 1);
    const int y = std::clamp(static_cast<int>(edge.y / cell_px_), 0, changes_.height() - 1);
    edges_.push_back(edge);
    usual_.push_back(around(x, y).Across(edge.normal_x, edge.normal_y) + kNoiseContrast2 / 8);
  }
}

int EdgeScene::CellOf(float px) const {
  constexpr float kBeyond = 1e6F;  // of any image; a depth of next to nothing has any parallax
  return static_cast<int>(std::floor(std::clamp((px + 0.5F) / cell_px_, -kBeyond, kBeyond)));
}

float EdgeScene::Vote(size_t e, int x, int y) const {
  const DepthEdge& edge = edges_[e];
  // Beyond the image nothing is known.
  if (x < 0 || y < 0 || x >= changes_.width() || y >= changes_.height()) return 0.25F;
  const float across = changes_(x, y).Across(edge.normal_x, edge.normal_y);
  return across / (across + 2 * usual_[e]);
}

float EdgeScene::VoteBetween(size_t e, float x_px, float y_px) const {
  // Cell centres lie at (i + 1/2) cells less half a pixel.
  const int left = CellOf(x_px - 0.5F * cell_px_), top = CellOf(y_px - 0.5F * cell_px_);
  const float a = std::clamp((x_px + 0.5F) / cell_px_ - 0.5F - static_cast<float>(left), 0.0F, 1.0F);
  const float b = std::clamp((y_px + 0.5F) / cell_px_ - 0.5F - static_cast<float>(top), 0.0F, 1.0F);
  return (1 - b) * ((1 - a) * Vote(e, left, top) + a * Vote(e, left + 1, top)) +
         b * ((1 - a) * Vote(e, left, top + 1) + a * Vote(e, left + 1, top + 1));
}

double MeanVote(const std::vector<EdgeScene>& scenes, const Registration& registration) {
  double met = 0, edges = 0;
  for (const EdgeScene& scene : scenes)
    for (size_t e = 0; e < scene.edges().size(); ++e) {
      const DepthEdge& edge = scene.edges()[e];
      const Flow2 move = registration.Displacement(scene.width(), scene.height(), edge.x, edge.y, edge.near_m);
      met += scene.VoteBetween(e, edge.x + move.u, edge.y + move.v);
      edges += 1;
    }
  return edges > 0 ? met / edges : 0.0;
}

namespace {

// Goes on from a step of the search to where most edges meet, between the steps.
void Climb(const std::vector<EdgeScene>& scenes, Registration& registration) {
  const int width = scenes.front().width();
  const double cell = EdgeScene::CellPx(width);
  struct Knob {
    double Registration::*value;
    double step;  // moves an edge by about a cell
  };
  const std::array<Knob, 5> knobs{{{&Registration::right_px, cell},
                                   {&Registration::down_px, cell},
                                   {&Registration::scale, cell / (0.25 * width)},
                                   {&Registration::parallax_x_px_m, cell * registration.reference_m},
                                   {&Registration::parallax_y_px_m, cell * registration.reference_m}}};
  constexpr int kMaxRounds = 40;
  double best = MeanVote(scenes, registration), share = 1.0;
  for (int round = 0; round < kMaxRounds && share > 0.2; ++round) {
    bool moved = false;
    for (const Knob& knob : knobs)
      for (const double sign : {1.0, -1.0}) {
        Registration tried = registration;
        tried.*knob.value += sign * share * knob.step;
        const double votes = MeanVote(scenes, tried);
        if (votes <= best) continue;
        best = votes, registration = tried, moved = true;
        break;
      }
    if (!moved) share *= 0.5;
  }
}

}  // namespace

RegistrationSearch SearchRegistration(const std::vector<EdgeScene>& scenes, double reference_m, int threads) {
  RegistrationSearch search{.best = {.reference_m = reference_m}};
  if (scenes.empty()) return search;
  const int width = scenes.front().width(), height = scenes.front().height();
  const int cell = EdgeScene::CellPx(width), reach = std::max(4, width / 12 / cell);

  // Votes for all shifts, given the rest of the registration.
  const auto votes_for_shifts = [&](const Registration& rest, int half) {
    const int across = 2 * half + 1;
    std::vector<double> votes(static_cast<size_t>(across) * across, 0.0);
    for (const EdgeScene& scene : scenes)
      for (size_t e = 0; e < scene.edges().size(); ++e) {
        const DepthEdge& edge = scene.edges()[e];
        const Flow2 move = rest.Displacement(width, height, edge.x, edge.y, edge.near_m);
        const int x = scene.CellOf(edge.x + move.u), y = scene.CellOf(edge.y + move.v);
        double* row = votes.data();
        for (int dy = -half; dy <= half; ++dy)
          for (int dx = -half; dx <= half; ++dx) *row++ += scene.Vote(e, x + dx, y + dy);
      }
    return votes;
  };
  struct Candidate {
    Registration registration;
    double votes = -1.0;
  };
  const auto best_shift = [&](Registration rest, int half) {
    const std::vector<double> votes = votes_for_shifts(rest, half);
    const auto best = std::max_element(votes.begin(), votes.end());
    const int at = static_cast<int>(best - votes.begin()), across = 2 * half + 1;
    const int row = at / across, column = at % across;
    rest.right_px += cell * (column - half), rest.down_px += cell * (row - half);
    return Candidate{rest, *best};
  };

  constexpr double kScaleStep = 0.025;
  constexpr int kScaleSteps = 7;
  std::vector<Candidate> by_scale(2 * kScaleSteps + 1);
  ParallelFor(static_cast<int>(by_scale.size()), threads, [&](int i) {
    by_scale[i] = best_shift({.scale = 1 + kScaleStep * (i - kScaleSteps), .reference_m = reference_m}, reach);
  });
  std::stable_sort(by_scale.begin(), by_scale.end(),
                   [](const Candidate& a, const Candidate& b) { return a.votes > b.votes; });
  // Parallax, along one axis and then the other, with the shift free around where it is.
  constexpr int kKept = 3, kParallaxSteps = 12, kShiftCells = 6;
  std::vector<Candidate> refined(by_scale.begin(), by_scale.begin() + kKept);
  for (double Registration::*parallax : {&Registration::parallax_x_px_m, &Registration::parallax_y_px_m}) {
    constexpr int kTried = 2 * kParallaxSteps + 1;
    std::vector<Candidate> tried(refined.size() * kTried);
    ParallelFor(static_cast<int>(tried.size()), threads, [&](int i) {
      Registration start = refined[i / kTried].registration;
      // Pixels of what is twice as near.
      start.*parallax = cell * (i % kTried - kParallaxSteps) * reference_m;
      tried[i] = best_shift(start, kShiftCells);
    });
    for (size_t k = 0; k < refined.size(); ++k) {
      // None, unless some is better: where all edges are equally near, all parallax is the same.
      refined[k] = tried[k * kTried + kParallaxSteps];
      for (size_t i = k * kTried; i < (k + 1) * kTried; ++i)
        if (tried[i].votes > refined[k].votes) refined[k] = tried[i];
    }
  }
  Candidate best = *std::max_element(refined.begin(), refined.end(),
                                     [](const Candidate& a, const Candidate& b) { return a.votes < b.votes; });
  Climb(scenes, best.registration);

  // The gain must be that of all parts of the image, not that of a few chance meetings of edges.
  constexpr int kColumns = 6, kRows = 4;
  struct Part {
    double edges = 0, gain = 0;
  };
  std::array<Part, size_t{kColumns} * kRows> parts{};
  double edges = 0, met = 0, met_unmoved = 0;
  for (const EdgeScene& scene : scenes)
    for (size_t e = 0; e < scene.edges().size(); ++e) {
      const DepthEdge& edge = scene.edges()[e];
      const auto vote = [&](const Registration& registration) {
        const Flow2 move = registration.Displacement(width, height, edge.x, edge.y, edge.near_m);
        return scene.VoteBetween(e, edge.x + move.u, edge.y + move.v);
      };
      const double moved = vote(best.registration), unmoved = vote(search.best);
      const int column = std::clamp(static_cast<int>(edge.x) * kColumns / width, 0, kColumns - 1);
      const int row = std::clamp(static_cast<int>(edge.y) * kRows / height, 0, kRows - 1);
      Part& part = parts[row * kColumns + column];
      part.edges += 1, part.gain += moved - unmoved;
      met += moved, met_unmoved += unmoved, edges += 1;
    }
  if (edges == 0) return search;
  const double gain = (met - met_unmoved) / edges;
  double variance = 0;
  for (const Part& part : parts) variance += std::pow((part.gain - part.edges * gain) / edges, 2);
  search.met_unmoved = met_unmoved / edges;
  // By chance too a search finds a place under which edges meet colour half as often again, and 4 deviations of the
  // parts above that, but never as often as where depth belongs.
  constexpr double kBeyondChance = 3.0, kMore = 1.3;
  search.best_met = met / edges;
  const bool believed =
      gain > kBeyondChance * std::sqrt(variance) && met > kMore * met_unmoved && search.best_met > kLeastMet;
  if (believed) search.best = best.registration;
  search.met = believed ? search.best_met : search.met_unmoved;
  return search;
}

}  // namespace depthtween
