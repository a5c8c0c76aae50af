// Depth of field against a lens of 512 samples, and its time beside OpenCV's.
//
//   depth_of_field_bench quality [REFERENCES]    PSNR and SSIM of all methods from true colour and depth
//   depth_of_field_bench upsampled [REFERENCES]  the gain of depth upsampled to 240 fps over 30 fps, held
//   depth_of_field_bench speed [ROUNDS]          one frame of 848 x 480 beside a stack of filter2D
//
// REFERENCES is a folder: renders through the lens are kept there and read back by the next run. Prints Markdown.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/base/parallel.h"
#include "core/io/color.h"
#include "core/io/png.h"
#include "core/metrics/color_errors.h"
#include "core/metrics/regions.h"
#include "core/render/depth_of_field.h"
#include "core/synthetic/lens_render.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/pipeline.h"
#include "opencv2/core.hpp"
#include "opencv2/imgproc.hpp"
#include "tests/bench/timing.h"

namespace depthtween {
namespace {

constexpr int kLensSamples = 512;
constexpr double kLargestRadiusPx = 16;  // of the 0.5th to 99.5th percentile of depth
constexpr Camera kCamera{.width = 424, .height = 352, .fx = 302, .fy = 302, .cx = 211.5, .cy = 175.5};
constexpr const char* kScenes[] = {"bounce", "kick", "cloth", "turntable", "pan"};

float Percentile(const Image<float>& image, double share) {
  std::vector<float> values(image.data(), image.data() + image.pixel_count());
  const auto nth = values.begin() + static_cast<ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// The lens that, focused on this share of the scene's pixels, shows none of them less sharp than kLargestRadiusPx.
CircleOfConfusion FocusOn(const Image<float>& depth_m, double share) {
  CircleOfConfusion circle{.scale_px = 1, .focus_m = Percentile(depth_m, share)};
  circle.scale_px = kLargestRadiusPx / std::max(std::abs(circle.RadiusPx(Percentile(depth_m, 0.005))),
                                                std::abs(circle.RadiusPx(Percentile(depth_m, 0.995))));
  return circle;
}

// Pixels within two radii of a depth edge, the larger of both sides' radii.
Image<uint8_t> EdgeBandOf(const Image<float>& depth_m, const CircleOfConfusion& circle) {
  const Image<uint8_t> jumps = DepthJumps(depth_m);
  Image<uint8_t> band(depth_m.width(), depth_m.height());
  for (int y = 0; y < depth_m.height(); ++y)
    for (int x = 0; x < depth_m.width(); ++x) {
      if (jumps(x, y) == 0) continue;
      float radius = 0;
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i)
          radius = std::max(radius, std::abs(circle.RadiusPx(depth_m.view().Clamped(x + i, y + j))));
      const int reach = static_cast<int>(2 * radius);
      for (int j = -reach; j <= reach; ++j)
        for (int i = -reach; i <= reach; ++i)
          if (i * i + j * j <= reach * reach && band.Contains(x + i, y + j)) band(x + i, y + j) = 1;
    }
  return band;
}

Image<Rgb8> Render(const RenderView& view, const HiddenBackground& hidden, const CircleOfConfusion& circle,
                   DepthOfFieldMethod method) {
  return RenderDepthOfField(view, hidden, circle, {.method = method}, AvailableThreads());
}

HiddenBackground BehindSilhouettes(const RenderView& view, const std::vector<NeighborFrame>& neighbors = {}) {
  return FindHiddenBackground(view, neighbors, {}, AvailableThreads());
}

// A frame of the same clip some time before or after, and the true motion there.
struct Neighbor {
  Image<Rgb8> color;
  Image<float> depth_m;
  Image<Flow2> motion;

