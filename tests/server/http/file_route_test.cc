// Paths of files. The truth is the table in the header: each route once, and what is nearly one.
#include "server/http/file_route.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/str_split.h"

namespace depthtween::server {
namespace {

using FileKind = FileRoute::Kind;

std::optional<FileRoute> Match(std::string_view path) {
  return MatchFileRoute(absl::StrSplit(absl::string_view(path.data(), path.size()), '/'));
}

TEST(FileRoute, FindsFrames) {
  const auto png = Match("v1/jobs/7/outputs/depth/frames/12.png");
  ASSERT_TRUE(png);
  EXPECT_EQ(png->kind, FileKind::kFrame);
  EXPECT_EQ(png->resource, "jobs/7/outputs/depth");
  EXPECT_EQ(png->frame, 12);
  EXPECT_EQ(png->encoding, v1::ENCODING_PNG);
  EXPECT_EQ(Match("v1/jobs/7/outputs/dof/frames/0.jpg")->encoding, v1::ENCODING_JPEG);
  EXPECT_EQ(Match("v1/jobs/7/outputs/sceneflow/frames/0.npz")->encoding, v1::ENCODING_NPZ);
  EXPECT_EQ(Match("v1/jobs/7/outputs/flow/frames/0.flo")->encoding, v1::ENCODING_FLO);
  EXPECT_EQ(Match("v1/jobs/7/outputs/flow/frames/2147483646.pfm")->frame, 2147483646);
}

TEST(FileRoute, FindsFilesAndUploads) {
  const std::tuple<const char*, FileKind, const char*> routes[] = {
      {"v1/jobs/7/outputs/depth.zip", FileKind::kArchive, "jobs/7/outputs/depth"},
      {"v1/jobs/7/outputs/kitti-disp_0.zip", FileKind::kArchive, "jobs/7/outputs/kitti-disp_0"},
      {"v1/jobs/7/outputs/report:download", FileKind::kFile, "jobs/7/outputs/report"},
      {"v1/sequences/s/uploads:tus", FileKind::kTusCreation, "sequences/s"},
      {"v1/sequences/s/uploads/u:tus", FileKind::kTusUpload, "sequences/s/uploads/u"},
      {"v1/sequences/s/uploads/u", FileKind::kUpload, "sequences/s/uploads/u"},
  };
  for (const auto& [path, kind, resource] : routes) {
    const auto route = Match(path);
    ASSERT_TRUE(route) << path;
    EXPECT_EQ(route->kind, kind) << path;
    EXPECT_EQ(route->resource, resource) << path;
    EXPECT_FALSE(MethodsOf(kind).empty());
  }
}

TEST(FileRoute, LeavesAllElseToOthers) {
  for (const char* path : {"",
                           "v1",
                           "v1/jobs/7",
                           "v1/jobs/7/outputs",
                           "v1/jobs/7/outputs/depth",
                           "v1/jobs/7/outputs/.zip",
                           "v1/jobs/7/outputs/:download",
                           "v1/jobs/7/outputs/depth:read",
                           "v1/jobs/7/outputs/depth/frames/",
                           "v1/jobs/7/outputs/depth/frames/.png",
                           "v1/jobs/7/outputs/depth/frames/1",
                           "v1/jobs/7/outputs/depth/frames/1.gif",
                           "v1/jobs/7/outputs/depth/frames/-1.png",
                           "v1/jobs/7/outputs/depth/frames/x.png",
                           "v1/jobs/7/outputs/depth/frames/2147483647.png",
                           "v1/jobs/7/outputs/depth/frames/1.png/x",
                           "v2/jobs/7/outputs/depth.zip",
                           "v1/sequences/s/uploads",
                           "v1/sequences/s/uploads/u:write",
                           "v1/sequences/s:tus",
                           "v1/sequences/s/uploads/u/x",
                           "v1/jobs/7/uploads/u",
                           "v1/sequences/\xC3/uploads/u",
                           "v1/sequences/a b/uploads/u"}) {
    EXPECT_FALSE(Match(path)) << path;
  }
}

TEST(ExtensionOf, IsWhatAPathHas) {
  EXPECT_EQ(ExtensionOf(v1::ENCODING_PNG), ".png");
  EXPECT_EQ(ExtensionOf(v1::ENCODING_NPZ), ".npz");
  EXPECT_EQ(ExtensionOf(v1::ENCODING_RAW), ".bin");
}

}  // namespace
}  // namespace depthtween::server
