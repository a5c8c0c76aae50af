// Sequence folders: what is written must be read, and exactly the damage that was done must be named.
#include "core/io/sequence_folder.h"

#include <atomic>
#include <nlohmann/json.hpp>

#include "core/io/file.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sequence/camera_json.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kDepthScale = 5000;

// A depth that 16 bits at kDepthScale hold exactly, with an unknown pixel.
Image<float> SomeDepth(int frame) {
  Image<uint16_t> units(8, 6);
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) units(x, y) = static_cast<uint16_t>(5000 + 100 * x + 10 * y + frame);
  }
  units(3, 3) = 0;
  return DequantiseDepth(units, kDepthScale);
}

// Four colour frames and two depth frames of their own clock.
class SequenceFolderTest : public testing::Test {
 protected:
  void SetUp() override {
    auto writer = SequenceWriter::Create(dir(), SmallCamera(), kDepthScale);
    ASSERT_THAT(writer, IsOk());
    for (int i = 0; i < 4; ++i) ASSERT_THAT(writer->AddColor(i * 10000000, NoisyImage<Rgb8>(8, 6, i)), IsOk());
    for (int i = 0; i < 2; ++i) ASSERT_THAT(writer->AddDepth(i * 25000000 + 123, SomeDepth(i)), IsOk());
    ASSERT_THAT(writer->Finish(), IsOk());
  }

  std::string dir() const { return temp_ / "clip"; }
  std::string Path(const std::string& name) const { return dir() + "/" + name; }
  void Append(const std::string& name, const std::string& line) { Put(Path(name), Get(Path(name)) + line + "\n"); }
  void WriteCamera(const std::string& field, const nlohmann::json& value) {
    nlohmann::json camera = CameraToJson(SmallCamera(), kDepthScale);
    camera[field] = value;
    Put(Path("camera.json"), camera.dump());
  }
  // What the full check and opening say of the only offending file.
  void ExpectViolation(const std::string& file, StatusCode code, const testing::Matcher<std::string>& message,
                       bool found_by_open = true) {
    const auto check = CheckSequenceFolder(dir());
    ASSERT_THAT(check, IsOk());
    ASSERT_EQ(check->violations.size(), 1U);
    EXPECT_EQ(check->violations[0].file, file);
    EXPECT_THAT(check->violations[0].status, HasStatus(code, message));
    if (found_by_open) {
      EXPECT_THAT(SequenceFolder::Open(dir()), HasStatus(code, AllOf(HasSubstr(file), message)));
    }
  }

  const TemporaryFolder temp_;
};

TEST_F(SequenceFolderTest, ReadsBackWhatWasWritten) {
  const auto folder = SequenceFolder::Open(dir());
  ASSERT_THAT(folder, IsOk());
  const Sequence& sequence = (*folder)->sequence();
  ASSERT_EQ(sequence.color.size(), 4U);
  ASSERT_EQ(sequence.depth.size(), 2U);
  EXPECT_EQ(sequence.color[3].time_ns, 30000000);
  EXPECT_EQ(sequence.color[3].path, "rgb/000003.png");
  EXPECT_EQ(sequence.depth[1].time_ns, 25000123);
  EXPECT_EQ(sequence.depth_scale, kDepthScale);
  EXPECT_EQ(sequence.camera.fy, 7.25);
  EXPECT_TRUE(SamePixels(*(*folder)->Color(2), NoisyImage<Rgb8>(8, 6, 2)));
  EXPECT_TRUE(SamePixels(*(*folder)->Depth(1), SomeDepth(1)));
}

TEST_F(SequenceFolderTest, CheckFindsNothingWrong) {
  std::atomic<int> calls = 0;
  const auto check = CheckSequenceFolder(dir(), {.threads = 2, .on_progress = [&](int checked, int total) {
                                                   EXPECT_EQ(checked, ++calls);
                                                   EXPECT_EQ(total, 6);
                                                 }});
  ASSERT_THAT(check, IsOk());
  EXPECT_TRUE(check->ok());
  EXPECT_THAT(check->warnings, IsEmpty());
  EXPECT_EQ(calls, 6);
  // 47 known pixels a frame, 5000 + 100 x + 10 y + frame; counted by hand: 5350 and 5351 surround the middle.
  EXPECT_NEAR(check->median_depth_m, 1.07, 0.02);
}

