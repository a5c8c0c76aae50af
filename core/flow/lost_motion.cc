#include "core/flow/lost_motion.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

namespace depthtween {
namespace {

constexpr int kWindowRadius = 3;
constexpr int kWindow = 2 * kWindowRadius + 1;
constexpr int kWindowPixels = kWindow * kWindow;
constexpr int kSeedStride = 3;         // pixels between the windows that are searched for
constexpr int kSpread = 6;             // pixels around a matched window that may move like it
constexpr float kUnexplained = 14.0F;  // mean difference over a window, luma: beyond noise and interpolation. 9 finds
                                       // false motion on recordings, 20 misses half of what there is
constexpr float kFound = 9.0F;         // mean difference of a match: at most this ...
constexpr float kBetter = 0.5F;        // ... and at most this share of what the flow leaves
constexpr float kPixelBetter =
    0.7F;                         // what another motion leaves of a pixel's window, at most this share of its flow's
constexpr int kBeside = 3;        // pixels from the best place: as good as it, for other places to be compared with
constexpr float kWayBack = 1.5F;  // largest forward-backward error, pixels

// The residual of flow is computed on every second pixel: flow is no finer.
constexpr int kGrid = 2;

float Bilinear(ImageView<const uint8_t> image, float x, float y) {
  x = std::clamp(x, 0.0F, static_cast<float>(image.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(image.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, image.width() - 1), y1 = std::min(y0 + 1, image.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  return (1 - ay) * ((1 - ax) * static_cast<float>(image(x0, y0)) + ax * static_cast<float>(image(x1, y0))) +
         ay * ((1 - ax) * static_cast<float>(image(x0, y1)) + ax * static_cast<float>(image(x1, y1)));
}

// Mean over 3 x 3 of the grid's pixels of what the flow leaves unexplained. 0 beside the image's edge.
class Unexplained {
 public:
  Unexplained(ImageView<const uint8_t> from, ImageView<const uint8_t> to, ImageView<const Flow2> flow)
      : mean_((from.width() + kGrid - 1) / kGrid, (from.height() + kGrid - 1) / kGrid) {
    const int columns = mean_.width(), rows = mean_.height();
    Image<float> left(columns, rows), sums(columns, rows);
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i) {
        const int x = i * kGrid, y = j * kGrid;
        const Flow2 f = flow(x, y);
        left(i, j) = std::abs(static_cast<float>(from(x, y)) -
                              Bilinear(to, static_cast<float>(x) + f.u, static_cast<float>(y) + f.v));
      }
    for (int j = 0; j < rows; ++j)
      for (int i = 1; i + 1 < columns; ++i) sums(i, j) = left(i - 1, j) + left(i, j) + left(i + 1, j);
    int unexplained = 0;
    for (int j = 1; j + 1 < rows; ++j)
      for (int i = 0; i < columns; ++i) {
        mean_(i, j) = (sums(i, j - 1) + sums(i, j) + sums(i, j + 1)) / 9;
        unexplained += mean_(i, j) >= kUnexplained ? 1 : 0;
      }
    share_ = static_cast<float>(unexplained) / static_cast<float>(mean_.pixel_count());
  }

  float At(int x, int y) const { return mean_(x / kGrid, y / kGrid); }
  float share() const { return share_; }

 private:
  Image<float> mean_;
  float share_ = 0;
};

bool WindowInside(ImageView<const uint8_t> image, int x, int y) {
  return x >= kWindowRadius && y >= kWindowRadius && x + kWindowRadius < image.width() &&
         y + kWindowRadius < image.height();
}

// Sum of differences between two windows, or of their first rows once it is over `limit`.
int WindowDifference(ImageView<const uint8_t> a, int ax, int ay, ImageView<const uint8_t> b, int bx, int by,
                     int limit) {
  int sum = 0;
  for (int dy = -kWindowRadius; dy <= kWindowRadius && sum < limit; ++dy) {
    const uint8_t* const p = a.row(ay + dy) + ax - kWindowRadius;
    const uint8_t* const q = b.row(by + dy) + bx - kWindowRadius;
    for (int i = 0; i < kWindow; ++i) sum += std::abs(p[i] - q[i]);
  }
  return sum;
}

// The minimum of the parabola through these values at -1, 0, 1.
float LeastOfParabola(int before, int at, int after) {
  const int bend = before + after - 2 * at;
  return bend > 0 ? std::clamp(0.5F * static_cast<float>(before - after) / static_cast<float>(bend), -0.5F, 0.5F)
                  : 0.0F;
}

struct Found {
  int x, y;  // of the window's centre
  Flow2 motion;
};

std::vector<Found> FindWindows(ImageView<const uint8_t> from, ImageView<const uint8_t> to, const Unexplained& left_from,
                               const Unexplained& left_to, float distinct) {
  struct Place {
    int x, y, difference;
  };
  std::vector<Found> found;
  std::vector<Place> rivals;  // of a window
  const int width = from.width(), height = from.height();
  for (int y = kWindowRadius; y + kWindowRadius < height; y += kSeedStride)
    for (int x = kWindowRadius; x + kWindowRadius < width; x += kSeedStride) {
      const float left = left_from.At(x, y);
      if (left < kUnexplained) continue;
      int best = static_cast<int>(kWindowPixels * std::min(kFound, kBetter * left));
      int best_x = -1, best_y = -1;
      rivals.clear();
      const auto rival_limit = [&] { return static_cast<int>(distinct * static_cast<float>(best)) + 1; };
      const int last_x = std::min(width - 1 - kWindowRadius, x + kLostMotionReach);
      const int last_y = std::min(height - 1 - kWindowRadius, y + kLostMotionReach);
      for (int ty = std::max(kWindowRadius, y - kLostMotionReach); ty <= last_y; ++ty)
        for (int tx = std::max(kWindowRadius, x - kLostMotionReach); tx <= last_x; ++tx) {
          if (left_to.At(tx, ty) < kUnexplained) continue;
          const int difference = WindowDifference(from, x, y, to, tx, ty, rival_limit());
          if (distinct > 1.0F && difference < rival_limit()) rivals.push_back({tx, ty, difference});
          if (difference < best) best = difference, best_x = tx, best_y = ty;
        }
      if (best_x < 0) continue;
      const auto rivals_best = [&](const Place& place) {
        return place.difference < rival_limit() &&
               std::max(std::abs(place.x - best_x), std::abs(place.y - best_y)) > kBeside;
      };
      if (std::any_of(rivals.begin(), rivals.end(), rivals_best)) continue;
      const auto beside = [&](int dx, int dy) {
        const int tx = best_x + dx, ty = best_y + dy;
        return WindowInside(to, tx, ty) ? WindowDifference(from, x, y, to, tx, ty, 256 * kWindowPixels) : best;
      };
      found.push_back({x,
                       y,
                       {static_cast<float>(best_x - x) + LeastOfParabola(beside(-1, 0), best, beside(1, 0)),
                        static_cast<float>(best_y - y) + LeastOfParabola(beside(0, -1), best, beside(0, 1))}});
    }
  return found;
}

// The flow, replaced around matched windows by their motion where that explains a pixel's window better.
Image<Flow2> Spread(const std::vector<Found>& found, ImageView<const uint8_t> from, ImageView<const uint8_t> to,
                    const Unexplained& left, const Image<Flow2>& flow) {
  Image<Flow2> out = flow.Clone();
  Image<int> best(from.width(), from.height());  // difference of the motion taken; 0: none yet
  for (const Found& window : found)
    for (int y = window.y - kSpread; y <= window.y + kSpread; ++y)
      for (int x = window.x - kSpread; x <= window.x + kSpread; ++x) {
        const int tx = x + static_cast<int>(std::lround(window.motion.u));
        const int ty = y + static_cast<int>(std::lround(window.motion.v));
        if (!WindowInside(from, x, y) || !WindowInside(to, tx, ty)) continue;
        const int limit = best(x, y) > 0 ? best(x, y) : static_cast<int>(kWindowPixels * kPixelBetter * left.At(x, y));
        const int difference = WindowDifference(from, x, y, to, tx, ty, limit);
        if (difference >= limit) continue;
        best(x, y) = std::max(1, difference);
        out(x, y) = window.motion;
      }
  return out;
}

// Takes the recovered motions that pass the forward-backward check; true if there were any.
bool TakeConfirmed(const Image<Flow2>& recovered, const Image<Flow2>& recovered_back, Image<Flow2>& flow) {
  bool taken = false;
  for (int y = 0; y < flow.height(); ++y)
    for (int x = 0; x < flow.width(); ++x) {
      const Flow2 f = recovered(x, y);
      if (f.u == flow(x, y).u && f.v == flow(x, y).v) continue;
      const int tx = x + static_cast<int>(std::lround(f.u)), ty = y + static_cast<int>(std::lround(f.v));
      const Flow2 back = recovered_back(tx, ty);
      if (std::hypot(f.u + back.u, f.v + back.v) > kWayBack) continue;
      flow(x, y) = f;
      taken = true;
    }
  return taken;
}

bool RecoverAtFullResolution(ImageView<const uint8_t> a, ImageView<const uint8_t> b, Image<Flow2>& ab, Image<Flow2>& ba,
                             float distinct) {
  const Unexplained left_a(a, b, ab), left_b(b, a, ba);
  for (const float share : {left_a.share(), left_b.share()})
    if (share == 0 || share > kLostMotionShare) return false;
  const Image<Flow2> recovered_ab = Spread(FindWindows(a, b, left_a, left_b, distinct), a, b, left_a, ab);
  const Image<Flow2> recovered_ba = Spread(FindWindows(b, a, left_b, left_a, distinct), b, a, left_b, ba);
  const bool there = TakeConfirmed(recovered_ab, recovered_ba, ab),
             back = TakeConfirmed(recovered_ba, recovered_ab, ba);
  return there || back;
}

Image<uint8_t> HalfSize(ImageView<const uint8_t> image) {
  Image<uint8_t> half(image.width() / 2, image.height() / 2);
  for (int y = 0; y < half.height(); ++y)
    for (int x = 0; x < half.width(); ++x)
      half(x, y) = static_cast<uint8_t>(
          (image(2 * x, 2 * y) + image(2 * x + 1, 2 * y) + image(2 * x, 2 * y + 1) + image(2 * x + 1, 2 * y + 1) + 2) /
          4);
  return half;
}

Image<Flow2> HalfSize(const Image<Flow2>& flow) {
  Image<Flow2> half(flow.width() / 2, flow.height() / 2);
  for (int y = 0; y < half.height(); ++y)
    for (int x = 0; x < half.width(); ++x) half(x, y) = {flow(2 * x, 2 * y).u / 2, flow(2 * x, 2 * y).v / 2};
  return half;
}

// Carries motion recovered at half resolution over to full resolution; elsewhere `flow` stays.
void TakeChanges(const Image<Flow2>& recovered, const Image<Flow2>& before, Image<Flow2>& flow) {
  for (int y = 0; y < 2 * recovered.height(); ++y)
    for (int x = 0; x < 2 * recovered.width(); ++x) {
      const Flow2 f = recovered(x / 2, y / 2), was = before(x / 2, y / 2);
      if (f.u != was.u || f.v != was.v) flow(x, y) = {2 * f.u, 2 * f.v};
    }
}

}  // namespace

bool RecoverLostMotion(ImageView<const uint8_t> a, ImageView<const uint8_t> b, Image<Flow2>& ab, Image<Flow2>& ba,
                       const LostMotionOptions& options) {
  if (options.scales < 1 || std::min(a.width(), a.height()) < 2 * kLostMotionReach) return false;
  bool changed = false;
  if (options.scales > 1) {
    const Image<Flow2> ab_before = HalfSize(ab), ba_before = HalfSize(ba);
    Image<Flow2> ab_half = ab_before.Clone(), ba_half = ba_before.Clone();
    changed = RecoverLostMotion(HalfSize(a), HalfSize(b), ab_half, ba_half,
                                {.scales = options.scales - 1, .distinct = options.distinct});
    if (changed) {
      TakeChanges(ab_half, ab_before, ab);
      TakeChanges(ba_half, ba_before, ba);
    }
  }
  return RecoverAtFullResolution(a, b, ab, ba, options.distinct) || changed;
}

}  // namespace depthtween
