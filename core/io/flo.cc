#include "core/io/flo.h"

#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/io/file.h"

namespace depthtween {
namespace {

static_assert(std::endian::native == std::endian::little, "floats are written as they lie in memory");
static_assert(sizeof(Flow2) == 8, "Flow2 is read and written as two floats");

constexpr char kFloTag[] = "PIEH";
constexpr size_t kFloHead = 12;

template <typename Pixel>
void AppendRow(const Pixel* row, int width, std::string& bytes) {
  bytes.append(reinterpret_cast<const char*>(row), sizeof(Pixel) * static_cast<size_t>(width));
}

absl::Status CheckBytes(size_t have, size_t need) {
  if (have == need) return absl::OkStatus();
  return absl::DataLossError(absl::StrFormat("%d bytes, must be %d for an image of this size", have, need));
}

}  // namespace

std::string EncodeFlo(ImageView<const Flow2> flow) {
  std::string bytes = kFloTag;
  for (const int32_t side : {flow.width(), flow.height()})
    bytes.append(reinterpret_cast<const char*>(&side), sizeof(side));
  for (int y = 0; y < flow.height(); ++y) AppendRow(flow.row(y), flow.width(), bytes);
  return bytes;
}

absl::StatusOr<Image<Flow2>> DecodeFlo(std::string_view bytes, const ImageLimits& limits) {
  if (bytes.size() < kFloHead || bytes.substr(0, 4) != kFloTag)
    return absl::DataLossError("not a .flo file: it does not begin with PIEH");
  int32_t width = 0, height = 0;
  std::memcpy(&width, bytes.data() + 4, sizeof(width));
  std::memcpy(&height, bytes.data() + 8, sizeof(height));
  RETURN_IF_ERROR(limits.Check(width, height));
  Image<Flow2> flow(width, height);
  RETURN_IF_ERROR(CheckBytes(bytes.size(), kFloHead + sizeof(Flow2) * flow.pixel_count()));
  std::memcpy(flow.data(), bytes.data() + kFloHead, sizeof(Flow2) * flow.pixel_count());
  return flow;
}

absl::Status WriteFlo(const std::string& path, ImageView<const Flow2> flow) { return WriteFile(path, EncodeFlo(flow)); }

std::string EncodePfm(ImageView<const float> image) {
  std::string bytes = absl::StrFormat("Pf\n%d %d\n-1.0\n", image.width(), image.height());
  for (int y = image.height() - 1; y >= 0; --y) AppendRow(image.row(y), image.width(), bytes);
  return bytes;
}

absl::StatusOr<Image<float>> DecodePfm(std::string_view bytes, const ImageLimits& limits) {
  // sscanf needs an end; the head is short.
  const std::string head(bytes.substr(0, 64));
  int width = 0, height = 0, end = 0;
  double scale = 0.0;
  if (std::sscanf(head.c_str(), "Pf %d %d %lf%*[ ]%n", &width, &height, &scale, &end) < 3)
    return absl::DataLossError("not a grey .pfm file: it does not begin with Pf, width, height and scale");
  if (end == 0) std::sscanf(head.c_str(), "Pf %d %d %lf%n", &width, &height, &scale, &end);
  if (scale >= 0.0)
    return absl::DataLossError(absl::StrFormat("scale %g says big endian, must be negative (little endian)", scale));
  RETURN_IF_ERROR(limits.Check(width, height));
  Image<float> image(width, height);
  const size_t start = static_cast<size_t>(end) + 1;  // one byte, a line feed, ends the head
  RETURN_IF_ERROR(CheckBytes(bytes.size(), start + sizeof(float) * image.pixel_count()));
  const size_t stride = sizeof(float) * static_cast<size_t>(width);
  for (int y = 0; y < height; ++y)
    std::memcpy(image.row(height - 1 - y), bytes.data() + start + stride * static_cast<size_t>(y), stride);
  return image;
}

absl::Status WritePfm(const std::string& path, ImageView<const float> image) {
  return WriteFile(path, EncodePfm(image));
}

}  // namespace depthtween
