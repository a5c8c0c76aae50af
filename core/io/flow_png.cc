#include "core/io/flow_png.h"

#include <cmath>
#include <optional>

#include "core/io/file.h"
#include "core/io/png.h"

namespace depthtween {
namespace {

constexpr float kUnitsPerPixel = 64.0F;
constexpr float kOffset = 32768.0F;

// None when the displacement does not fit 16 bits; NaN does not.
std::optional<uint16_t> ToUnits(float pixels) {
  const float units = std::floor(pixels * kUnitsPerPixel + kOffset + 0.5F);
  if (!(units >= 0.0F && units <= 65535.0F)) return std::nullopt;
  return static_cast<uint16_t>(units);
}

float ToPixels(uint16_t units) { return (static_cast<float>(units) - kOffset) / kUnitsPerPixel; }

}  // namespace

absl::StatusOr<std::string> EncodeFlowPng(ImageView<const Flow2> flow, ImageView<const uint8_t> valid) {
  if (!flow.SameSize(valid)) return absl::InvalidArgumentError("flow and its valid mask must have one size");
  Image<Rgb16> stored(flow.width(), flow.height());
  for (int y = 0; y < flow.height(); ++y) {
    for (int x = 0; x < flow.width(); ++x) {
      const auto u = ToUnits(flow(x, y).u), v = ToUnits(flow(x, y).v);
      if (valid(x, y) != 0 && u && v) stored(x, y) = {*u, *v, 1};
    }
  }
  return EncodePngRgb16(stored);
}

absl::StatusOr<FlowField> DecodeFlowPng(std::string_view bytes, const ImageLimits& limits) {
  ASSIGN_OR_RETURN(const Image<Rgb16> stored, DecodePngRgb16(bytes, limits));
  FlowField field = {Image<Flow2>(stored.width(), stored.height()), Image<uint8_t>(stored.width(), stored.height())};
  for (int y = 0; y < stored.height(); ++y) {
    for (int x = 0; x < stored.width(); ++x) {
      const Rgb16 pixel = stored(x, y);
      if (pixel.b == 0) continue;
      field.flow(x, y) = {ToPixels(pixel.r), ToPixels(pixel.g)};
      field.valid(x, y) = 1;
    }
  }
  return field;
}

absl::Status WriteFlowPng(const std::string& path, ImageView<const Flow2> flow, ImageView<const uint8_t> valid) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodeFlowPng(flow, valid));
  return WriteFile(path, bytes);
}

absl::StatusOr<FlowField> ReadFlowPng(const std::string& path, const ImageLimits& limits) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  absl::StatusOr<FlowField> field = DecodeFlowPng(bytes, limits);
  if (!field.ok()) return WithContext(field.status(), path);
  return field;
}

}  // namespace depthtween
