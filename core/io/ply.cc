#include "core/io/ply.h"

#include <bit>
#include <cstring>
#include <optional>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "core/io/file.h"

namespace depthtween {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie in memory");

constexpr size_t kPointBytes = 3 * sizeof(float);
constexpr size_t kColorBytes = 3;
constexpr size_t kFaceBytes = 1 + 3 * sizeof(int32_t);

template <typename T>
void Append(std::string& bytes, const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

// Copies and consumes; the caller has checked that the bytes are there.
template <typename T>
T TakeValue(std::string_view& bytes) {
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  bytes.remove_prefix(sizeof value);
  return value;
}

struct Layout {
  int64_t point_count = 0, face_count = 0;
  bool has_color = false;
};

absl::StatusOr<int64_t> ParseCount(absl::string_view line) {
  int64_t count = 0;
  const std::vector<absl::string_view> words = absl::StrSplit(line, ' ');
  if (!absl::SimpleAtoi(words.back(), &count) || count < 0)
    return absl::DataLossError(absl::StrFormat("damaged PLY: '%s' has no count", absl::CHexEscape(line.substr(0, 80))));
  return count;
}

// Consumes the header.
absl::StatusOr<Layout> TakeHeader(std::string_view& bytes) {
  const auto next_line = [&bytes]() -> std::optional<absl::string_view> {
    for (;;) {
      const size_t end = bytes.find('\n');
      if (end == std::string_view::npos) return std::nullopt;
      const absl::string_view line(bytes.data(), end);
      bytes.remove_prefix(end + 1);
      if (!absl::StartsWith(line, "comment")) return line;
    }
  };
  Layout layout;
  std::string properties;
  for (int line_number = 1;; ++line_number) {
    const std::optional<absl::string_view> line = next_line();
    if (!line) return absl::DataLossError("damaged PLY: the header does not end");
    if (line_number == 1) {
      if (*line != "ply") return absl::DataLossError("not a PLY");
    } else if (line_number == 2) {
      if (*line != "format binary_little_endian 1.0")
        return absl::InvalidArgumentError(
            absl::StrFormat("PLY has '%s', must be binary_little_endian 1.0", absl::CHexEscape(line->substr(0, 80))));
    } else if (absl::StartsWith(*line, "element vertex ")) {
      ASSIGN_OR_RETURN(layout.point_count, ParseCount(*line));
      properties += "vertex:";
    } else if (absl::StartsWith(*line, "element face ")) {
      ASSIGN_OR_RETURN(layout.face_count, ParseCount(*line));
      properties += "face:";
    } else if (absl::StartsWith(*line, "property ")) {
      absl::StrAppend(&properties, line->substr(9), ";");
    } else if (*line == "end_header") {
      break;
    } else {
      return absl::InvalidArgumentError(absl::StrFormat("PLY has '%s', which we do not read: vertex and face only",
                                                        absl::CHexEscape(line->substr(0, 80))));
    }
  }
  constexpr absl::string_view kPosition = "vertex:float x;float y;float z;";
  constexpr absl::string_view kColor = "uchar red;uchar green;uchar blue;";
  constexpr absl::string_view kFace = "face:list uchar int vertex_indices;";
  absl::string_view rest = properties;
  const bool has_position = absl::ConsumePrefix(&rest, kPosition);
  layout.has_color = absl::ConsumePrefix(&rest, kColor);
  absl::ConsumePrefix(&rest, kFace);
  if (!has_position || !rest.empty())
    return absl::InvalidArgumentError(
        absl::StrFormat("PLY has the properties '%s', must be '%s' then '%s' if coloured, '%s' if a mesh",
                        absl::CHexEscape(properties.substr(0, 200)), kPosition, kColor, kFace));
  return layout;
}

}  // namespace

absl::StatusOr<PlyMesh> PointCloudFromDepth(const Camera& camera, ImageView<const float> depth_m,
                                            ImageView<const Rgb8> color) {
  if (depth_m.width() != camera.width || depth_m.height() != camera.height)
    return absl::InvalidArgumentError(absl::StrFormat("depth is %d x %d pixels, must be the camera's %d x %d",
                                                      depth_m.width(), depth_m.height(), camera.width, camera.height));
  if (!color.empty() && !color.SameSize(depth_m))
    return absl::InvalidArgumentError(absl::StrFormat("colour is %d x %d pixels, must be depth's %d x %d",
                                                      color.width(), color.height(), depth_m.width(),
                                                      depth_m.height()));
  PlyMesh cloud;
  for (int y = 0; y < depth_m.height(); ++y) {
    for (int x = 0; x < depth_m.width(); ++x) {
      if (depth_m(x, y) <= 0.0F) continue;
      const Vec3 point = camera.Unproject({x, y}, depth_m(x, y));
      cloud.points.push_back(
          {static_cast<float>(point.x()), static_cast<float>(point.y()), static_cast<float>(point.z())});
      if (!color.empty()) cloud.colors.push_back(color(x, y));
    }
  }
  return cloud;
}

absl::StatusOr<std::string> EncodePly(const PlyMesh& mesh) {
  if (!mesh.colors.empty() && mesh.colors.size() != mesh.points.size())
    return absl::InvalidArgumentError(absl::StrFormat("mesh has %d colours for %d points, must have one each or none",
                                                      mesh.colors.size(), mesh.points.size()));
  const auto point_count = static_cast<int64_t>(mesh.points.size());
  for (const auto& face : mesh.faces) {
    for (const int32_t index : face) {
      if (index < 0 || index >= point_count)
        return absl::InvalidArgumentError(absl::StrFormat("a face names point %d, there are %d", index, point_count));
    }
  }
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment metres; x right, y down, z forward\n";
  absl::StrAppendFormat(&bytes, "element vertex %d\nproperty float x\nproperty float y\nproperty float z\n",
                        point_count);
  if (!mesh.colors.empty()) bytes += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  if (!mesh.faces.empty())
    absl::StrAppendFormat(&bytes, "element face %d\nproperty list uchar int vertex_indices\n", mesh.faces.size());
  bytes += "end_header\n";
  bytes.reserve(bytes.size() + mesh.points.size() * (kPointBytes + kColorBytes) + mesh.faces.size() * kFaceBytes);
  for (size_t i = 0; i < mesh.points.size(); ++i) {
    Append(bytes, mesh.points[i]);
    if (!mesh.colors.empty()) Append(bytes, mesh.colors[i]);
  }
  for (const auto& face : mesh.faces) {
    Append(bytes, uint8_t{3});
    Append(bytes, face);
  }
  return bytes;
}

absl::StatusOr<PlyMesh> DecodePly(std::string_view bytes) {
  ASSIGN_OR_RETURN(const Layout layout, TakeHeader(bytes));
  // Counts are held against the bytes that are there, one after the other, before anything is multiplied or allocated.
  const auto byte_count = static_cast<int64_t>(bytes.size());
  const auto point_bytes = static_cast<int64_t>(kPointBytes + (layout.has_color ? kColorBytes : 0));
  if (layout.point_count > byte_count / point_bytes ||
      layout.face_count > (byte_count - layout.point_count * point_bytes) / static_cast<int64_t>(kFaceBytes))
    return absl::DataLossError(
        absl::StrFormat("damaged PLY: %d bytes cannot hold %d points and %d faces, the file is cut short", byte_count,
                        layout.point_count, layout.face_count));
  PlyMesh mesh;
  mesh.points.reserve(layout.point_count);
  for (int64_t i = 0; i < layout.point_count; ++i) {
    mesh.points.push_back(TakeValue<Point3f>(bytes));
    if (layout.has_color) mesh.colors.push_back(TakeValue<Rgb8>(bytes));
  }
  mesh.faces.reserve(layout.face_count);
  for (int64_t i = 0; i < layout.face_count; ++i) {
    if (const auto corners = TakeValue<uint8_t>(bytes); corners != 3)
      return absl::InvalidArgumentError(absl::StrFormat("PLY has a face of %d corners, must be triangles", corners));
    mesh.faces.push_back(TakeValue<std::array<int32_t, 3>>(bytes));
    for (const int32_t index : mesh.faces.back()) {
      if (index < 0 || index >= layout.point_count)
        return absl::DataLossError(
            absl::StrFormat("damaged PLY: a face names point %d, there are %d", index, layout.point_count));
    }
  }
  return mesh;
}

absl::Status WritePly(const std::string& path, const PlyMesh& mesh) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodePly(mesh));
  return WriteFile(path, bytes);
}

absl::StatusOr<PlyMesh> ReadPly(const std::string& path) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  absl::StatusOr<PlyMesh> mesh = DecodePly(bytes);
  if (!mesh.ok()) return WithContext(mesh.status(), path);
  return mesh;
}

}  // namespace depthtween
