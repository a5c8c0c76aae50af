#include "core/io/ply.h"

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::_;
using testing::HasSubstr;

PlyMesh Triangle() {
  return {.points = {{0, 0, 1}, {1, 0, 1.5F}, {0, 1, 2}},
          .colors = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}},
          .faces = {{0, 1, 2}}};
}

TEST(Ply, RoundTripsMeshesAndClouds) {
  PlyMesh mesh = Triangle();
  for (int variant = 0; variant < 3; ++variant) {
    const auto decoded = DecodePly(*EncodePly(mesh));
    ASSERT_THAT(decoded, IsOk());
    EXPECT_EQ(decoded->points, mesh.points);
    EXPECT_EQ(decoded->colors, mesh.colors);
    EXPECT_EQ(decoded->faces, mesh.faces);
    variant == 0 ? mesh.faces.clear() : mesh.colors.clear();
  }
}

// Turk's format: a text header, then numbers. Read here by eye.
TEST(Ply, HeaderIsWhatViewersExpect) {
  const std::string bytes = *EncodePly(Triangle());
  EXPECT_TRUE(bytes.starts_with("ply\nformat binary_little_endian 1.0\n"));
  EXPECT_THAT(bytes, HasSubstr("element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                               "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                               "element face 1\nproperty list uchar int vertex_indices\nend_header\n"));
  EXPECT_EQ(bytes.size() - bytes.find("end_header\n") - 11, 3U * 15 + 13);
}

// The pinhole formula by hand: X = (x - cx) z / f.
TEST(Ply, BackProjectsKnownPixels) {
  const Camera camera = {.width = 3, .height = 2, .fx = 2, .fy = 4, .cx = 1, .cy = 0};
  Image<float> depth(3, 2);
  depth(0, 0) = 2.0F;
  depth(2, 1) = 1.0F;
  Image<Rgb8> color(3, 2);
  color(2, 1) = {1, 2, 3};
  const auto cloud = PointCloudFromDepth(camera, depth, color);
  ASSERT_THAT(cloud, IsOk());
  EXPECT_EQ(cloud->points, (std::vector<Point3f>{{-1, 0, 2}, {0.5F, 0.25F, 1}}));
  EXPECT_EQ(cloud->colors, (std::vector<Rgb8>{{0, 0, 0}, {1, 2, 3}}));
  EXPECT_TRUE(PointCloudFromDepth(camera, depth, {})->colors.empty());
  EXPECT_THAT(PointCloudFromDepth(camera, Image<float>(2, 2), {}),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("2 x 2")));
  EXPECT_THAT(PointCloudFromDepth(camera, depth, Image<Rgb8>(1, 1)),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("colour is 1 x 1")));
}

TEST(Ply, RefusesBadMeshes) {
  PlyMesh mesh = Triangle();
  mesh.faces[0][2] = 3;
  EXPECT_THAT(EncodePly(mesh), HasStatus(StatusCode::kInvalidArgument, HasSubstr("names point 3")));
  mesh = Triangle();
  mesh.colors.pop_back();
  EXPECT_THAT(EncodePly(mesh), HasStatus(StatusCode::kInvalidArgument, HasSubstr("2 colours for 3 points")));
}

TEST(Ply, RefusesDamagedAndForeignFiles) {
  const std::string file = *EncodePly(Triangle());
  for (size_t size = 0; size < file.size(); ++size) EXPECT_FALSE(DecodePly(file.substr(0, size)).ok()) << size;
  const auto patched = [&file](const std::string& from, const std::string& to) {
    std::string text = file;
    return text.replace(text.find(from), from.size(), to);
  };
  EXPECT_THAT(DecodePly(patched("vertex 3", "vertex 999999999999999999")),
              HasStatus(StatusCode::kDataLoss, HasSubstr("cut short")));
  EXPECT_THAT(DecodePly(patched("face 1", "face -1")), HasStatus(StatusCode::kDataLoss, HasSubstr("count")));
  EXPECT_THAT(DecodePly(patched("binary_little_endian", "ascii")),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("ascii")));
  EXPECT_THAT(DecodePly(patched("float x", "double x")),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("double x")));
  EXPECT_THAT(DecodePly("obj\n"), HasStatus(StatusCode::kDataLoss, HasSubstr("not a PLY")));
}

TEST(Ply, ReadsAndWritesFiles) {
  const TempFolder folder;
  ASSERT_THAT(WritePly(folder / "a.ply", Triangle()), IsOk());
  EXPECT_EQ(ReadPly(folder / "a.ply")->points.size(), 3U);
  EXPECT_THAT(ReadPly(folder / "b.ply"), HasStatus(StatusCode::kNotFound, _));
}

}  // namespace
}  // namespace depthtween