TEST_F(SequenceFolderTest, CheckStops) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THAT(CheckSequenceFolder(dir(), {.stop = stop.get_token()}), HasStatus(StatusCode::kCancelled, testing::_));
}

TEST_F(SequenceFolderTest, NamesMissingParts) {
  EXPECT_THAT(SequenceFolder::Open(temp_ / "none"), HasStatus(StatusCode::kNotFound, HasSubstr("none")));
  EXPECT_THAT(CheckSequenceFolder(temp_ / "none"), HasStatus(StatusCode::kNotFound, HasSubstr("none")));
  for (const char* name : {"rgb.txt", "depth.txt", "camera.json"}) {
    const std::string bytes = Get(Path(name));
    std::filesystem::remove(Path(name));
    ExpectViolation(name, StatusCode::kNotFound, HasSubstr("missing"));
    EXPECT_THAT(ReadSequenceHeader(dir()), HasStatus(StatusCode::kNotFound, HasSubstr(name)));
    Put(Path(name), bytes);
  }
}

TEST_F(SequenceFolderTest, NamesMissingFrames) {
  std::filesystem::remove(Path("rgb/000001.png"));
  ExpectViolation("rgb/000001.png", StatusCode::kNotFound, HasSubstr("listed in rgb.txt but missing"));
}

TEST_F(SequenceFolderTest, NamesTruncatedFrames) {
  const std::string bytes = Get(Path("depth/000001.png"));
  Put(Path("depth/000001.png"), bytes.substr(0, bytes.size() / 2));
  ExpectViolation("depth/000001.png", StatusCode::kDataLoss, HasSubstr("damaged PNG"), /*found_by_open=*/false);
  const auto folder = SequenceFolder::Open(dir());
  EXPECT_THAT((*folder)->Depth(1), HasStatus(StatusCode::kDataLoss, HasSubstr("depth/000001.png: damaged PNG")));
}

TEST_F(SequenceFolderTest, NamesDepthOfEightBits) {
  ASSERT_THAT(WritePng8(Path("depth/000000.png"), Image<uint8_t>(8, 6)), IsOk());
  ExpectViolation("depth/000000.png", StatusCode::kInvalidArgument,
                  AllOf(HasSubstr("is 8-bit grey, must be 16-bit grey"), HasSubstr("depth_scale")),
                  /*found_by_open=*/false);
}

TEST_F(SequenceFolderTest, NamesFramesOfAnotherSize) {
  ASSERT_THAT(WritePng16(Path("depth/000001.png"), Image<uint16_t>(4, 3)), IsOk());
  ExpectViolation("depth/000001.png", StatusCode::kInvalidArgument,
                  AllOf(HasSubstr("is 4 x 3 pixels, camera.json says 8 x 6"), HasSubstr("2 times as wide"),
                        HasSubstr("INTER_NEAREST"), HasSubstr("(8,6)")),
                  /*found_by_open=*/false);
  const auto folder = SequenceFolder::Open(dir());
  EXPECT_THAT((*folder)->Depth(1), HasStatus(StatusCode::kInvalidArgument, HasSubstr("depth/000001.png: is 4 x 3")));
}

TEST_F(SequenceFolderTest, NamesHugeHeaders) {
  Put(Path("depth/000001.png"), PngHeader(60000, 60000, 16, 0));
  ExpectViolation("depth/000001.png", StatusCode::kResourceExhausted, HasSubstr("60000 x 60000"),
                  /*found_by_open=*/false);
}

// The header tells, so no pixel of it is decoded: the frame has none.
TEST_F(SequenceFolderTest, NamesFramesLargerThanTheCamera) {
  Put(Path("depth/000001.png"), PngHeader(9, 6, 16, 0));
  ExpectViolation("depth/000001.png", StatusCode::kResourceExhausted,
                  AllOf(HasSubstr("camera.json says 8 x 6"), HasSubstr("image is 9 x 6 pixels")),
                  /*found_by_open=*/false);
}

