// Result folders: what is written must be read, and files are as the documentation says.
#include "core/io/result_folder.h"

#include <nlohmann/json.hpp>

#include "core/io/file.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::HasSubstr;

constexpr double kScale = 1000;

Sequence TwoFrames() {
  return {.camera = SmallCamera(),
          .depth_scale = kScale,
          .color = {{0, "rgb/first.jpg"}, {4166667, "rgb/second.jpg"}},
          .depth = {{0, "depth/a.png"}}};
}

// Depth and uncertainty that kScale holds exactly, all provenances, an unknown pixel.
DepthResult SomeResult(int index) {
  DepthResult result{index, Image<float>(8, 6), Image<float>(8, 6), Image<Provenance>(8, 6)};
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) {
      result.depth_m(x, y) = static_cast<float>((1000 + 10 * x + y + index) / kScale);
      result.sigma_m(x, y) = static_cast<float>((1 + x) / kScale);
      result.provenance(x, y) = static_cast<Provenance>(1 + (x + y) % 5);
    }
  }
  result.depth_m(2, 2) = result.sigma_m(2, 2) = 0.0F;
  result.provenance(2, 2) = Provenance::kNone;
  return result;
}

void ExpectSame(const DepthResult& a, const DepthResult& b) {
  EXPECT_TRUE(SamePixels(a.depth_m, b.depth_m));
  EXPECT_TRUE(SamePixels(a.sigma_m, b.sigma_m));
  EXPECT_TRUE(SamePixels(a.provenance, b.provenance));
}

TEST(ResultFolder, ReadsBackWhatWasWritten) {
  const TemporaryFolder temp;
  const auto writer = ResultWriter::Create(temp / "out", TwoFrames());
  ASSERT_THAT(writer, IsOk());
  ASSERT_THAT(writer->Write(SomeResult(1)), IsOk());
  ASSERT_THAT(writer->Write(SomeResult(0)), IsOk());
  ASSERT_THAT(writer->Finish({{"frames", 2}}), IsOk());

  const auto folder = ResultFolder::Open(temp / "out");
  ASSERT_THAT(folder, IsOk());
  EXPECT_EQ(folder->depth_scale(), kScale);
  EXPECT_EQ(folder->camera().fx, 7.5);
  EXPECT_EQ(folder->report().at("frames"), 2);
  ASSERT_EQ(folder->frames().size(), 2U);
  EXPECT_EQ(folder->frames()[1].time_ns, 4166667);
  EXPECT_EQ(folder->frames()[1].path, "depth/second.png");
  for (int i = 0; i < 2; ++i)
    ExpectSame({i, *folder->Depth(i), *folder->Sigma(i), *folder->ProvenanceAt(i)}, SomeResult(i));
  EXPECT_THAT(folder->Depth(2), HasStatus(StatusCode::kInvalidArgument, HasSubstr("frame 2 does not exist")));
}

// What EVALUATION.md says of the files: input scale, 65535 for unknown uncertainty, provenance 0 to 5.
TEST(ResultFolder, FilesAreAsDocumented) {
  const TemporaryFolder temp;
  ASSERT_THAT(ResultWriter::Create(temp.path(), TwoFrames()), IsOk());
  ASSERT_THAT(WriteResultFrame(temp.path(), "second", kScale, SomeResult(1)), IsOk());
  const auto depth = ReadPng16(temp / "depth/second.png");
  const auto uncertainty = ReadPng16(temp / "uncertainty/second.png");
  const auto provenance = ReadPng8(temp / "provenance/second.png");
  ASSERT_THAT(depth, IsOk());
  ASSERT_THAT(uncertainty, IsOk());
  ASSERT_THAT(provenance, IsOk());
  EXPECT_EQ((*depth)(3, 1), 1000 + 30 + 1 + 1);
  EXPECT_EQ((*depth)(2, 2), 0);
  EXPECT_EQ((*uncertainty)(3, 1), 4);
  EXPECT_EQ((*uncertainty)(2, 2), 65535);
  EXPECT_EQ((*provenance)(3, 1), 5);
  EXPECT_EQ((*provenance)(2, 2), 0);
}

// Several processes write one folder: the second must not undo the first, and the last one ends it.
TEST(ResultFolder, WritersShareAFolder) {
  const TemporaryFolder temp;
  ASSERT_THAT(ResultWriter::Create(temp.path(), TwoFrames())->Write(SomeResult(0)), IsOk());
  const auto second = ResultWriter::Create(temp.path(), TwoFrames());
  ASSERT_THAT(second, IsOk());
  EXPECT_THAT(second->Finish(nlohmann::json::object()),
              HasStatus(StatusCode::kFailedPrecondition, HasSubstr("second.png")));
  EXPECT_THAT(ResultFolder::Open(temp.path()), HasStatus(StatusCode::kFailedPrecondition, HasSubstr("not finished")));
  ASSERT_THAT(second->Write(SomeResult(1)), IsOk());
  ASSERT_THAT(ResultWriter::Create(temp.path(), TwoFrames())->Finish(nlohmann::json::object()), IsOk());
  EXPECT_THAT(ResultFolder::Open(temp.path()), IsOk());
  const auto frame = ReadResultFrame(temp.path(), "first", kScale);
  ASSERT_THAT(frame, IsOk());
  ExpectSame(*frame, SomeResult(0));
}

