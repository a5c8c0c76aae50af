#include "core/render/aperture.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace depthtween {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kLinesPerRow = 16;  // a row's ends are the means over so many lines

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

Aperture::Row MakeRow(double begin, double end) {
  const auto place = [](double edge) {
    const double pixel = std::floor(edge + 0.5);
    return std::pair{static_cast<int16_t>(pixel), static_cast<float>(edge + 0.5 - pixel)};
  };
  const auto [begin_px, begin_share] = place(begin);
  const auto [end_px, end_share] = place(end);
  return {begin_px, end_px, begin_share, end_share};
}

}  // namespace

Aperture::Aperture(int blades, float max_radius_px) {
  middle_ = static_cast<int>(std::lround(max_radius_px / kStep));
  // How far the longest tip reaches, in radii.
  const double tip = blades == 0 ? 1.0 : std::sqrt(2 * kPi / (blades * std::sin(2 * kPi / blades)));
  for (int i = -middle_; i <= middle_; ++i) {
    // Below a pixel's size the shape does not matter, only that it has an area.
    const double radius = std::max(static_cast<double>(kStep), std::abs(i) * static_cast<double>(kStep));
    const int reach = static_cast<int>(std::ceil(radius * tip - 0.5));
    Shape shape{.first_row = static_cast<int>(rows_.size()) + reach, .reach = reach, .area = 0.0F};
    for (int y = -reach; y <= reach; ++y) {
      double begin = 0.0, end = 0.0;
      for (int line = 0; line < kLinesPerRow; ++line) {
        const double at = (y + (line + 0.5) / kLinesPerRow - 0.5) / radius;
        const auto [chord_begin, chord_end] = Chord(blades, i < 0 ? -at : at);
        if (chord_begin > chord_end) continue;
        begin += (i < 0 ? -chord_end : chord_begin) * radius / kLinesPerRow;
        end += (i < 0 ? -chord_begin : chord_end) * radius / kLinesPerRow;
      }
      rows_.push_back(MakeRow(begin, end));
      shape.area += static_cast<float>(end - begin);
    }
    shapes_.push_back(shape);
  }
}

}  // namespace depthtween
