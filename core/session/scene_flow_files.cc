#include "core/session/scene_flow_files.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/parallel.h"
#include "core/io/file.h"
#include "core/io/flo.h"
#include "core/io/flow_png.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/result_folder.h"
#include "core/sceneflow/flow_and_depth.h"

namespace depthtween {
namespace {

constexpr double kDisparityUnits = 256.0;

bool Wants(const std::vector<std::string>& formats, const char* format) {
  return std::find(formats.begin(), formats.end(), format) != formats.end();
}

absl::Status WriteNpzOf(const std::string& path, const SceneFlow& flow) {
  const int64_t width = flow.flow_px.width(), height = flow.flow_px.height();
  const size_t count = flow.flow_px.pixel_count();
  std::vector<float> pixels, metres;
  pixels.reserve(2 * count);
  metres.reserve(3 * count);
  NpyArray hidden{.type = ElementType::kBool, .shape = {height, width}};
  for (size_t i = 0; i < count; ++i) {
    const Flow2 f = flow.flow_px.data()[i];
    const Float3 m = flow.motion_m.data()[i];
    pixels.insert(pixels.end(), {f.u, f.v});
    metres.insert(metres.end(), {m.x, m.y, m.z});
    hidden.bytes.push_back(flow.hidden.data()[i] != 0 ? 1 : 0);
  }
  const auto plane = [&](const Image<float>& image, ElementType type) {
    return NpyArray::FromFloats({height, width}, std::vector<float>(image.data(), image.data() + count), type);
  };
  Npz arrays;
  arrays.emplace("flow", NpyArray::FromFloats({height, width, 2}, pixels, ElementType::kFloat32));
  arrays.emplace("motion", NpyArray::FromFloats({height, width, 3}, metres, ElementType::kFloat32));
  arrays.emplace("depth", plane(flow.depth_m, ElementType::kFloat32));
  arrays.emplace("confidence", plane(flow.confidence, ElementType::kFloat16));
  arrays.emplace("hidden", std::move(hidden));
  ASSIGN_OR_RETURN(const std::string bytes, EncodeNpz(arrays, NpzCompression::kFast));
  return WriteFileDurably(path, bytes);
}

absl::Status WriteFloOf(const std::string& dir, const std::string& stem, const SceneFlow& flow) {
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, "flow/" + stem + ".flo"), EncodeFlo(flow.flow_px)));
  Image<float> change(flow.motion_m.width(), flow.motion_m.height());
  for (size_t i = 0; i < change.pixel_count(); ++i) change.data()[i] = flow.motion_m.data()[i].z;
  return WriteFileDurably(JoinPath(dir, "depth_change/" + stem + ".pfm"), EncodePfm(change));
}

absl::Status WriteKittiOf(const std::string& dir, const std::string& stem, const Camera& camera, double baseline_m,
                          const SceneFlow& flow) {
  const int width = flow.flow_px.width(), height = flow.flow_px.height();
  Image<uint8_t> valid(width, height);
  Image<uint16_t> now(width, height), next(width, height);
  const auto units = [&](float z) {
    const double disparity = kDisparityUnits * camera.fx * baseline_m / z;
    return z > 0.0F ? static_cast<uint16_t>(std::clamp(std::round(disparity), 1.0, 65535.0)) : uint16_t{0};
  };
  for (size_t i = 0; i < valid.pixel_count(); ++i) {
    if (!(flow.confidence.data()[i] > 0.0F)) continue;
    valid.data()[i] = 1;
    now.data()[i] = units(flow.depth_m.data()[i]);
    next.data()[i] = units(flow.depth_m.data()[i] + flow.motion_m.data()[i].z);
  }
  ASSIGN_OR_RETURN(const std::string flow_png, EncodeFlowPng(flow.flow_px, valid));
  ASSIGN_OR_RETURN(const std::string now_png, EncodePng16(now));
  ASSIGN_OR_RETURN(const std::string next_png, EncodePng16(next));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, "kitti/flow/" + stem + ".png"), flow_png));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, "kitti/disp_0/" + stem + ".png"), now_png));
  return WriteFileDurably(JoinPath(dir, "kitti/disp_1/" + stem + ".png"), next_png);
}

}  // namespace

