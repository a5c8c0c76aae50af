// Point clouds and meshes as PLY, which MeshLab, CloudCompare, Blender and Open3D open.
//
// Source: Greg Turk, "The PLY Polygon File Format", 1994. We write and read binary little endian with float positions.
#ifndef DEPTHTWEEN_CORE_IO_PLY_H_
#define DEPTHTWEEN_CORE_IO_PLY_H_

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/geometry/camera.h"

namespace depthtween {

struct Point3f {
  float x = 0.0F, y = 0.0F, z = 0.0F;
  friend bool operator==(const Point3f& a, const Point3f& b) { return a.x == b.x && a.y == b.y && a.z == b.z; }
};

// A point cloud when there are no faces.
struct PlyMesh {
  std::vector<Point3f> points;                // metres, camera frame: x right, y down, z forward
  std::vector<Rgb8> colors;                   // one per point, or empty
  std::vector<std::array<int32_t, 3>> faces;  // indices into points
};

// The points of all known pixels, row by row. InvalidArgument when the sizes of camera and images differ. `color` may
// be empty.
absl::StatusOr<PlyMesh> PointCloudFromDepth(const Camera& camera, ImageView<const float> depth_m,
                                            ImageView<const Rgb8> color);

// InvalidArgument when colours are neither none nor one per point, or a face names a point that is not there.
absl::StatusOr<std::string> EncodePly(const PlyMesh& mesh);
// Reads what EncodePly writes. DataLoss for damaged bytes; InvalidArgument for other layouts, with what was found.
absl::StatusOr<PlyMesh> DecodePly(std::string_view bytes);

absl::Status WritePly(const std::string& path, const PlyMesh& mesh);
absl::StatusOr<PlyMesh> ReadPly(const std::string& path);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_PLY_H_
