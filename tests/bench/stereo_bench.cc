// What a made eye is worth, beside what practitioners do, and what it costs.
//
//   stereo_bench views DATA [IMAGES]   Middlebury pairs: a view made from another one and its disparity, against the
//                                      photograph; writes the pictures to the folder IMAGES.
//   stereo_bench temporal [IMAGES]     A scene of the library whose second view is rendered too: hidden background from
//                                      other frames against inferred background.
//   stereo_bench speed [ROUNDS]        848 x 480, 2 threads: one stereo frame beside cv::remap and cv::inpaint.
//
// Pixels of a made view, defined by the source's disparity alone (unknown disparity takes the farther neighbour of its
// row): each row is carried over, nearest surface first, a surface being neighbours that differ by at most 1 px. What
// nothing reaches is a hole; holes that touch the image's border lie outside the source's view and are left out of
// every number. "All" is the rest; "holes" are its holes; the "edge band" lies within 4 px of a hole or of a jump of
// more than 1 px in the carried disparity.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/flow/dense_flow.h"
#include "core/io/color.h"
#include "core/io/file.h"
#include "core/io/png.h"
#include "core/metrics/color_errors.h"
#include "core/render/hidden_background.h"
#include "core/render/stereo.h"
#include "core/synthetic/render.h"
#include "core/synthetic/scene.h"
#include "opencv2/core.hpp"
#include "opencv2/imgproc.hpp"
#include "opencv2/photo.hpp"
#include "tests/bench/timing.h"

namespace depthtween {
namespace {

constexpr float kJumpPx = 1.0F;
constexpr int kBandPx = 4;

// A source view, how far each of its pixels moves to the left in the view to be made, and that view's photograph.
struct Pair {
  std::string name;
  Image<Rgb8> source, truth;
  Image<float> disparity_px;  // > 0, complete
  StereoGeometry geometry;    // with which one baseline to the right gives that disparity
  Image<float> depth_m;
};

// Unknown (0) disparity takes the farther known neighbour of its row, in a row without any the farthest of the image.
void CompleteRows(Image<float>& disparity) {
  float farthest = std::numeric_limits<float>::max();
  for (size_t i = 0; i < disparity.pixel_count(); ++i)
    if (disparity.data()[i] > 0) farthest = std::min(farthest, disparity.data()[i]);
  for (int y = 0; y < disparity.height(); ++y)
    for (int x = 0; x < disparity.width(); ++x) {
      if (disparity(x, y) > 0) continue;
      int end = x;
      while (end < disparity.width() && disparity(end, y) <= 0) ++end;
      const float left = x > 0 ? disparity(x - 1, y) : 0, right = end < disparity.width() ? disparity(end, y) : 0;
      const float known = left > 0 && right > 0 ? std::min(left, right) : std::max(left, right);
      for (; x < end; ++x) disparity(x, y) = known > 0 ? known : farthest;
    }
}

// ---- Which pixels count

struct Masks {
  Image<uint8_t> all, holes, band;
};

// The disparity of each target pixel, 0 where no surface arrives.
Image<float> CarryOver(const Image<float>& disparity) {
  const int width = disparity.width();
  Image<float> carried(width, disparity.height());
  for (int y = 0; y < disparity.height(); ++y)
    for (int x = 0; x < width; ++x) {
      const float d = disparity(x, y);
      const float next = x + 1 < width && std::abs(disparity(x + 1, y) - d) <= kJumpPx ? disparity(x + 1, y) : d - 0.5F;
      const int first = static_cast<int>(std::lround(static_cast<float>(x) - d));
      const int last = std::max(first, static_cast<int>(std::ceil(static_cast<float>(x + 1) - next)) - 1);
      for (int t = std::max(0, first); t <= std::min(width - 1, last); ++t) carried(t, y) = std::max(carried(t, y), d);
    }
  return carried;
}

Masks MakeMasks(const Image<float>& disparity) {
  const int width = disparity.width(), height = disparity.height();
  const Image<float> carried = CarryOver(disparity);
  Masks masks{Image<uint8_t>(width, height, 1), Image<uint8_t>(width, height), Image<uint8_t>(width, height)};
  for (int y = 0; y < height; ++y) {
    for (int t = 0; t < width && carried(t, y) == 0; ++t) masks.all(t, y) = 0;
    for (int t = width - 1; t >= 0 && carried(t, y) == 0; --t) masks.all(t, y) = 0;
  }
  for (int y = 0; y < height; ++y)
    for (int t = 0; t < width; ++t) {
      if (masks.all(t, y) == 0) continue;
      masks.holes(t, y) = carried(t, y) == 0;
      bool jump = masks.holes(t, y) != 0;
      for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{0, 1}})
        if (carried.Contains(t + dx, y + dy) && carried(t + dx, y + dy) > 0)
          jump |= std::abs(carried(t + dx, y + dy) - carried(t, y)) > kJumpPx;
      if (!jump) continue;
      for (int ny = std::max(0, y - kBandPx); ny <= std::min(height - 1, y + kBandPx); ++ny)
        for (int nx = std::max(0, t - kBandPx); nx <= std::min(width - 1, t + kBandPx); ++nx)
          masks.band(nx, ny) = masks.all(nx, ny);
    }
  return masks;
}

