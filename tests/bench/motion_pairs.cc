#include "tests/bench/motion_pairs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/flow_png.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sceneflow/pixel_rays.h"
#include "core/sequence/camera_json.h"
#include "core/sequence/sequence.h"

namespace depthtween {
namespace {

// Of one surface, between neighbouring pixels: how far inverse depth may be from a plane's, and how much it may change.
constexpr float kMostBend = 0.01F, kMostSlant = 1.2F;

constexpr float kMostDepthChange = 0.1F;  // share of depth, from one colour frame to the next

// `most` of 0 .. count - 1, each in the middle of its share.
std::vector<int> Spread(int count, int most) {
  std::vector<int> chosen;
  const int taken = std::min(count, most);
  for (int i = 0; i < taken; ++i) chosen.push_back((2 * i + 1) * count / (2 * taken));
  return chosen;
}

class OfScene : public MotionPairs {
 public:
  OfScene(const SyntheticSequence& clip, PairStep step, int frames_per_key, std::vector<int> firsts, int threads)
      : clip_(clip), step_(step), frames_per_key_(frames_per_key), firsts_(std::move(firsts)), threads_(threads) {}

  const Camera& camera() const override { return clip_.sequence().camera; }
  PairStep step() const override { return step_; }
  int count() const override { return static_cast<int>(firsts_.size()); }

  absl::StatusOr<MotionPair> Read(int index) const override {
    const int first = firsts_[index];
    const bool keys = step_ == PairStep::kKeys;
    const Renderer from = keys ? clip_.DepthView(first) : clip_.ColorView(first);
    const Renderer to = keys ? clip_.DepthView(first + 1) : clip_.ColorView(first + 1);
    const int from_color = keys ? first * frames_per_key_ : first;
    const int to_color = keys ? from_color + frames_per_key_ : from_color + 1;
    const SurfaceTruth from_surface = from.Surface(threads_), to_surface = to.Surface(threads_);
    MotionTruth truth = from.MotionTo(to, threads_);
    MotionPair pair{.from_color = clip_.RecordedColor(from, from_color), .to_color = clip_.RecordedColor(to, to_color)};
    pair.from_m = keys ? clip_.RecordedDepth(from_surface, first) : from_surface.depth_m.Clone();
    pair.to_m = keys ? clip_.RecordedDepth(to_surface, first + 1) : to_surface.depth_m.Clone();
    pair.has_truth = true;
    pair.flow_px = std::move(truth.flow);
    pair.motion_m = std::move(truth.scene_flow);
    pair.valid = std::move(truth.valid);
    pair.hidden = std::move(truth.occluded);
    pair.true_depth_m = from_surface.depth_m.Clone();
    return pair;
  }

 private:
  const SyntheticSequence& clip_;
  const PairStep step_;
  const int frames_per_key_;
  const std::vector<int> firsts_;
  const int threads_;
};

// What all pairs of a folder share.
struct OpenFolder {
  std::unique_ptr<SequenceFolder> folder;
  std::optional<Camera> second_camera;

  std::string Path(const std::string& name) const { return JoinPath(folder->dir(), name); }
  const Sequence& sequence() const { return folder->sequence(); }
};

absl::StatusOr<Image<float>> ReadDepth(const OpenFolder& open, const std::string& path) {
  ASSIGN_OR_RETURN(const Image<uint16_t> units, ReadPng16(path));
  return DequantiseDepth(units, open.sequence().depth_scale);
}

absl::Status CheckSize(const Image<Flow2>& flow, const Image<uint8_t>& hidden, const Camera& camera,
                       const std::string& what) {
  const bool flow_fits = flow.width() == camera.width && flow.height() == camera.height;
  const bool hidden_fits = hidden.empty() || (hidden.width() == camera.width && hidden.height() == camera.height);
  if (flow_fits && hidden_fits) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("truth of %s is not %d x %d, must be as the camera says", what, camera.width, camera.height));
}

class OfFolder : public MotionPairs {
 public:
  OfFolder(std::shared_ptr<const OpenFolder> open, PairStep step, std::vector<int> firsts)
      : open_(std::move(open)), step_(step), firsts_(std::move(firsts)) {}

