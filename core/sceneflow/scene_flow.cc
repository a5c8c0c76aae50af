#include "core/sceneflow/scene_flow.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/base/parallel.h"
#include "core/fill/key_cleaning.h"
#include "core/fill/noise_samples.h"
#include "core/flow/dense_flow.h"
#include "core/sceneflow/frame_pair.h"
#include "core/sceneflow/layered_flow.h"
#include "core/sceneflow/pd_flow.h"
#include "core/sceneflow/rigid_windows.h"
#include "core/sceneflow/sr_flow.h"

namespace depthtween {
namespace {

// Of the window in which noise is taken down, as for upsampling.
constexpr int kDenoiseRadius = 3;

using Method = absl::StatusOr<SceneFlow> (*)(const FramePair&);

struct NamedMethod {
  const char* name;
  Method run;
};
constexpr std::array<NamedMethod, 4> kMethods = {{{"ours", RigidWindowsFlow},
                                                  {"pd-flow", PrimalDualFlow},
                                                  {"sr-flow", SemiRigidFlow},
                                                  {"layered-flow", LayeredFlow}}};

const NamedMethod* Find(const std::string& name) {
  const auto* const found =
      std::find_if(kMethods.begin(), kMethods.end(), [&](const NamedMethod& m) { return name == m.name; });
  return found == kMethods.end() ? nullptr : found;
}

absl::Status CheckSize(const char* what, int width, int height, const Camera& camera) {
  if (width == camera.width && height == camera.height) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s is %d x %d, must be %d x %d as the camera says", what, width,
                                                    height, camera.width, camera.height));
}

bool Knows(ImageView<const float> depth_m) {
  for (int y = 0; y < depth_m.height(); ++y)
    if (std::any_of(depth_m.row(y), depth_m.row(y) + depth_m.width(), [](float z) { return z > 0.0F; })) return true;
  return false;
}

PreparedFrame Prepare(const RgbdView& view, const DepthNoise& noise, int threads) {
  PreparedFrame frame{.color = view.color, .measured_m = view.depth_m, .luma = Luma(view.color)};
  Image<float> solid = RemoveFlyingPixels(view.depth_m, noise, threads);
  // Specks everywhere: better mixed pixels than none.
  FilledDepth filled = Knows(solid) ? FillAlongColor(solid, view.color) : FillAlongColor(view.depth_m, view.color);
  frame.depth_m = DenoiseInLayers(filled.depth_m, filled.distance, view.color, noise, kDenoiseRadius, threads);
  frame.distance = std::move(filled.distance);
  return frame;
}

}  // namespace

absl::Status SceneFlowOptions::Validate() const {
  if (Find(method) == nullptr)
    return absl::InvalidArgumentError(absl::StrFormat("SceneFlowOptions.method = '%s', must be one of %s", method,
                                                      absl::StrJoin(SceneFlowMethods(), ", ")));
  if (noise && !(noise->a_m >= 0.0F && noise->b_per_m >= 0.0F && noise->a_m + noise->b_per_m > 0.0F))
    return absl::InvalidArgumentError(absl::StrFormat(
        "SceneFlowOptions.noise = %g m + %g z^2, must not be negative nor 0", noise->a_m, noise->b_per_m));
  if (threads < 1)
    return absl::InvalidArgumentError(absl::StrFormat("SceneFlowOptions.threads = %d, must be > 0", threads));
  return absl::OkStatus();
}

float SampleSurface(ImageView<const float> depth_m, float x, float y, const DepthNoise& noise) {
  x = std::clamp(x, 0.0F, static_cast<float>(depth_m.width() - 1));
  y = std::clamp(y, 0.0F, static_cast<float>(depth_m.height() - 1));
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, depth_m.width() - 1), y1 = std::min(y0 + 1, depth_m.height() - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const float nearest = depth_m(ax < 0.5F ? x0 : x1, ay < 0.5F ? y0 : y1);
  if (!(nearest > 0.0F)) return 0.0F;
  float sum = 0.0F, weights = 0.0F;
  const auto add = [&](int px, int py, float weight) {
    const float z = depth_m(px, py);
    if (!(z > 0.0F) || !SameLayer(z, nearest, noise)) return;
    sum += weight / z;
    weights += weight;
  };
  add(x0, y0, (1 - ax) * (1 - ay));
  add(x1, y0, ax * (1 - ay));
  add(x0, y1, (1 - ax) * ay);
  add(x1, y1, ax * ay);
  return weights / sum;  // the nearest pixel's weight is at least a quarter
}

absl::StatusOr<SceneFlow> EstimateSceneFlow(const Camera& camera, const RgbdView& from, const RgbdView& to,
                                            const SceneFlowOptions& options) {
  RETURN_IF_ERROR(options.Validate());
  RETURN_IF_ERROR(camera.Validate());
  if (options.to_camera) {
    RETURN_IF_ERROR(WithContext(options.to_camera->Validate(), "SceneFlowOptions.to_camera"));
    RETURN_IF_ERROR(
        CheckSize("SceneFlowOptions.to_camera", options.to_camera->width, options.to_camera->height, camera));
  }
  RETURN_IF_ERROR(CheckSize("colour of the first frame", from.color.width(), from.color.height(), camera));
  RETURN_IF_ERROR(CheckSize("depth of the first frame", from.depth_m.width(), from.depth_m.height(), camera));
  RETURN_IF_ERROR(CheckSize("colour of the second frame", to.color.width(), to.color.height(), camera));
  RETURN_IF_ERROR(CheckSize("depth of the second frame", to.depth_m.width(), to.depth_m.height(), camera));
  for (const auto& [what, view] : {std::pair{"first", &from}, std::pair{"second", &to}})
    if (!Knows(view->depth_m))
      return absl::FailedPreconditionError(
          absl::StrFormat("the depth map of the %s frame holds not one measurement", what));
  DepthNoise noise;
  if (options.noise) {
    noise = *options.noise;
  } else {
    NoiseSamples samples;
    samples.AddOverSpace(from.depth_m);
    samples.AddOverSpace(to.depth_m);
    constexpr double kFinestStep = 1e-4;  // metres; finer is no sensor's
    noise = samples.Fit(kFinestStep);
  }
  const FramePair pair{.rays = PixelRays(camera),
                       .to_rays = PixelRays(options.to_camera.value_or(camera)),
                       .noise = noise,
                       .from = Prepare(from, noise, options.threads),
                       .to = Prepare(to, noise, options.threads),
                       .threads = options.threads,
                       .stop = options.stop,
                       .on_item = options.on_item};
  RETURN_IF_ERROR(pair.StepDone());
  return Find(options.method)->run(pair);
}

}  // namespace depthtween
