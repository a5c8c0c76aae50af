// Folders as other programs leave them, made here by names alone; the commands that are advised are tried.
#include "core/io/foreign_folder.h"

#include <cstdlib>

#include "core/io/frame_list.h"
#include "tests/core/io/io_fixtures.h"

namespace depthtween {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// What stands between the `nth` pair of backticks.
std::string Command(const std::string& text, int nth = 0) {
  size_t begin = text.find('`');
  for (int i = 0; i < nth; ++i) begin = text.find('`', text.find('`', begin + 1) + 1);
  return text.substr(begin + 1, text.find('`', begin + 1) - begin - 1);
}

std::vector<std::string> Listed(const std::string& path) {
  const FrameList list = ParseFrameList(Get(path));
  EXPECT_THAT(list.problems, IsEmpty());
  std::vector<std::string> lines;
  for (const FrameRef& frame : list.frames) lines.push_back(FormatSeconds(frame.time_ns) + " " + frame.path);
  return lines;
}

TEST(ForeignFolder, SevenScenesIsToldAndItsCommandMakesTheLists) {
  const TemporaryFolder dir;
  for (int i = 0; i < 3; ++i) Put(dir / ("frame-00000" + std::to_string(i) + ".color.png"), "");
  for (const int i : {0, 2}) Put(dir / ("frame-00000" + std::to_string(i) + ".depth.png"), "");
  const auto found = DescribeForeignFolder(dir.path());
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, AllOf(HasSubstr("7-Scenes"), HasSubstr("3 frame-*.color"), HasSubstr("2 frame-*.depth"),
                            HasSubstr("camera.json")));
  ASSERT_EQ(std::system(("cd '" + dir.path() + "' && " + Command(*found)).c_str()), 0);
  EXPECT_THAT(Listed(dir / "rgb.txt"),
              ElementsAre("0.000000000 frame-000000.color.png", "0.033333000 frame-000001.color.png",
                          "0.066667000 frame-000002.color.png"));
  EXPECT_THAT(Listed(dir / "depth.txt"),
              ElementsAre("0.000000000 frame-000000.depth.png", "0.066667000 frame-000002.depth.png"));
}

TEST(ForeignFolder, TwoFoldersOfImages) {
  const TemporaryFolder dir;
  for (const char* name : {"color/00.jpg", "color/01.jpg", "depth/00.png"}) Put(dir / name, "");
  const auto found = DescribeForeignFolder(dir.path());
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found, AllOf(HasSubstr("color/ with 2 images"), HasSubstr("depth/ with 1")));
  EXPECT_THAT(*found, testing::Not(HasSubstr("Open3D")));
  ASSERT_EQ(std::system(("cd '" + dir.path() + "' && " + Command(*found, 1)).c_str()), 0);
  EXPECT_THAT(Listed(dir / "rgb.txt"), ElementsAre("0.000000000 color/00.jpg", "0.033333000 color/01.jpg"));
  EXPECT_THAT(Listed(dir / "depth.txt"), ElementsAre("0.000000000 depth/00.png"));
  Put(dir / "intrinsic.json", "{}");
  EXPECT_THAT(*DescribeForeignFolder(dir.path()), HasSubstr("Open3D"));
}

TEST(ForeignFolder, RecordingsInOneFile) {
  for (const char* name : {"take.bag", "take.MKV", "take.mp4"}) {
    const TemporaryFolder dir;
    Put(dir / name, "");
    const auto found = DescribeForeignFolder(dir.path());
    ASSERT_TRUE(found.has_value()) << name;
    EXPECT_THAT(*found, AllOf(HasSubstr(name), HasSubstr("recording in one file"))) << name;
  }
}

TEST(ForeignFolder, NothingKnown) {
  const TemporaryFolder dir;
  EXPECT_EQ(DescribeForeignFolder(dir.path()), std::nullopt);
  Put(dir / "notes.md", "");
  Put(dir / "frame-000000.color.png", "");
  EXPECT_EQ(DescribeForeignFolder(dir.path()), std::nullopt);
  EXPECT_EQ(DescribeForeignFolder(dir / "none"), std::nullopt);
}

}  // namespace
}  // namespace depthtween