// ---- The baselines

cv::Mat AsMat(const Image<Rgb8>& image) {
  return {image.height(), image.width(), CV_8UC3, const_cast<Rgb8*>(image.data())};
}
Image<Rgb8> FromMat(const cv::Mat& mat) {
  Image<Rgb8> image(mat.cols, mat.rows);
  mat.copyTo(AsMat(image));
  return image;
}

// Pixels rounded to their new places, the nearest wins.
struct Splat {
  Image<Rgb8> color;
  Image<float> disparity_px;  // 0 = hole
};
Splat ForwardWarp(const Pair& pair) {
  const int width = pair.source.width(), height = pair.source.height();
  Splat splat{Image<Rgb8>(width, height), Image<float>(width, height)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float d = pair.disparity_px(x, y);
      const int t = static_cast<int>(std::lround(static_cast<float>(x) - d));
      if (t < 0 || t >= width || d <= splat.disparity_px(t, y)) continue;
      splat.disparity_px(t, y) = d;
      splat.color(t, y) = pair.source(x, y);
    }
  return splat;
}

Image<Rgb8> ForwardWarpRowFill(const Pair& pair) {
  Splat splat = ForwardWarp(pair);
  const int width = pair.source.width();
  for (int y = 0; y < pair.source.height(); ++y)
    for (int t = 0; t < width; ++t) {
      if (splat.disparity_px(t, y) > 0) continue;
      int end = t;
      while (end < width && splat.disparity_px(end, y) == 0) ++end;
      const bool from_left = t > 0 && (end == width || splat.disparity_px(t - 1, y) <= splat.disparity_px(end, y));
      const Rgb8 fill = from_left ? splat.color(t - 1, y) : splat.color(std::min(end, width - 1), y);
      for (; t < end; ++t) splat.color(t, y) = fill;
    }
  return std::move(splat.color);
}

Image<Rgb8> BackwardWarp(const Pair& pair) {
  const int width = pair.source.width(), height = pair.source.height();
  cv::Mat map_x(height, width, CV_32F), map_y(height, width, CV_32F), out;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      map_x.at<float>(y, x) = static_cast<float>(x) + pair.disparity_px(x, y);
      map_y.at<float>(y, x) = static_cast<float>(y);
    }
  cv::remap(AsMat(pair.source), out, map_x, map_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return FromMat(out);
}