std::string SceneFlowNpzName(const std::string& stem) { return "sceneflow/" + stem + ".npz"; }

absl::Status MakeSceneFlowFolders(const std::string& dir, const std::vector<std::string>& formats) {
  constexpr std::pair<const char*, const char*> kFolders[] = {{"npz", "sceneflow"},      {"flo", "flow"},
                                                              {"flo", "depth_change"},   {"kitti", "kitti/flow"},
                                                              {"kitti", "kitti/disp_0"}, {"kitti", "kitti/disp_1"}};
  for (const auto& [format, folder] : kFolders)
    if (Wants(formats, format)) RETURN_IF_ERROR(MakeFolder(JoinPath(dir, folder)));
  return absl::OkStatus();
}

absl::Status WriteSceneFlow(const std::string& dir, const std::string& stem, const std::vector<std::string>& formats,
                            const Camera& camera, double baseline_m, const SceneFlow& flow) {
  if (Wants(formats, "npz")) RETURN_IF_ERROR(WriteNpzOf(JoinPath(dir, SceneFlowNpzName(stem)), flow));
  if (Wants(formats, "flo")) RETURN_IF_ERROR(WriteFloOf(dir, stem, flow));
  if (Wants(formats, "kitti")) RETURN_IF_ERROR(WriteKittiOf(dir, stem, camera, baseline_m, flow));
  return absl::OkStatus();
}

absl::StatusOr<int> AddSceneFlow(const std::string& dir, const Sequence& sequence, const ClipConstants& constants,
                                 int threads, const std::stop_token& stop,
                                 const std::function<void(int, int)>& on_frame) {
  RETURN_IF_ERROR(MakeSceneFlowFolders(dir, {"npz"}));
  const PixelRays rays(sequence.camera);
  const DepthNoise noise{.a_m = static_cast<float>(constants.noise_a_m),
                         .b_per_m = static_cast<float>(constants.noise_b_per_m)};
  std::vector<int> frames;  // that lack it
  int total = 0;
  for (int i = 0; i + 1 < static_cast<int>(sequence.color.size()); ++i) {
    const std::string stem = sequence.color[i].Stem();
    if (!FileExists(JoinPath(dir, ResultMotionName(stem)))) continue;
    ++total;
    if (!FileExists(JoinPath(dir, SceneFlowNpzName(stem)))) frames.push_back(i);
  }
  std::mutex counting;
  int there = total - static_cast<int>(frames.size());
  if (on_frame) on_frame(there, total);
  std::vector<absl::Status> done(frames.size());
  ParallelFor(static_cast<int>(frames.size()), threads, [&](int i) {
    done[i] = [&]() -> absl::Status {
      if (stop.stop_requested()) return absl::CancelledError("stopped");
      const std::string stem = sequence.color[frames[i]].Stem(), next = sequence.color[frames[i] + 1].Stem();
      ASSIGN_OR_RETURN(const FrameMotion motion, ReadResultMotion(dir, stem));
      ASSIGN_OR_RETURN(const Image<float> from_m, ReadResultDepth(dir, stem, sequence.depth_scale));
      ASSIGN_OR_RETURN(const Image<float> to_m, ReadResultDepth(dir, next, sequence.depth_scale));
      if (!from_m.view().SameSize(motion.next.view()) || !from_m.view().SameSize(to_m.view()) ||
          from_m.width() != rays.width() || from_m.height() != rays.height())
        return absl::DataLossError(absl::StrCat(dir, ": frame ", stem, ": depth and motion differ in size"));
      RETURN_IF_ERROR(WriteNpzOf(JoinPath(dir, SceneFlowNpzName(stem)),
                                 FromFlowAndDepth(rays, {motion.next, motion.back, from_m, to_m}, noise, 1)));
      const std::lock_guard lock(counting);
      ++there;
      if (on_frame) on_frame(there, total);
      return absl::OkStatus();
    }();
  });
  for (const absl::Status& status : done) RETURN_IF_ERROR(status);
  return total;
}

}  // namespace depthtween