  const Camera& camera() const override { return open_->sequence().camera; }
  PairStep step() const override { return step_; }
  int count() const override { return static_cast<int>(firsts_.size()); }

  absl::StatusOr<MotionPair> Read(int index) const override {
    return step_ == PairStep::kKeys ? ReadKeys(firsts_[index]) : ReadFrames(firsts_[index]);
  }

 private:
  absl::StatusOr<MotionPair> ReadKeys(int first) const {
    const Sequence& sequence = open_->sequence();
    const std::string from = sequence.depth[first].Stem(),
                      both = absl::StrCat(from, "_", sequence.depth[first + 1].Stem());
    MotionPair pair{.to_camera = open_->second_camera};
    ASSIGN_OR_RETURN(pair.from_color, open_->folder->Color(NearestColorFrame(sequence, sequence.depth[first].time_ns)));
    ASSIGN_OR_RETURN(pair.to_color,
                     open_->folder->Color(NearestColorFrame(sequence, sequence.depth[first + 1].time_ns)));
    ASSIGN_OR_RETURN(pair.from_m, open_->folder->Depth(first));
    ASSIGN_OR_RETURN(pair.to_m, open_->folder->Depth(first + 1));
    const std::string motion_path = open_->Path("gt/sceneflow_key/" + both + ".npz");
    if (!FileExists(motion_path)) return pair;
    ASSIGN_OR_RETURN(const Npz arrays, ReadNpz(motion_path));
    RETURN_IF_ERROR(WithContext(ReadMotion(arrays, pair), motion_path));
    if (pair.flow_px.empty()) {
      ASSIGN_OR_RETURN(FlowField flow, ReadFlowPng(open_->Path("gt/flow_key/fwd_" + both + ".png")));
      RETURN_IF_ERROR(CheckSize(flow.flow, pair.hidden, camera(), both));
      pair.flow_px = std::move(flow.flow);
      for (size_t i = 0; i < pair.valid.pixel_count(); ++i) pair.valid.data()[i] &= flow.valid.data()[i];
    }
    if (const std::string path = open_->Path("gt/flow_key/occ_" + both + ".png"); FileExists(path)) {
      ASSIGN_OR_RETURN(pair.hidden, ReadPng8(path));
    }
    RETURN_IF_ERROR(CheckSize(pair.flow_px, pair.hidden, camera(), both));
    if (const std::string path = open_->Path("depth_clean/" + from + ".png"); FileExists(path)) {
      ASSIGN_OR_RETURN(pair.true_depth_m, ReadDepth(*open_, path));
    } else {
      pair.true_depth_m = pair.from_m.Clone();
    }
    pair.has_truth = true;
    return pair;
  }

  absl::Status ReadMotion(const Npz& arrays, MotionPair& pair) const {
    const int64_t width = camera().width, height = camera().height;
    const auto find = [&](const char* name, int64_t channels) -> absl::StatusOr<std::vector<float>> {
      const auto it = arrays.find(name);
      if (it == arrays.end()) return absl::NotFoundError(absl::StrCat("has no array ", name));
      if (it->second.element_count() != width * height * channels)
        return absl::InvalidArgumentError(absl::StrFormat("array %s has %d elements, must have %d x %d x %d", name,
                                                          it->second.element_count(), height, width, channels));
      return it->second.ToFloats();
    };
    ASSIGN_OR_RETURN(const std::vector<float> motion, find("sf", 3));
    ASSIGN_OR_RETURN(const std::vector<float> valid, find("valid", 1));
    pair.motion_m = Image<Float3>(camera().width, camera().height);
    pair.valid = Image<uint8_t>(camera().width, camera().height);
    for (size_t i = 0; i < valid.size(); ++i) {
      pair.motion_m.data()[i] = {motion[3 * i], motion[3 * i + 1], motion[3 * i + 2]};
      pair.valid.data()[i] = valid[i] != 0.0F ? 1 : 0;
    }
    if (!arrays.contains("flow")) return absl::OkStatus();
    ASSIGN_OR_RETURN(const std::vector<float> flow, find("flow", 2));
    pair.flow_px = Image<Flow2>(camera().width, camera().height);
    for (size_t i = 0; i < valid.size(); ++i) pair.flow_px.data()[i] = {flow[2 * i], flow[2 * i + 1]};
    return absl::OkStatus();
  }