  Neighbor(const Scene& scene, const Renderer& from, double time_s) {
    const Renderer there = RendererAt(scene, kCamera, time_s);
    color = there.Color(AvailableThreads());
    depth_m = std::move(there.Surface(AvailableThreads()).depth_m);
    motion = std::move(from.MotionTo(there, AvailableThreads()).flow);
  }
  NeighborFrame Frame() const { return {{color, depth_m}, motion}; }
};

// Keeps a picture for the eye, where there is a folder for it.
absl::Status Keep(const Image<Rgb8>& image, const std::string& folder, const std::string& name) {
  return folder.empty() ? absl::OkStatus() : WritePngRgb8(absl::StrCat(folder, "/", name, ".png"), image);
}

absl::StatusOr<Image<Rgb8>> Reference(const Scene& scene, const Camera& camera, double time_s,
                                      const CircleOfConfusion& circle, const std::string& folder,
                                      const std::string& name) {
  const std::string path = absl::StrCat(folder, "/", name, ".png");
  if (!folder.empty() && std::filesystem::exists(path)) return ReadColor(path);
  // For the scene renderer R = f_px A / (2 z_f): its picture is that of a pinhole.
  const ThinLens lens{.aperture_m = 2 * circle.scale_px * circle.focus_m / camera.fx, .focus_m = circle.focus_m};
  Image<Rgb8> image =
      RenderThroughLens(scene, camera, scene.WorldFromCamera(time_s), time_s, lens, kLensSamples, AvailableThreads());
  RETURN_IF_ERROR(Keep(image, folder, name));
  return image;
}

absl::Status Quality(const std::string& references) {
  constexpr double kTime = 0.1;
  const struct {
    const char *name, *file;
    DepthOfFieldMethod method;
    int hidden;  // 0: unknown, 1: from this frame, 2: from four other frames too
  } methods[] = {{"ours", "ours", DepthOfFieldMethod::kLayers, 1},
                 {"ours, other frames at hand", "others", DepthOfFieldMethod::kLayers, 2},
                 {"ours, nothing hidden", "alone", DepthOfFieldMethod::kLayers, 0},
                 {"kraus", "kraus", DepthOfFieldMethod::kKraus, 0},
                 {"gather", "gather", DepthOfFieldMethod::kGather, 0}};
  std::printf("| scene | focus | m |");
  for (const auto& method : methods) std::printf(" %s |", method.name);
  std::printf("\n|---|---|---:|---:|---:|---:|---:|---:|\n");
  for (const char* name : kScenes) {
    ASSIGN_OR_RETURN(const auto scene, MakeScene(name, 1));
    const Renderer renderer = RendererAt(*scene, kCamera, kTime);
    const Image<Rgb8> color = renderer.Color(AvailableThreads());
    const Image<float> depth = std::move(renderer.Surface(AvailableThreads()).depth_m);
    std::vector<Neighbor> others;
    std::vector<NeighborFrame> neighbors;
    for (const int frames : {-4, 4, -8, 8}) others.emplace_back(*scene, renderer, kTime + frames / 240.0);
    for (const Neighbor& other : others) neighbors.push_back(other.Frame());
    const HiddenBackground hidden[] = {
        {}, BehindSilhouettes({color, depth}), BehindSilhouettes({color, depth}, neighbors)};
    for (const auto& [focus, share] : {std::pair{"near", 0.05}, std::pair{"mid", 0.5}, std::pair{"far", 0.95}}) {
      const CircleOfConfusion circle = FocusOn(depth, share);
      const std::string stem = absl::StrCat(name, "_", focus);
      ASSIGN_OR_RETURN(const Image<Rgb8> truth, Reference(*scene, kCamera, kTime, circle, references, stem));
      const Image<uint8_t> band = EdgeBandOf(depth, circle);
      std::printf("| %s | %s | %.2f |", name, focus, circle.focus_m);
      for (const auto& method : methods) {
        const Image<Rgb8> image = Render({color, depth}, hidden[method.hidden], circle, method.method);
        ColorErrors all, near_edges;
        all.Add(image, truth, {});
        near_edges.Add(image, truth, band);
        std::printf(" %.2f %.4f / %.2f %.4f |", all.PsnrDb(), all.Ssim(), near_edges.PsnrDb(), near_edges.Ssim());
        RETURN_IF_ERROR(Keep(image, references, absl::StrCat(stem, ".", method.file)));
      }
      std::printf("\n");
      std::fflush(stdout);
    }
  }
  return absl::OkStatus();
}

// What the pipeline makes of a recording's second interval, and what there is without it: the last depth frame, as well
// cleaned and filled, and held.
absl::Status Upsampled(const std::string& references) {
  constexpr int kFrames[] = {10, 12, 14};  // of the second interval, which begins at 8: early, half way, late
  std::printf("| scene | depth | all | in the band |\n|---|---|---:|---:|\n");
  for (const char* name : {"kick", "bounce"}) {
    SyntheticOptions options{.scene = name, .frames = 25, .width = kCamera.width, .height = kCamera.height};
    ASSIGN_OR_RETURN(const auto clip, SyntheticSequence::Create(options, AvailableThreads()));
    const Camera& camera = clip->sequence().camera;
    ASSIGN_OR_RETURN(const ClipConstants constants, EstimateClipConstants(*clip));
    std::vector<Image<float>> ours(options.frames);
    const auto keep = [&](DepthResult result) {
      ours[result.color_index] = std::move(result.depth_m);
      return absl::OkStatus();
    };
    const Interval interval = PlanIntervals(clip->sequence()).at(1);
    RETURN_IF_ERROR(MakePipeline()->Run(*clip, constants, interval, {.threads = AvailableThreads()}, keep).status());
    const Image<float>& held = ours[interval.first_frame];
    ColorErrors all[3], near_edges[3];
    for (const int frame : kFrames) {
      ASSIGN_OR_RETURN(const Image<Rgb8> color, clip->Color(frame));
      const double time_s = frame / options.color_fps;
      const Image<float> truth = std::move(clip->ColorView(frame).Surface(AvailableThreads()).depth_m);
      const CircleOfConfusion circle = FocusOn(truth, 0.05);
      ASSIGN_OR_RETURN(const Image<Rgb8> lens, Reference(clip->scene(), camera, time_s, circle, references,
                                                         absl::StrFormat("%s_frame%d", name, frame)));
      const Image<uint8_t> band = EdgeBandOf(truth, circle);
      const Image<float>* const depths[] = {&ours[frame], &held, &truth};
      for (int i = 0; i < 3; ++i) {
        const RenderView view{color, *depths[i]};
        const Image<Rgb8> image = Render(view, BehindSilhouettes(view), circle, DepthOfFieldMethod::kLayers);
        RETURN_IF_ERROR(Keep(image, references, absl::StrFormat("%s_frame%d.depth%d", name, frame, i)));
        all[i].Add(image, lens, {});
        near_edges[i].Add(image, lens, band);
      }
    }
    const char* const names[] = {"ours, 240 fps", "held, 30 fps", "true"};
    for (int i = 0; i < 3; ++i)
      std::printf("| %s | %s | %.2f %.4f | %.2f %.4f |\n", name, names[i], all[i].PsnrDb(), all[i].Ssim(),
                  near_edges[i].PsnrDb(), near_edges[i].Ssim());
    std::printf("| %s | **gain** | **%+.2f** | **%+.2f** |\n", name, all[0].PsnrDb() - all[1].PsnrDb(),
                near_edges[0].PsnrDb() - near_edges[1].PsnrDb());
    std::fflush(stdout);
  }
  return absl::OkStatus();
}

// The yardstick: a stack of twelve RGBA images, each blurred by OpenCV with a disc, of the radii that our layers have.
double FilterStack(const cv::Mat& rgba, float nearest_px, float farthest_px) {
  constexpr int kLayers = 12;
  double seconds = 0;
  for (int k = 0; k < kLayers; ++k) {
    const float radius = std::abs(nearest_px + (farthest_px - nearest_px) * static_cast<float>(k) / (kLayers - 1));
    const int reach = static_cast<int>(std::ceil(radius));
    cv::Mat disc(2 * reach + 1, 2 * reach + 1, CV_32F);
    for (int y = -reach; y <= reach; ++y)
      for (int x = -reach; x <= reach; ++x)
        disc.at<float>(y + reach, x + reach) =
            std::clamp(radius + 0.5F - std::hypot(static_cast<float>(x), static_cast<float>(y)), 0.0F, 1.0F);
    disc /= cv::sum(disc)[0];
    cv::Mat blurred;
    seconds += Seconds([&] { cv::filter2D(rgba, blurred, -1, disc); });
  }
  return seconds;
}

absl::Status Speed(int rounds) {
  constexpr int kThreads = 2;
  constexpr float kLargestPx = 20;
  const Camera camera{.width = 848, .height = 480, .fx = 500, .fy = 500, .cx = 423.5, .cy = 239.5};
  cv::setNumThreads(kThreads);
  std::printf("| scene | focus | radii, px | ours, ms | with hidden background, ms | 12 x filter2D, ms | ratio |\n");
  std::printf("|---|---|---|---:|---:|---:|---:|\n");
  for (const char* name : kScenes) {
    ASSIGN_OR_RETURN(const auto scene, MakeScene(name, 1));
    const Renderer renderer = RendererAt(*scene, camera, 0.1);
    const Image<Rgb8> color = renderer.Color(kThreads);
    const Image<float> depth = std::move(renderer.Surface(kThreads).depth_m);
    const cv::Mat rgba(camera.height, camera.width, CV_32FC4, cv::Scalar::all(0.5));
    for (const auto& [focus, share] : {std::pair{"near", 0.05}, std::pair{"far", 0.95}}) {
      CircleOfConfusion circle = FocusOn(depth, share);
      circle.scale_px *= kLargestPx / kLargestRadiusPx;
      const float nearest = circle.RadiusPx(Percentile(depth, 0.005)),
                  farthest = circle.RadiusPx(Percentile(depth, 0.995));
      std::vector<double> ours, whole, stack, ratio;
      for (int round = 0; round <= rounds; ++round) {
        HiddenBackground hidden;
        const double find = Seconds([&] { hidden = FindHiddenBackground({color, depth}, {}, {}, kThreads); });
        const double render = Seconds([&] {
          RenderDepthOfField({color, depth}, hidden, circle, {.max_radius_px = kLargestPx, .layers = 12}, kThreads);
        });
        const double yardstick = FilterStack(rgba, nearest, farthest);
        if (round == 0) continue;  // warms caches and thread pools
        ours.push_back(1000 * render);
        whole.push_back(1000 * (render + find));
        stack.push_back(1000 * yardstick);
        ratio.push_back((render + find) / yardstick);
      }
      std::printf("| %s | %s | %.1f..%.1f | %.0f | %.0f | %.0f | %.2f |\n", name, focus, nearest, farthest,
                  Median(ours), Median(whole), Median(stack), Median(ratio));
    }
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace depthtween

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "", argument = argc > 2 ? argv[2] : "";
  absl::Status status =
      absl::InvalidArgumentError("usage: depth_of_field_bench quality [DIR] | upsampled [DIR] | speed [N]");
  if (mode == "quality") status = depthtween::Quality(argument);
  if (mode == "upsampled") status = depthtween::Upsampled(argument);
  if (mode == "speed") status = depthtween::Speed(argument.empty() ? 7 : std::max(1, std::atoi(argument.c_str())));
  if (!status.ok()) std::fprintf(stderr, "%s\n", std::string(status.message()).c_str());
  return status.ok() ? 0 : 1;
}
