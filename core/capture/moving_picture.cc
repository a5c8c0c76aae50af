#include "core/capture/moving_picture.h"

#include <algorithm>
#include <utility>

namespace depthtween {
namespace {

Image<float> SmoothedChannel(ImageView<const Rgb8> color, uint8_t Rgb8::*channel) {
  const int width = color.width(), height = color.height();
  Image<float> rows(width, height), out(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int left = color(std::max(0, x - 1), y).*channel, right = color(std::min(width - 1, x + 1), y).*channel;
      rows(x, y) = 0.25F * static_cast<float>(left + 2 * (color(x, y).*channel) + right);
    }
  for (int y = 0; y < height; ++y) {
    const float *above = rows.row(std::max(0, y - 1)), *here = rows.row(y),
                *below = rows.row(std::min(height - 1, y + 1));
    for (int x = 0; x < width; ++x) out(x, y) = 0.25F * (above[x] + 2 * here[x] + below[x]);
  }
  return out;
}

}  // namespace

int NearestColor(const Sequence& sequence, int64_t time_ns) {
  const auto& color = sequence.color;
  const auto after = std::lower_bound(color.begin(), color.end(), time_ns,
                                      [](const FrameRef& frame, int64_t time) { return frame.time_ns < time; });
  if (after == color.end()) return static_cast<int>(color.size()) - 1;
  const int index = static_cast<int>(after - color.begin());
  return index > 0 && time_ns - color[index - 1].time_ns <= after->time_ns - time_ns ? index - 1 : index;
}

absl::StatusOr<MovingPicture> MovingPicture::Make(ImageView<const Rgb8> here, ImageView<const Rgb8> there,
                                                  double step_ms, const DenseFlowOptions& options) {
  MovingPicture picture;
  ASSIGN_OR_RETURN(picture.flow_, DenseFlow(Luma(here), Luma(there), options));
  picture.channels_ = {SmoothedChannel(here, &Rgb8::r), SmoothedChannel(here, &Rgb8::g),
                       SmoothedChannel(here, &Rgb8::b)};
  picture.per_ms_ = static_cast<float>(1.0 / step_ms);
  return picture;
}

float MovingPicture::Contrast2(float x, float y, float nx, float ny) const {
  constexpr float kHalfBase = 0.75F;  // pixels: about the slope that smoothing leaves of an edge
  float sum = 0;
  for (const Image<float>& channel : channels_) {
    const float change = SampleBilinear(channel, x + kHalfBase * nx, y + kHalfBase * ny) -
                         SampleBilinear(channel, x - kHalfBase * nx, y - kHalfBase * ny);
    sum += change * change;
  }
  return sum;
}

bool MovingPicture::Contains(float x, float y, float margin) const {
  return x >= margin && y >= margin && x <= static_cast<float>(flow_.width() - 1) - margin &&
         y <= static_cast<float>(flow_.height() - 1) - margin;
}

MovingPicture::Moved MovingPicture::Move(const DepthEdge& edge, double ms) const {
  Moved moved{.x = edge.x, .y = edge.y};
  // The flow is that of the place where the edge is now, which the flow tells: three rounds agree with themselves to
  // well below a pixel, as motion changes little over so short a way.
  for (int round = 0; round < 3; ++round) {
    const Flow2 flow =
        SampleFlow(flow_, moved.x - kInsideEdgePx * edge.normal_x, moved.y - kInsideEdgePx * edge.normal_y);
    moved.velocity_x = flow.u * per_ms_;
    moved.velocity_y = flow.v * per_ms_;
    moved.x = edge.x + static_cast<float>(ms) * moved.velocity_x;
    moved.y = edge.y + static_cast<float>(ms) * moved.velocity_y;
  }
  return moved;
}

absl::Status ColorReader::Hold(int slot, int index) {
  if (held_[slot] == index) return absl::OkStatus();
  held_[slot] = -1;
  ASSIGN_OR_RETURN(images_[slot], source_.Color(index));
  held_[slot] = index;
  return absl::OkStatus();
}

absl::StatusOr<MovingPicture> ColorReader::Read(int index, const DenseFlowOptions& options) {
  const auto& color = source_.sequence().color;
  const int toward = index + 1 < static_cast<int>(color.size()) ? index + 1 : index - 1;
  RETURN_IF_ERROR(Hold(index % 2, index));
  RETURN_IF_ERROR(Hold(toward % 2, toward));
  return MovingPicture::Make(images_[index % 2], images_[toward % 2],
                             Milliseconds(color[toward].time_ns - color[index].time_ns), options);
}

}  // namespace depthtween