Image<Rgb8> ForwardWarpInpaint(const Pair& pair, int method) {
  const Splat splat = ForwardWarp(pair);
  cv::Mat holes(splat.color.height(), splat.color.width(), CV_8U), out;
  for (int y = 0; y < holes.rows; ++y)
    for (int x = 0; x < holes.cols; ++x) holes.at<uint8_t>(y, x) = splat.disparity_px(x, y) == 0;
  cv::inpaint(AsMat(splat.color), holes, out, 3.0, method);
  return FromMat(out);
}

Image<Rgb8> Ours(const Pair& pair) {
  const RenderView view{pair.source, pair.depth_m};
  const HiddenBackground hidden = FindHiddenBackground(view, {}, pair.geometry.background, 2);
  return RenderEye(view, hidden, pair.geometry, 1.0, 2);
}

const std::vector<std::pair<std::string, std::function<Image<Rgb8>(const Pair&)>>> kMethods = {
    {"ours", Ours},
    {"forward warp, row fill", ForwardWarpRowFill},
    {"backward warp", BackwardWarp},
    {"inpaint Telea", [](const Pair& pair) { return ForwardWarpInpaint(pair, cv::INPAINT_TELEA); }},
    {"inpaint Navier-Stokes", [](const Pair& pair) { return ForwardWarpInpaint(pair, cv::INPAINT_NS); }},
};

// ---- The pairs

// `to_px` turns stored values into pixels of movement; f_px, baseline and the disparity of the convergence plane (all
// zero for sets without them) give the depth.
absl::StatusOr<Pair> MakePair(std::string name, const std::string& source, const std::string& truth,
                              Image<float> disparity, double focal_px, double baseline_m, double convergence_px) {
  Pair pair;
  pair.name = std::move(name);
  ASSIGN_OR_RETURN(pair.source, ReadColor(source));
  ASSIGN_OR_RETURN(pair.truth, ReadColor(truth));
  CompleteRows(disparity);
  const int width = disparity.width(), height = disparity.height();
  pair.depth_m = Image<float>(width, height);
  std::vector<double> depths;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const double z = focal_px * baseline_m / (disparity(x, y) + convergence_px);
      pair.depth_m(x, y) = static_cast<float>(z);
      depths.push_back(z);
    }
  pair.disparity_px = std::move(disparity);
  std::sort(depths.begin(), depths.end());
  Camera camera;
  camera.width = width, camera.height = height, camera.fx = camera.fy = focal_px;
  StereoOptions options;
  options.made = MadeEye::kRight;
  options.baseline_m = baseline_m;
  options.convergence_m =
      convergence_px > 0 ? focal_px * baseline_m / convergence_px : std::numeric_limits<double>::infinity();
  ASSIGN_OR_RETURN(pair.geometry, ResolveStereo(camera, options,
                                                {.near_m = depths[depths.size() / 100],
                                                 .far_m = depths[depths.size() * 99 / 100],
                                                 .median_m = depths[depths.size() / 2]}));
  return pair;
}

absl::StatusOr<Image<float>> ReadDisparity(const std::string& path, double to_px) {
  ASSIGN_OR_RETURN(const Image<Rgb8> stored, ReadColor(path));
  Image<float> disparity(stored.width(), stored.height());
  for (int y = 0; y < stored.height(); ++y)
    for (int x = 0; x < stored.width(); ++x) disparity(x, y) = static_cast<float>(stored(x, y).r * to_px);
  return disparity;
}

// Geometry as EVALUATION.md states it: third size, f = 3740 / 3 px, 160 mm from view 1 to view 5, stored disparity in
// full-size pixels less dmin; the crop makes the movement stored / 3.
absl::StatusOr<Pair> Middlebury2005(const std::string& data, const std::string& name) {
  const std::string dir = JoinPath(JoinPath(data, "multiview"), name);
  ASSIGN_OR_RETURN(const std::string dmin, ReadFile(JoinPath(dir, "dmin.txt")));
  ASSIGN_OR_RETURN(Image<float> disparity, ReadDisparity(JoinPath(dir, "disp1.png"), 1.0 / 3));
  return MakePair(absl::StrCat(name, ": 5 from 1"), JoinPath(dir, "view1.png"), JoinPath(dir, "view5.png"),
                  std::move(disparity), 3740.0 / 3, 0.16, std::atof(dmin.c_str()) / 3);
}