// Six frames of 8 x 6 pixels.
TEST_F(SequenceFolderTest, PixelsOfASequenceAreBounded) {
  EXPECT_THAT(CheckSequenceFolder(dir(), {.max_pixels = 288})->violations, IsEmpty());
  int decoded = 0;
  const auto check =
      CheckSequenceFolder(dir(), {.max_pixels = 287, .on_progress = [&](int checked, int) { decoded = checked; }});
  ASSERT_THAT(check, IsOk());
  ASSERT_EQ(check->violations.size(), 1U);
  EXPECT_EQ(check->violations[0].file, "camera.json");
  EXPECT_THAT(check->violations[0].status,
              HasStatus(StatusCode::kResourceExhausted,
                        HasSubstr("6 frames of 8 x 6 pixels are 288 pixels, at most 287 are allowed")));
  EXPECT_EQ(decoded, 0);
}

// A thousand colour frames that are one small file: 64 megapixels of zeros, whose decoding takes a large part of a
// second each. The answer comes from the camera and the lists.
TEST_F(SequenceFolderTest, BombsAreRefusedUnopened) {
  const std::string rows(8000 * (8000 / 8 + 1), '\0');  // 1-bit grey
  const std::string bomb = PngFile(8000, 8000, 1, 0, rows);
  EXPECT_LT(bomb.size(), 100'000U);
  std::string list;
  for (int i = 0; i < 1000; ++i) {
    const std::string name = "rgb/bomb" + std::to_string(i) + ".png";
    Put(Path(name), bomb);
    list += std::to_string(i) + ".0 " + name + "\n";
  }
  Put(Path("rgb.txt"), list);
  Camera camera = SmallCamera();
  camera.width = camera.height = 8000;
  camera.fx = camera.fy = 8000;
  Put(Path("camera.json"), FormatCameraJson(camera, kDepthScale));
  const auto check = CheckSequenceFolder(dir(), {.max_pixels = 10'000'000'000});
  ASSERT_THAT(check, IsOk());
  ASSERT_FALSE(check->ok());
  EXPECT_THAT(std::string(check->violations[0].status.message()), HasSubstr("1002 frames of 8000 x 8000 pixels"));
  // Without a camera each frame has its share, which is 10 megapixels.
  std::filesystem::remove(Path("camera.json"));
  const auto without = CheckSequenceFolder(dir(), {.max_pixels = 10'000'000'000});
  ASSERT_THAT(without, IsOk());
  EXPECT_EQ(without->violations.size(), 1001U) << "camera.json and each bomb";
}

TEST_F(SequenceFolderTest, NamesBadCameras) {
  WriteCamera("fx", 0);
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("camera.fx = 0, must be"));
  WriteCamera("fx", nullptr);
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("fx = null, must be a number"));
  WriteCamera("depth_scale", -1);
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("camera.depth_scale = -1"));
  for (const double scale : {0.0, 1e-300, 1e300}) {
    WriteCamera("depth_scale", scale);
    ExpectViolation("camera.json", StatusCode::kInvalidArgument,
                    AllOf(HasSubstr("camera.depth_scale = "), HasSubstr("must be 0.001 to 1e+09")));
  }
  Put(Path("camera.json"), R"({"width":8,"height":6,"fx":7,"fy":7,"cx":3,"cy":2,"depth_scale":NaN})");
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("at or after field \"depth_scale\""));
  Put(Path("camera.json"), R"({"width":8,"height":6,"fx":7,"fy":7,"cx":3,"cy":2,"depth_scale":1e999})");
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("number too large"));
  WriteCamera("depth_camera", {{"width", 1}});
  ExpectViolation("camera.json", StatusCode::kInvalidArgument, HasSubstr("depth_camera"));
}