  absl::StatusOr<MotionPair> ReadFrames(int first) const {
    const Sequence& sequence = open_->sequence();
    const std::string from = sequence.color[first].Stem(), to = sequence.color[first + 1].Stem();
    MotionPair pair{.to_camera = open_->second_camera};
    ASSIGN_OR_RETURN(pair.from_color, open_->folder->Color(first));
    ASSIGN_OR_RETURN(pair.to_color, open_->folder->Color(first + 1));
    ASSIGN_OR_RETURN(pair.from_m, ReadDepth(*open_, open_->Path("gt/depth/" + from + ".png")));
    ASSIGN_OR_RETURN(pair.to_m, ReadDepth(*open_, open_->Path("gt/depth/" + to + ".png")));
    ASSIGN_OR_RETURN(FlowField flow, ReadFlowPng(open_->Path("gt/flow/" + from + ".png")));
    Image<uint8_t> hidden;
    if (const std::string path = open_->Path("gt/occ/" + from + ".png"); FileExists(path)) {
      ASSIGN_OR_RETURN(hidden, ReadPng8(path));
    }
    RETURN_IF_ERROR(CheckSize(flow.flow, hidden, camera(), from));
    const PixelRays from_rays(camera()), to_rays(pair.to_camera.value_or(camera()));
    pair.flow_px = std::move(flow.flow);
    pair.motion_m = Image<Float3>(camera().width, camera().height);
    pair.valid = Image<uint8_t>(camera().width, camera().height);
    pair.true_depth_m = pair.from_m.Clone();
    for (int y = 0; y < camera().height; ++y)
      for (int x = 0; x < camera().width; ++x) {
        if (flow.valid(x, y) == 0 || (!hidden.empty() && hidden(x, y) != 0) || !(pair.from_m(x, y) > 0.0F)) continue;
        const float px = static_cast<float>(x) + pair.flow_px(x, y).u,
                    py = static_cast<float>(y) + pair.flow_px(x, y).v;
        const float there = DepthOnOneSurface(pair.to_m, px, py);
        if (!(there > 0.0F)) continue;
        // At silhouettes a flow that was rounded may end on another surface.
        if (std::abs(there - pair.from_m(x, y)) > kMostDepthChange * pair.from_m(x, y)) continue;
        pair.motion_m(x, y) = to_rays.PointAt(px, py, there) - from_rays.Point(x, y, pair.from_m(x, y));
        pair.valid(x, y) = 1;
      }
    pair.has_truth = true;
    return pair;
  }

  // Depth at a place if the four pixels around it lie on one plane, whose inverse depth is linear in the picture; else
  // 0: there may be two surfaces.
  static float DepthOnOneSurface(ImageView<const float> depth_m, float px, float py) {
    const int x = static_cast<int>(std::floor(px)), y = static_cast<int>(std::floor(py));
    if (!depth_m.Contains(x, y) || !depth_m.Contains(x + 1, y + 1)) return 0.0F;
    std::array<float, 4> inverse;
    for (int i = 0; i < 4; ++i) {
      const float z = depth_m(x + i % 2, y + i / 2);
      if (!(z > 0.0F)) return 0.0F;
      inverse[i] = 1.0F / z;
    }
    const auto [least, most] = std::minmax_element(inverse.begin(), inverse.end());
    const float bend = inverse[0] + inverse[3] - inverse[1] - inverse[2];
    if (std::abs(bend) > kMostBend * *least || *most > kMostSlant * *least) return 0.0F;
    const float ax = px - static_cast<float>(x), ay = py - static_cast<float>(y);
    return 1.0F /
           ((1 - ay) * ((1 - ax) * inverse[0] + ax * inverse[1]) + ay * ((1 - ax) * inverse[2] + ax * inverse[3]));
  }