// Views 2, 4, 6 in line; stored disparity is four times that from 2 to 6. Neither f nor B is known: any will do.
absl::StatusOr<Pair> Cones(const std::string& data) {
  const std::string dir = JoinPath(data, "multiview/cones");
  ASSIGN_OR_RETURN(Image<float> disparity, ReadDisparity(JoinPath(dir, "disp2.png"), 0.25 / 2));
  return MakePair("cones: 4 from 2", JoinPath(dir, "im2.png"), JoinPath(dir, "im4.png"), std::move(disparity), 450.0,
                  0.1, 0.0);
}

// Views 1 to 5 in line; stored is 16 times the disparity between neighbours, seen from view 3. The outer view's own is
// carried over from there, two neighbours to the left; what view 3 does not see takes the farther side.
absl::StatusOr<Pair> Tsukuba(const std::string& data, int target) {
  const std::string dir = JoinPath(data, "multiview/tsukuba");
  ASSIGN_OR_RETURN(const Image<float> middle, ReadDisparity(JoinPath(dir, "disp_view3_x16.png"), 1.0 / 16));
  Image<float> outer(middle.width(), middle.height());
  for (int y = 0; y < middle.height(); ++y)
    for (int x = 0; x < middle.width(); ++x) {
      const float d = middle(x, y);
      const int to = x + static_cast<int>(std::lround(2 * d));
      if (d > 0 && to < middle.width()) outer(to, y) = std::max(outer(to, y), d);
    }
  const int steps = target - 1;
  for (int y = 0; y < outer.height(); ++y)
    for (int x = 0; x < outer.width(); ++x) outer(x, y) *= static_cast<float>(steps);
  return MakePair(absl::StrFormat("tsukuba: %d from 1", target), JoinPath(dir, "tsukuba1.png"),
                  JoinPath(dir, absl::StrFormat("tsukuba%d.png", target)), std::move(outer), 384.0, 0.1, 0.0);
}

struct RegionErrors {
  ColorErrors all, holes, band;
  void Add(const Image<Rgb8>& image, const Image<Rgb8>& truth, const Masks& masks) {
    all.Add(image, truth, masks.all);
    holes.Add(image, truth, masks.holes);
    band.Add(image, truth, masks.band);
  }
};

std::string Row(const std::string& first, const std::string& second, const RegionErrors& errors) {
  return absl::StrFormat("| %s | %s | %.2f / %.4f | %.2f / %.4f | %.2f / %.4f |\n", first, second, errors.all.PsnrDb(),
                         errors.all.Ssim(), errors.holes.PsnrDb(), errors.holes.Ssim(), errors.band.PsnrDb(),
                         errors.band.Ssim());
}

absl::Status WriteImage(const std::string& folder, std::string name, const Image<Rgb8>& image) {
  if (folder.empty()) return absl::OkStatus();
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == ' ' || c == ':' || c == ','; }, '_');
  RETURN_IF_ERROR(MakeFolder(folder));
  return WritePngRgb8(JoinPath(folder, name + ".png"), image);
}