TEST_F(SequenceFolderTest, NamesTimeGoingBack) {
  Put(Path("depth.txt"), "0.02 depth/000000.png\n0.01 depth/000001.png\n");
  ExpectViolation("depth.txt", StatusCode::kInvalidArgument,
                  HasSubstr("depth/000001.png has time stamp 0.010000000 s"));
}

// Three problems of one file are one violation that tells them all.
TEST_F(SequenceFolderTest, GathersTheProblemsOfAFile) {
  Put(Path("depth.txt"), "0.02 depth/000000.png\n0.01 depth/000001.png\nsoon depth/000002.png\n0.03\n");
  ExpectViolation(
      "depth.txt", StatusCode::kInvalidArgument,
      AllOf(HasSubstr("line 3: 'soon'"), HasSubstr("line 4"), HasSubstr("depth/000001.png has time stamp")));
}

// A clock is chosen later, and brings them together.
TEST_F(SequenceFolderTest, WarnsOfClocksThatDoNotMeet) {
  Put(Path("depth.txt"), "100.0 depth/000000.png\n100.1 depth/000001.png\n");
  const auto check = CheckSequenceFolder(dir());
  ASSERT_THAT(check, IsOk());
  EXPECT_TRUE(check->ok());
  EXPECT_THAT(check->warnings,
              ElementsAre(AllOf(HasSubstr("do not overlap in time"), HasSubstr("--clock=100000.000"))));
  EXPECT_THAT(SequenceFolder::Open(dir()), IsOk());
}

// The same stamps in milliseconds, in one list and in both.
TEST_F(SequenceFolderTest, ReadsStampsInOtherUnits) {
  const std::string colour_ms = "0 rgb/000000.png\n10 rgb/000001.png\n20 rgb/000002.png\n30 rgb/000003.png\n";
  const std::string depth_ms = "0 depth/000000.png\n25.5 depth/000001.png\n";
  Put(Path("depth.txt"), depth_ms);
  const auto one = SequenceFolder::Open(dir());
  ASSERT_THAT(one, IsOk());
  EXPECT_EQ((*one)->sequence().depth[1].time_ns, 25500000);
  EXPECT_EQ((*one)->sequence().color[1].time_ns, 10000000);
  EXPECT_THAT((*one)->Warnings(1), ElementsAre(AllOf(HasSubstr("depth.txt"), HasSubstr("milliseconds"))));
  Put(Path("rgb.txt"), colour_ms);
  const auto both = SequenceFolder::Open(dir());
  ASSERT_THAT(both, IsOk());
  EXPECT_EQ((*both)->sequence().color[3].time_ns, 30000000);
  EXPECT_THAT((*both)->Warnings(2),
              ElementsAre(AllOf(HasSubstr("rgb.txt"), HasSubstr("a frame every 10 ms")), HasSubstr("depth.txt")));
  EXPECT_EQ(CheckSequenceFolder(dir())->warnings, (*both)->Warnings(1));
  // Said, it is believed, and no warning is due.
  Put(Path("rgb.txt"), "# unit: ms\n" + colour_ms);
  Put(Path("depth.txt"), "# unit: ms\n" + depth_ms);
  EXPECT_THAT((*SequenceFolder::Open(dir()))->Warnings(1), IsEmpty());
}

// 12 of the 48 pixels of one depth frame of two.
TEST_F(SequenceFolderTest, TakesTheLargestCodeForUnknown) {
  Image<uint16_t> units = QuantiseDepth(SomeDepth(1), kDepthScale);
  for (int x = 0; x < 6; ++x) units(x, 0) = units(x, 5) = 65535;
  ASSERT_THAT(WritePng16(Path("depth/000001.png"), units), IsOk());
  const auto folder = SequenceFolder::Open(dir());
  ASSERT_THAT(folder, IsOk());
  EXPECT_EQ((*(*folder)->Depth(1))(2, 0), 0.0F);
  EXPECT_GT((*(*folder)->Depth(1))(7, 0), 1.0F);
  const auto said = ElementsAre(AllOf(HasSubstr("12 %"), HasSubstr("2 depth frames"), HasSubstr("65535")));
  EXPECT_THAT((*folder)->Warnings(1), said);
  const auto check = CheckSequenceFolder(dir());
  ASSERT_THAT(check, IsOk());
  EXPECT_TRUE(check->ok());
  EXPECT_THAT(check->warnings, said);
  EXPECT_NEAR(check->median_depth_m, 1.07, 0.02);
}