  const std::shared_ptr<const OpenFolder> open_;
  const PairStep step_;
  const std::vector<int> firsts_;
};

}  // namespace

std::string_view PairStepName(PairStep step) { return step == PairStep::kKeys ? "key to key" : "frame to frame"; }

std::vector<std::unique_ptr<MotionPairs>> ScenePairs(const SyntheticSequence& clip, int frames_per_key, int most,
                                                     int threads) {
  const Sequence& sequence = clip.sequence();
  std::vector<std::unique_ptr<MotionPairs>> pairs;
  pairs.push_back(std::make_unique<OfScene>(clip, PairStep::kKeys, frames_per_key,
                                            Spread(static_cast<int>(sequence.depth.size()) - 1, most), threads));
  pairs.push_back(std::make_unique<OfScene>(clip, PairStep::kFrames, frames_per_key,
                                            Spread(static_cast<int>(sequence.color.size()) - 1, most), threads));
  return pairs;
}

absl::StatusOr<std::vector<std::unique_ptr<MotionPairs>>> FolderPairs(const std::string& dir, int most) {
  auto open = std::make_shared<OpenFolder>();
  ASSIGN_OR_RETURN(open->folder, SequenceFolder::Open(dir));
  if (const std::string path = open->Path("camera_second.json"); FileExists(path)) {
    ASSIGN_OR_RETURN(const std::string text, ReadFile(path));
    const absl::StatusOr<CameraFile> second = ParseCameraJson(text);
    if (!second.ok()) return WithContext(second.status(), path);
    open->second_camera = second->camera;
  }
  const Sequence& sequence = open->sequence();
  const int keys = static_cast<int>(sequence.depth.size()), frames = static_cast<int>(sequence.color.size());
  std::vector<int> with_motion, with_flow, without;
  for (int k = 0; k + 1 < keys; ++k) {
    without.push_back(k);
    if (FileExists(open->Path(
            absl::StrCat("gt/sceneflow_key/", sequence.depth[k].Stem(), "_", sequence.depth[k + 1].Stem(), ".npz"))))
      with_motion.push_back(k);
  }
  for (int c = 0; c + 1 < frames; ++c)
    if (GroundTruthDepthPath(dir, sequence.color[c].Stem()) &&
        GroundTruthDepthPath(dir, sequence.color[c + 1].Stem()) &&
        FileExists(open->Path("gt/flow/" + sequence.color[c].Stem() + ".png")))
      with_flow.push_back(c);
  std::vector<std::unique_ptr<MotionPairs>> pairs;
  const auto add = [&](PairStep step, const std::vector<int>& firsts) {
    if (firsts.empty()) return;
    std::vector<int> chosen;
    for (const int i : Spread(static_cast<int>(firsts.size()), most)) chosen.push_back(firsts[i]);
    pairs.push_back(std::make_unique<OfFolder>(open, step, std::move(chosen)));
  };
  add(PairStep::kKeys, with_motion);
  add(PairStep::kFrames, with_flow);
  if (pairs.empty()) add(PairStep::kKeys, without);
  if (pairs.empty())
    return absl::FailedPreconditionError(
        absl::StrFormat("%s has fewer than two depth maps, so nothing moves from one to the next", dir));
  return pairs;
}

}  // namespace depthtween