absl::Status Views(const std::string& data, const std::string& images) {
  std::vector<Pair> pairs;
  for (const char* name : {"art", "books", "dolls"}) {
    ASSIGN_OR_RETURN(pairs.emplace_back(), Middlebury2005(data, name));
  }
  ASSIGN_OR_RETURN(pairs.emplace_back(), Cones(data));
  for (const int target : {2, 3}) {
    ASSIGN_OR_RETURN(pairs.emplace_back(), Tsukuba(data, target));
  }
  std::printf(
      "PSNR dB / SSIM of the made view\n\n| view | method | all | holes | edge band |\n|---|---|---|---|---|\n");
  std::map<std::string, RegionErrors> three;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const Pair& pair = pairs[i];
    const Masks masks = MakeMasks(pair.disparity_px);
    RETURN_IF_ERROR(WriteImage(images, pair.name + " truth", pair.truth));
    for (const auto& [method, make] : kMethods) {
      const Image<Rgb8> image = make(pair);
      RegionErrors errors;
      errors.Add(image, pair.truth, masks);
      if (i < 3) three[method].Add(image, pair.truth, masks);
      std::printf("%s", Row(pair.name, method, errors).c_str());
      RETURN_IF_ERROR(WriteImage(images, pair.name + " " + method, image));
    }
  }
  for (const auto& [method, make] : kMethods)
    std::printf("%s", Row("art, books, dolls", method, three[method]).c_str());
  return absl::OkStatus();
}

// ---- Scenes of the library

Camera WideCamera() {
  Camera camera;
  camera.width = 848, camera.height = 480;
  camera.fx = camera.fy = 600.0;
  camera.cx = 423.5, camera.cy = 239.5;
  return camera;
}

DepthDistribution Distribution(const Image<float>& depth_m) {
  std::vector<float> depths;
  for (size_t i = 0; i < depth_m.pixel_count(); ++i)
    if (depth_m.data()[i] > 0) depths.push_back(depth_m.data()[i]);
  std::sort(depths.begin(), depths.end());
  return {depths[depths.size() / 100], depths[depths.size() * 99 / 100], depths[depths.size() / 2]};
}

// ---- Temporal

// Gaps of `missing` that do not touch the image's sides.
Image<uint8_t> InnerHoles(const Image<uint8_t>& missing) {
  Image<uint8_t> holes = missing.Clone();
  for (int y = 0; y < holes.height(); ++y) {
    for (int x = 0; x < holes.width() && missing(x, y) != 0; ++x) holes(x, y) = 0;
    for (int x = holes.width() - 1; x >= 0 && missing(x, y) != 0; --x) holes(x, y) = 0;
  }
  return holes;
}

struct SceneFrame {
  Renderer renderer;
  Image<Rgb8> color;
  Image<float> depth_m;
};