TEST_F(SequenceFolderTest, WarnsOfAnOddCamera) {
  WriteCamera("cx", 45.5);
  WriteCamera("distortion", nlohmann::json::array({0.1, 0.2}));
  EXPECT_THAT((*SequenceFolder::Open(dir()))->Warnings(1), ElementsAre(HasSubstr("\"distortion\"")));
  WriteCamera("cx", 45.5);
  EXPECT_THAT(CheckSequenceFolder(dir())->warnings, ElementsAre(HasSubstr("cx = 45.5")));
}

TEST_F(SequenceFolderTest, NamesDepthOfOtherFormats) {
  Put(Path("depth/000000.png"), std::string("II*\0\x08\0\0\0", 8));
  ExpectViolation("depth/000000.png", StatusCode::kInvalidArgument,
                  AllOf(HasSubstr("is a TIFF image"), HasSubstr("16-bit grey PNG")), /*found_by_open=*/false);
}

TEST_F(SequenceFolderTest, SaysWhatElseIsThere) {
  for (const char* name : {"rgb.txt", "depth.txt"}) std::filesystem::remove(Path(name));
  EXPECT_THAT(SequenceFolder::Open(dir()),
              HasStatus(StatusCode::kNotFound,
                        AllOf(HasSubstr("rgb.txt: missing"), HasSubstr("rgb/ with 4 images and depth/ with 2"),
                              HasSubstr("depth.txt: missing"))));
}

TEST_F(SequenceFolderTest, RefusesToLeaveTheFolder) {
  const std::string good = Get(Path("rgb.txt"));
  Put(temp_ / "secret.png", *EncodePngRgb8(Image<Rgb8>(8, 6)));
  for (const std::string name : {"../secret.png", "rgb/../../secret.png", "/etc/passwd"}) {
    Put(Path("rgb.txt"), good);
    Append("rgb.txt", "0.5 " + name);
    ExpectViolation("rgb.txt", StatusCode::kInvalidArgument, AllOf(HasSubstr("line 6"), HasSubstr(name)));
  }
  Put(Path("rgb.txt"), good);
  Append("rgb.txt", "0.5 rgb/link.png");
  std::filesystem::create_symlink(temp_ / "secret.png", Path("rgb/link.png"));
  ExpectViolation("rgb/link.png", StatusCode::kInvalidArgument, HasSubstr("symbolic link that leaves"));
  // Inside the folder a link is as good as a file.
  std::filesystem::remove(Path("rgb/link.png"));
  std::filesystem::create_symlink(Path("rgb/000000.png"), Path("rgb/link.png"));
  EXPECT_THAT(SequenceFolder::Open(dir()), IsOk());
}

TEST_F(SequenceFolderTest, NamesFilesListedTwice) {
  Append("rgb.txt", "0.5 rgb/000000.png");
  ExpectViolation("rgb.txt", StatusCode::kInvalidArgument, HasSubstr("rgb/000000.png is listed on line 2 already"));
}

TEST_F(SequenceFolderTest, NamesEveryFileAtFault) {
  WriteCamera("fx", "wide");
  Append("rgb.txt", "soon rgb/000004.png");
  std::filesystem::remove(Path("rgb/000002.png"));
  Put(Path("depth/000000.png"), "");
  const auto check = CheckSequenceFolder(dir());
  ASSERT_THAT(check, IsOk());
  std::vector<std::string> files;
  for (const FileViolation& violation : check->violations) files.push_back(violation.file);
  EXPECT_THAT(files, ElementsAre("camera.json", "rgb.txt", "rgb/000002.png", "depth/000000.png"));
  EXPECT_THAT(ReadSequenceHeader(dir()),
              HasStatus(StatusCode::kInvalidArgument, AllOf(HasSubstr("camera.json: "), HasSubstr("rgb.txt: line 6"),
                                                            HasSubstr("rgb/000002.png: "))));
}