TEST(ResultFolder, NeverOverwritesARecording) {
  const TemporaryFolder temp;
  Put(temp / "rgb.txt", "0 rgb/first.jpg\n");
  EXPECT_THAT(ResultWriter::Create(temp.path(), TwoFrames()),
              HasStatus(StatusCode::kAlreadyExists, HasSubstr("recording")));
}

TEST(ResultFolder, RefusesFramesThatDoNotFit) {
  const TemporaryFolder temp;
  const auto writer = ResultWriter::Create(temp.path(), TwoFrames());
  ASSERT_THAT(writer, IsOk());
  DepthResult result = SomeResult(2);
  EXPECT_THAT(writer->Write(result), HasStatus(StatusCode::kInvalidArgument, HasSubstr("frame 2 does not exist")));
  result.color_index = 0;
  result.sigma_m = Image<float>(4, 6);
  EXPECT_THAT(writer->Write(result), HasStatus(StatusCode::kInvalidArgument, HasSubstr("uncertainty 4 x 6")));
  result.depth_m = Image<float>(4, 6);
  EXPECT_THAT(writer->Write(result), HasStatus(StatusCode::kInvalidArgument, HasSubstr("must be the camera's 8 x 6")));
}

TEST(ResultFolder, NamesDamagedFiles) {
  const TemporaryFolder temp;
  const auto writer = ResultWriter::Create(temp.path(), TwoFrames());
  for (int i = 0; i < 2; ++i) ASSERT_THAT(writer->Write(SomeResult(i)), IsOk());
  ASSERT_THAT(writer->Finish(nlohmann::json::object()), IsOk());
  ASSERT_THAT(WritePng8(temp / "provenance/first.png", Image<uint8_t>(8, 6, 6)), IsOk());
  Put(temp / "uncertainty/first.png", "");
  const auto folder = ResultFolder::Open(temp.path());
  ASSERT_THAT(folder, IsOk());
  EXPECT_THAT(folder->ProvenanceAt(0),
              HasStatus(StatusCode::kDataLoss, HasSubstr("provenance/first.png: value 6 at (0, 0)")));
  EXPECT_THAT(folder->Sigma(0), HasStatus(StatusCode::kDataLoss, HasSubstr("uncertainty/first.png")));
  ASSERT_THAT(WritePng16(temp / "depth/first.png", Image<uint16_t>(2, 2)), IsOk());
  ASSERT_THAT(WriteResultFrame(temp.path(), "second", kScale, SomeResult(1)), IsOk());
  ASSERT_THAT(WritePng16(temp / "depth/second.png", Image<uint16_t>(2, 2)), IsOk());
  EXPECT_THAT(ReadResultFrame(temp.path(), "second", kScale),
              HasStatus(StatusCode::kDataLoss, HasSubstr("differ in size")));
  Put(temp / "report.json", "{");
  EXPECT_THAT(ResultFolder::Open(temp.path()), HasStatus(StatusCode::kDataLoss, HasSubstr("report.json")));
  std::filesystem::remove(temp / "depth/second.png");
  EXPECT_THAT(ResultFolder::Open(temp.path()), HasStatus(StatusCode::kNotFound, HasSubstr("depth/second.png")));
}

// Motion is kept to a 32nd of a pixel, and frames without it are none the worse.
TEST(ResultFolder, KeepsMotionWhereThereIsSome) {
  const TemporaryFolder temp;
  const auto writer = ResultWriter::Create(temp / "out", TwoFrames(), /*with_motion=*/true);
  ASSERT_THAT(writer, IsOk());
  DepthResult result = SomeResult(0);
  result.motion_next = Image<Flow2>(8, 6);
  result.motion_back = Image<Flow2>(8, 6, Flow2{-1.5F, 40.25F});
  for (int x = 0; x < 8; ++x) result.motion_next(x, 3) = {0.3F * static_cast<float>(x), -17.01F};
  ASSERT_THAT(writer->Write(result), IsOk());
  ASSERT_THAT(writer->Write(SomeResult(1)), IsOk());
  const auto motion = ReadResultMotion(temp / "out", "first");
  ASSERT_THAT(motion, IsOk());
  EXPECT_EQ(motion->back(5, 5), (Flow2{-1.5F, 40.25F}));
  for (int x = 0; x < 8; ++x) {
    EXPECT_NEAR(motion->next(x, 3).u, 0.3F * static_cast<float>(x), 1.0 / 64);
    EXPECT_NEAR(motion->next(x, 3).v, -17.01F, 1.0 / 64);
  }
  EXPECT_EQ(ReadResultMotion(temp / "out", "second").status().code(), StatusCode::kNotFound);

  Npz other = {{"next", NpyArray::FromFloats({2, 2, 2}, std::vector<float>(8), ElementType::kFloat16)}};
  ASSERT_THAT(WriteNpz(temp / "out/motion/second.npz", other), IsOk());
  EXPECT_EQ(ReadResultMotion(temp / "out", "second").status().code(), StatusCode::kDataLoss);
  result.motion_back = Image<Flow2>(7, 6);
  EXPECT_EQ(writer->Write(result).code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace depthtween