absl::Status Temporal(const std::string& images) {
  cv::setNumThreads(1);
  constexpr int kThreads = 2;
  const Camera camera = WideCamera();
  std::printf(
      "Hidden background from frames 1/60, 1/30 and 1/15 s before and after, against inferred background: PSNR dB / "
      "SSIM "
      "in the holes\nof a left eye 65 mm beside the recorded one, against the rendered truth. Depth is exact; motion "
      "is "
      "exact or dense flow.\n\n| scene | hole pixels | inferred only | temporal, exact motion | temporal, dense flow "
      "| hidden pixels seen: exact, flow | gain dB: exact, flow |\n|---|---|---|---|---|---|---|\n");
  ColorErrors total[3];
  for (const char* name : {"kick", "bounce", "cloth", "turntable", "pan"}) {
    ASSIGN_OR_RETURN(const auto scene, MakeScene(name, 1));
    ColorErrors errors[3];
    int64_t seen[3] = {}, looked_for = 0;
    for (const double time_s : {0.2, 0.5}) {
      const auto frame_at = [&](double t) {
        SceneFrame frame{RendererAt(*scene, camera, t), {}, {}};
        frame.color = frame.renderer.Color(kThreads);
        frame.depth_m = frame.renderer.Surface(kThreads).depth_m;
        return frame;
      };
      const SceneFrame centre = frame_at(time_s);
      StereoOptions options;
      options.baseline_m = 0.065;
      options.convergence_m = std::numeric_limits<double>::infinity();
      ASSIGN_OR_RETURN(const StereoGeometry geometry, ResolveStereo(camera, options, Distribution(centre.depth_m)));
      const Pose left_pose = scene->WorldFromCamera(time_s) * Eigen::Translation3d(-*options.baseline_m, 0, 0);
      const Image<Rgb8> truth = Renderer(*scene, camera, left_pose, time_s).Color(kThreads);
      // Frames in order of preference; their motion as a job has it, composed from frame to frame.
      std::vector<SceneFrame> frames;
      std::vector<Image<Flow2>> exact, flow;
      for (const double direction : {1.0, -1.0}) {
        Image<uint8_t> before = Luma(centre.color);
        Image<Flow2> composed;
        for (int step = 1; step <= 4; ++step) {
          SceneFrame frame = frame_at(time_s + direction * step / 60);
          Image<uint8_t> luma = Luma(frame.color);
          ASSIGN_OR_RETURN(Image<Flow2> next, DenseFlow(before, luma, {}));
          composed = step == 1 ? std::move(next) : Compose(composed, next);
          before = std::move(luma);
          if (step == 3) continue;
          exact.push_back(std::move(centre.renderer.MotionTo(frame.renderer, kThreads).flow));
          flow.push_back(composed.Clone());
          frames.push_back(std::move(frame));
        }
      }
      constexpr int kPreference[] = {0, 3, 1, 4, 2, 5};  // nearest in time first
      const RenderView view{centre.color, centre.depth_m};
      for (int kind = 0; kind < 3; ++kind) {
        std::vector<NeighborFrame> neighbors;
        for (const int i : kPreference)
          if (kind > 0) neighbors.push_back({{frames[i].color, frames[i].depth_m}, kind == 1 ? exact[i] : flow[i]});
        const HiddenBackground hidden = FindHiddenBackground(view, neighbors, geometry.background, kThreads);
        Image<uint8_t> missing;
        const Image<Rgb8> left = RenderEye(view, hidden, geometry, -1.0, kThreads, &missing);
        errors[kind].Add(left, truth, InnerHoles(missing));
        for (size_t i = 0; i < hidden.source.pixel_count(); ++i) {
          seen[kind] += hidden.source.data()[i] == kHiddenSeen;
          looked_for += kind == 0 && hidden.source.data()[i] != 0;
        }
        const char* kinds[] = {"inferred", "exact", "flow"};
        RETURN_IF_ERROR(WriteImage(images, absl::StrFormat("%s %.2f %s", name, time_s, kinds[kind]), left));
      }
      RETURN_IF_ERROR(WriteImage(images, absl::StrFormat("%s %.2f truth", name, time_s), truth));
    }
    for (int kind = 0; kind < 3; ++kind) total[kind].Add(errors[kind]);
    const auto score = [](const ColorErrors& e) { return absl::StrFormat("%.2f / %.3f", e.PsnrDb(), e.Ssim()); };
    const auto share = [&](int kind) {
      return 100.0 * static_cast<double>(seen[kind]) / static_cast<double>(looked_for);
    };
    std::printf("| %s | %lld | %s | %s | %s | %.0f %%, %.0f %% | %.2f, %.2f |\n", name,
                static_cast<long long>(errors[0].pixels()), score(errors[0]).c_str(), score(errors[1]).c_str(),
                score(errors[2]).c_str(), share(1), share(2), errors[1].PsnrDb() - errors[0].PsnrDb(),
                errors[2].PsnrDb() - errors[0].PsnrDb());
  }
  std::printf("| all | %lld | %.2f / %.3f | %.2f / %.3f | %.2f / %.3f | | %.2f, %.2f |\n",
              static_cast<long long>(total[0].pixels()), total[0].PsnrDb(), total[0].Ssim(), total[1].PsnrDb(),
              total[1].Ssim(), total[2].PsnrDb(), total[2].Ssim(), total[1].PsnrDb() - total[0].PsnrDb(),
              total[2].PsnrDb() - total[0].PsnrDb());
  return absl::OkStatus();
}