// Five thousand units a metre read as one: the clip would lie kilometres away.
TEST_F(SequenceFolderTest, WarnsOfImplausibleDepthScale) {
  WriteCamera("depth_scale", 1);
  const auto check = CheckSequenceFolder(dir());
  ASSERT_THAT(check, IsOk());
  EXPECT_TRUE(check->ok());
  ASSERT_EQ(check->warnings.size(), 1U);
  EXPECT_THAT(check->warnings[0], AllOf(HasSubstr("depth_scale = 1 is implausible"),
                                        HasSubstr("1000 (median 5.4 m), 4000 (median 1.35 m)")));
}

TEST_F(SequenceFolderTest, TruthIsFoundByTheColorsStem) {
  EXPECT_EQ(GroundTruthDepthPath(dir(), "000000"), std::nullopt);
  auto writer = SequenceWriter::Create(temp_ / "rendered", SmallCamera(), kDepthScale,
                                       {.color_format = SequenceWriter::ColorFormat::kJpeg});
  ASSERT_THAT(writer, IsOk());
  EXPECT_THAT(writer->AddTruth(SomeDepth(0)), HasStatus(StatusCode::kFailedPrecondition, HasSubstr("no colour frame")));
  ASSERT_THAT(writer->AddColor(0, Image<Rgb8>(8, 6)), IsOk());
  ASSERT_THAT(writer->AddTruth(SomeDepth(7)), IsOk());
  EXPECT_EQ(writer->sequence().color[0].path, "rgb/000000.jpg");
  const auto path = GroundTruthDepthPath(temp_ / "rendered", "000000");
  ASSERT_TRUE(path.has_value());
  EXPECT_TRUE(SamePixels(DequantiseDepth(*ReadPng16(*path), kDepthScale), SomeDepth(7)));
}

TEST_F(SequenceFolderTest, WriterRefusesWhatIsNoSequence) {
  EXPECT_THAT(SequenceWriter::Create(dir(), SmallCamera(), kDepthScale),
              HasStatus(StatusCode::kAlreadyExists, HasSubstr("rgb.txt")));
  EXPECT_THAT(SequenceWriter::Create(temp_ / "new", Camera(), kDepthScale),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("camera.width")));
  EXPECT_THAT(SequenceWriter::Create(temp_ / "new", SmallCamera(), 0),
              HasStatus(StatusCode::kInvalidArgument, HasSubstr("depth_scale")));
  auto writer = SequenceWriter::Create(temp_ / "new", SmallCamera(), kDepthScale);
  ASSERT_THAT(writer, IsOk());
  EXPECT_THAT(writer->AddDepth(0, Image<float>(6, 8)), HasStatus(StatusCode::kInvalidArgument, HasSubstr("6 x 8")));
  EXPECT_THAT(writer->Finish(), HasStatus(StatusCode::kInvalidArgument, HasSubstr("rgb.txt lists no frames")));
  EXPECT_FALSE(FileExists(temp_ / "new/rgb.txt"));
}

// Real recordings, where they are at hand: asynchronous stamps and distortion must come through.
TEST(SequenceFolderOnData, ReadsRecordings) {
  const char* variable = std::getenv("DEPTHTWEEN_DATA");
  const std::string data = variable != nullptr ? variable : "../shared/data";
  const std::string rotation = data + "/real/rotation";
  if (!std::filesystem::exists(rotation)) GTEST_SKIP() << "no recordings at " << data;
  const auto folder = SequenceFolder::Open(rotation);
  ASSERT_THAT(folder, IsOk());
  EXPECT_EQ((*folder)->sequence().color[0].time_ns, 1305031232193716000);
  EXPECT_TRUE((*folder)->sequence().camera.HasDistortion());
  EXPECT_THAT((*folder)->Color(0), IsOk());
  EXPECT_THAT((*folder)->Depth(0), IsOk());
}

}  // namespace
}  // namespace depthtween
