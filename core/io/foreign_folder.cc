#include "core/io/foreign_folder.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <map>
#include <string_view>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxNames = 5000;  // of one folder; more are not counted

// The names in a folder, sorted; none when it cannot be read.
std::vector<std::string> NamesIn(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end && names.size() < kMaxNames;
       it.increment(error))
    names.push_back(it->path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::string Lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// Of these extensions, case aside.
int CountEnding(const std::vector<std::string>& names, const std::vector<std::string_view>& endings) {
  return static_cast<int>(std::count_if(names.begin(), names.end(), [&](const std::string& name) {
    return std::any_of(endings.begin(), endings.end(),
                       [lower = Lower(name)](std::string_view ending) { return lower.ends_with(ending); });
  }));
}

int CountImages(const fs::path& folder) {
  return CountEnding(NamesIn(folder), {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".pgm", ".npy"});
}

constexpr char kCameraAdvice[] =
    "camera.json: `{\"width\": W, \"height\": H, \"fx\": FX, \"fy\": FY, \"cx\": CX, \"cy\": CY, \"depth_scale\": "
    "1000}`, "
    "intrinsics of the colour camera in pixels and the stored units per metre; depth must be registered to colour";

// Names that tell the frame's number, at 30 frames a second.
std::optional<std::string> SevenScenes(const std::vector<std::string>& names) {
  const auto begins = [](const std::string& name) { return name.starts_with("frame-"); };
  const auto count = [&](const std::vector<std::string_view>& endings) {
    std::vector<std::string> frames;
    std::copy_if(names.begin(), names.end(), std::back_inserter(frames), begins);
    return CountEnding(frames, endings);
  };
  const int color = count({".color.png", ".color.jpg"}), depth = count({".depth.png"});
  if (color == 0 || depth == 0) return std::nullopt;
  return absl::StrFormat(
      "this is the layout of 7-Scenes (%d frame-*.color.*, %d frame-*.depth.png). In the folder, for 30 frames per "
      "second: `for k in color depth; do ls frame-*.$k.* | awk -F'[-.]' '{printf \"%%.6f %%s\\n\", $2/30, $0}' > "
      "$k.txt; "
      "done; mv color.txt rgb.txt`. And %s",
      color, depth, kCameraAdvice);
}

// A folder of colour images beside one of depth images.
std::optional<std::string> TwoFolders(const fs::path& dir, const std::vector<std::string>& names) {
  const auto find = [&](const std::vector<std::string_view>& wanted) -> std::string {
    for (const std::string_view want : wanted)
      for (const std::string& name : names)
        if (Lower(name) == want && CountImages(dir / name) > 0) return name;
    return {};
  };
  const std::string color = find({"rgb", "color", "colour", "image", "images", "rgb_images", "color_images"});
  const std::string depth = find({"depth", "depths", "depth_images", "depth_image"});
  if (color.empty() || depth.empty()) return std::nullopt;
  const bool open3d = std::any_of(names.begin(), names.end(), [](const std::string& name) {
    return name == "intrinsic.json" || name == "camera_intrinsic.json";
  });
  std::string text = absl::StrFormat(
      "%s/ with %d images and %s/ with %d%s. Lists have a line `SECONDS FILE` per frame; in the folder, for 30 frames "
      "per second of each: `ls %s/* | awk '{printf \"%%.6f %%s\\n\", (NR-1)/30, $0}' > rgb.txt; ls %s/* | awk "
      "'{printf \"%%.6f %%s\\n\", (NR-1)/30, $0}' > depth.txt`, with the true rates or the recorded stamps instead. "
      "And %s",
      color, CountImages(dir / color), depth, CountImages(dir / depth),
      open3d ? ", as Open3D writes them (intrinsic.json has fx, fy, cx, cy in intrinsic_matrix, column by column)" : "",
      color, depth, kCameraAdvice);
  return text;
}

// A recording in one file: what opens it.
std::optional<std::string> OneFile(const std::vector<std::string>& names) {
  constexpr char kVideo[] =
      "frames must be images: `ffmpeg -i FILE -vsync passthrough -frame_pts 1 rgb/%06d.png` for colour; depth in lossy "
      "video is lost";
  const std::map<std::string, std::string_view> advice_of = {
      {".bag", "export it as images with their stamps: `rs-convert -i FILE -p OUT/` for RealSense, rosbag for ROS 1"},
      {".mcap", "export its image topics as PNG files with their stamps"},
      {".db3", "export its image topics as PNG files with their stamps"},
      {".mkv",
       "an Azure Kinect recording is exported by Open3D's `azure_kinect_mkv_reader.py`, or its tracks by ffmpeg"},
      {".oni", "export it as images with their stamps"},
      {".klg", "export it as images with their stamps"},
      {".sens", "export it by ScanNet's SensReader"},
      {".r3d", "export it in the Record3D app as RGBD images"},
      {".svo", "export it by the ZED SDK's SVO export"},
      {".mp4", kVideo},
      {".mov", kVideo},
      {".avi", kVideo},
      {".webm", kVideo}};
  for (const std::string& name : names) {
    const auto advice = advice_of.find(Lower(fs::path(name).extension().string()));
    if (advice == advice_of.end()) continue;
    return absl::StrFormat(
        "%s is a recording in one file: %s. Then rgb.txt and depth.txt with a line `SECONDS FILE` per "
        "frame. And %s",
        name, std::string(advice->second), kCameraAdvice);
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> DescribeForeignFolder(const std::string& dir) {
  const std::vector<std::string> names = NamesIn(dir);
  std::optional<std::string> found = SevenScenes(names);
  if (!found) found = TwoFolders(dir, names);
  if (!found) found = OneFile(names);
  if (!found) return std::nullopt;
  return absl::StrCat("Found instead: ", *found);
}

}  // namespace depthtween