// ---- Speed

template <typename Body>
double Milliseconds(const Body& body) {
  return 1000 * Seconds(body);
}

absl::Status Speed(int rounds) {
  constexpr int kThreads = 2;
  cv::setNumThreads(kThreads);
  std::printf(
      "848 x 480, %d threads, %d rounds, medians, ms. A frame is its hidden background and its made eye; beside it "
      "cv::remap of the whole frame\nand cv::inpaint (Telea, radius 3) of the same holes.\n\n"
      "| scene | holes %% | hidden background | made eye | frame | remap | inpaint | frame / 2 (remap + inpaint) | "
      "frame "
      "/ 30 ms |\n|---|---|---|---|---|---|---|---|---|\n",
      kThreads, rounds);
  for (const char* name : {"kick", "bounce", "cloth"}) {
    ASSIGN_OR_RETURN(const auto scene, MakeScene(name, 1));
    const Camera camera = WideCamera();
    const Renderer renderer = RendererAt(*scene, camera, 0.1);
    const Image<Rgb8> color = renderer.Color(kThreads);
    const Image<float> depth_m = renderer.Surface(kThreads).depth_m;
    const StereoOptions options;
    ASSIGN_OR_RETURN(const StereoGeometry geometry, ResolveStereo(camera, options, Distribution(depth_m)));
    const RenderView view{color, depth_m};
    Image<uint8_t> missing;
    const Image<Rgb8> eye = RenderEye(view, {Image<Rgb8>(848, 480), Image<float>(848, 480), Image<uint8_t>(848, 480)},
                                      geometry, -1.0, kThreads, &missing);
    cv::Mat holes(480, 848, CV_8U, missing.data()), map_x(480, 848, CV_32F), map_y(480, 848, CV_32F), moved, filled;
    for (int y = 0; y < 480; ++y)
      for (int x = 0; x < 848; ++x) {
        map_x.at<float>(y, x) = static_cast<float>(x - geometry.DisparityPx(depth_m(x, y)));
        map_y.at<float>(y, x) = static_cast<float>(y);
      }
    std::vector<double> search, frame, remap, inpaint;
    for (int round = 0; round < rounds; ++round) {
      HiddenBackground hidden;
      search.push_back(Milliseconds([&] { hidden = FindHiddenBackground(view, {}, geometry.background, kThreads); }));
      frame.push_back(search.back() + Milliseconds([&] { RenderStereo(view, hidden, geometry, options, kThreads); }));
      remap.push_back(Milliseconds([&] { cv::remap(AsMat(color), moved, map_x, map_y, cv::INTER_LINEAR); }));
      inpaint.push_back(Milliseconds([&] { cv::inpaint(AsMat(eye), holes, filled, 3.0, cv::INPAINT_TELEA); }));
    }
    const double ours = Median(frame), theirs = 2 * (Median(remap) + Median(inpaint));
    std::printf("| %s | %.2f | %.1f | %.1f | %.1f | %.1f | %.1f | %.2f | %.2f |\n", name,
                100.0 * cv::countNonZero(holes) / (848 * 480), Median(search), ours - Median(search), ours,
                Median(remap), Median(inpaint), ours / theirs, ours / 30.0);
  }
  return absl::OkStatus();
}

absl::Status Run(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "", first = argc > 2 ? argv[2] : "", second = argc > 3 ? argv[3] : "";
  if (what == "views" && !first.empty()) return Views(first, second);
  if (what == "temporal") return Temporal(first);
  if (what == "speed") return Speed(first.empty() ? 15 : std::atoi(first.c_str()));
  return absl::InvalidArgumentError("usage: stereo_bench views DATA [IMAGES] | temporal [IMAGES] | speed [ROUNDS]");
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  const absl::Status status = depthtween::Run(argc, argv);
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
