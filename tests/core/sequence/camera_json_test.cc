// Cameras in JSON: what is written must be read, and the field that was spoilt must be named.
#include "core/sequence/camera_json.h"

#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using absl::StatusCode;
using testing::AllOf;
using testing::HasSubstr;

constexpr char kGood[] = R"({"width": 640, "height": 480.0, "fx": 517.3, "fy": 516.5, "cx": 318.6, "cy": 255.3,
  "k1": 0.2624, "k2": -0.9531, "p1": -0.0054, "p2": 0.0026, "k3": 1.1633, "depth_scale": 5000, "comment": "TUM fr1"})";

// The file above with one value replaced.
std::string With(const std::string& from, const std::string& to) {
  std::string text = kGood;
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos);
  return text.replace(at, from.size(), to);
}

TEST(CameraJson, ReadsEveryField) {
  const auto file = ParseCameraJson(kGood);
  ASSERT_THAT(file, IsOk());
  EXPECT_EQ(file->camera.width, 640);
  EXPECT_EQ(file->camera.height, 480);
  EXPECT_EQ(file->camera.fx, 517.3);
  EXPECT_EQ(file->camera.cy, 255.3);
  EXPECT_EQ(file->camera.k2, -0.9531);
  EXPECT_EQ(file->camera.p2, 0.0026);
  EXPECT_EQ(file->camera.k3, 1.1633);
  EXPECT_EQ(file->depth_scale, 5000);
  EXPECT_THAT(file->camera.Validate(), IsOk());
}

// Doubles are printed so that they read back to the last bit.
TEST(CameraJson, RoundTripsToTheLastBit) {
  Camera camera = SmallCamera();
  camera.fx = 607.178466796875 / 3;
  const auto plain = ParseCameraJson(FormatCameraJson(camera, 1000.0 / 3));
  ASSERT_THAT(plain, IsOk());
  EXPECT_EQ(plain->camera.fx, camera.fx);
  EXPECT_EQ(plain->depth_scale, 1000.0 / 3);
  EXPECT_FALSE(CameraToJson(camera, 1000).contains("k1"));
  camera.p1 = 0.1 / 3;
  EXPECT_EQ(ParseCameraJson(FormatCameraJson(camera, 1000))->camera.p1, camera.p1);
}

TEST(CameraJson, NamesTheFieldAtFault) {
  const auto refused = [](const std::string& text, const auto& message) {
    EXPECT_THAT(ParseCameraJson(text), HasStatus(StatusCode::kInvalidArgument, message)) << text;
  };
  refused(With("\"fx\": 517.3,", ""), HasSubstr("field fx is missing"));
  refused(With("\"depth_scale\": 5000,", ""), HasSubstr("field depth_scale is missing"));
  refused(With("517.3", "\"517.3\""), HasSubstr("fx = \"517.3\", must be a number"));
  refused(With("517.3", "null"), HasSubstr("fx = null"));
  refused(With("0.2624", "[1]"), HasSubstr("k1 = [1]"));
  refused(With("640", "640.5"), HasSubstr("width = 640.5, must be a whole number"));
  refused(With("640", "1e300"), HasSubstr("width"));
  // What Python's json module writes for these; not JSON.
  refused(With("516.5", "NaN"), AllOf(HasSubstr("\"fy\""), HasSubstr("NaN"), HasSubstr("line 1")));
  refused(With("-0.9531", "Infinity"), AllOf(HasSubstr("\"k2\""), HasSubstr("line 2")));
  refused(With("5000", "1e999"), AllOf(HasSubstr("too large"), HasSubstr("depth_scale")));
  refused("", HasSubstr("not JSON"));
  refused("[1, 2]", HasSubstr("must be a JSON object"));
  refused(std::string(100000, '['), HasSubstr("not JSON"));
  refused("{\"\xff\": 1}", HasSubstr("not JSON"));
}

// What has no effect is named, lest anybody believe that it has.
TEST(CameraJson, NamesFieldsThatItIgnores) {
  EXPECT_THAT(ParseCameraJson(kGood)->warnings, testing::ElementsAre(HasSubstr("ignored: \"comment\"")));
  EXPECT_THAT(ParseCameraJson(FormatCameraJson(SmallCamera(), 1000))->warnings, testing::IsEmpty());
  for (const char* name : {"distortion", "dist_coeffs", "D", "k4"}) {
    const auto file = ParseCameraJson(With("comment", name));
    ASSERT_THAT(file, IsOk());
    EXPECT_THAT(file->warnings, testing::ElementsAre(AllOf(HasSubstr(std::string("\"") + name + "\""),
                                                           HasSubstr("k1, k2, p1, p2, k3"))));
  }
  std::string many = "{";
  for (int i = 0; i < 20; ++i) many += "\"field" + std::to_string(i) + "\": 0, ";
  many += std::string(kGood).substr(1);
  EXPECT_THAT(ParseCameraJson(many)->warnings, testing::ElementsAre(HasSubstr("and 13 more")));
}

TEST(CameraJson, SkipsAByteOrderMark) {
  const auto file = ParseCameraJson(std::string("\xEF\xBB\xBF") + kGood);
  ASSERT_THAT(file, IsOk());
  EXPECT_EQ(file->camera.fx, 517.3);
  EXPECT_THAT(ParseCameraJson("\xFF\xFE{"), HasStatus(StatusCode::kInvalidArgument, HasSubstr("UTF-16")));
}

TEST(CameraJson, RefusesDepthCamera) {
  EXPECT_THAT(
      ParseCameraJson(With("\"comment\": \"TUM fr1\"", "\"depth_camera\": {\"width\": 1}")),
      HasStatus(StatusCode::kInvalidArgument, AllOf(HasSubstr("depth_camera"), HasSubstr("register the depth"))));
}

}  // namespace
}  // namespace depthtween
