#include "core/render/aperture.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace depthtween {
namespace {

constexpr double kPi = 3.14159265358979323846;

// A row is the mean of so many lines. Of a large shape's area, little lies in rows that change within a pixel.
int LinesPerRow(double radius) { return std::clamp(static_cast<int>(64 / radius), 4, 16); }

// Where the shape of area pi begins and ends on the line at `y` (down); begin > end where the line misses it.
std::pair<double, double> Chord(int blades, double y) {
  if (blades == 0) {
    const double half = std::sqrt(std::max(0.0, 1 - y * y));
    return {-half, half};
  }
  // A regular polygon of n sides at distance a from its centre has the area n a^2 tan(pi / n).
  const double apothem = std::sqrt(kPi / (blades * std::tan(kPi / blades)));
  double begin = -std::numeric_limits<double>::infinity(), end = -begin;
  for (int i = 0; i < blades; ++i) {
    const double angle = kPi * (2 * i + 1) / blades;  // of a side's normal from straight up, so that a tip is up
    const double across = std::sin(angle), room = apothem + y * std::cos(angle);
    if (std::abs(across) < 1e-9) {
      if (room < 0) return {0, -1};
    } else if (across > 0) {
      end = std::min(end, room / across);
    } else {
      begin = std::max(begin, room / across);
    }
  }
  return {begin, end};
}

// Adds a line from `begin` to `end`, places relative to a pixel's centre, to the changes from pixel to pixel.
void AddLine(double begin, double end, float weight, float* changes) {
  for (const auto& [edge, sign] : {std::pair{begin, weight}, std::pair{end, -weight}}) {
    const double pixel = std::floor(edge + 0.5);
    const auto late = static_cast<float>(edge + 0.5 - pixel);
    changes[static_cast<int>(pixel)] += sign * (1 - late);
    changes[static_cast<int>(pixel) + 1] += sign * late;
  }
}

}  // namespace

Aperture::Aperture(int blades, float max_radius_px) {
  middle_ = static_cast<int>(std::lround(max_radius_px / kStep));
  // How far the longest tip reaches, in radii.
  const double tip = blades == 0 ? 1.0 : std::sqrt(2 * kPi / (blades * std::sin(2 * kPi / blades)));
  std::vector<float> row;
  for (int i = -middle_; i <= middle_; ++i) {
    // Below a pixel's size the shape does not matter, only that it has an area.
    const double radius = std::max(1, std::abs(i)) * static_cast<double>(kStep);
    const int reach = static_cast<int>(std::ceil(radius * tip - 0.5));
    const int lines = LinesPerRow(radius);
    Shape shape{.first_row = static_cast<int>(row_begins_.size()) + reach, .reach = reach, .area = 0.0F};
    for (int y = -reach; y <= reach; ++y) {
      row.assign(2 * reach + 3, 0.0F);  // one more than needed, for lines that end on a border
      for (int line = 0; line < lines; ++line) {
        const double at = (y + (line + 0.5) / lines - 0.5) / radius;
        const auto [begin, end] = Chord(blades, i < 0 ? -at : at);
        if (begin >= end) continue;
        const double left = radius * (i < 0 ? -end : begin), right = radius * (i < 0 ? -begin : end);
        AddLine(left, right, 1.0F / static_cast<float>(lines), row.data() + reach);
        shape.area += static_cast<float>((right - left) / lines);
      }
      row_begins_.push_back(static_cast<int32_t>(changes_.size()));
      for (int x = -reach; x <= reach + 2; ++x)
        if (row[x + reach] != 0) changes_.push_back({x, row[x + reach]});
    }
    shapes_.push_back(shape);
  }
  row_begins_.push_back(static_cast<int32_t>(changes_.size()));
}

}  // namespace depthtween
