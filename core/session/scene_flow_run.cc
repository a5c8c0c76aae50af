#include "core/session/scene_flow_run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/io/file.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/sequence/clock.h"
#include "core/session/clear_output.h"
#include "core/session/scene_flow_files.h"
#include "core/session/scene_flow_picture.h"

namespace depthtween {
namespace {

using nlohmann::json;

constexpr int kPicturedPairs = 3;
constexpr size_t kNamedFrames = 10;

// The depth frame of each colour frame: the nearest in time, at most half a colour frame away.
absl::StatusOr<std::vector<int>> DepthOfColor(const Sequence& sequence) {
  const int64_t tolerance_ns = std::max<int64_t>(MedianPeriodNs(sequence.color) / 2, 1);
  std::vector<int> depth_of;
  std::vector<std::string> without;
  for (const FrameRef& color : sequence.color) {
    const auto nearest =
        std::min_element(sequence.depth.begin(), sequence.depth.end(), [&](const FrameRef& a, const FrameRef& b) {
          return std::llabs(a.time_ns - color.time_ns) < std::llabs(b.time_ns - color.time_ns);
        });
    depth_of.push_back(static_cast<int>(nearest - sequence.depth.begin()));
    if (std::llabs(nearest->time_ns - color.time_ns) > tolerance_ns) without.push_back(color.path);
  }
  if (without.empty()) return depth_of;
  const size_t lacking = without.size();
  without.resize(std::min(lacking, kNamedFrames));
  return absl::FailedPreconditionError(absl::StrFormat(
      "colour and depth are not at the same rate: %d of %d colour frames have no depth within half a frame (%.1f ms): "
      "%s%s. Upsample the recording instead, which gives scene flow too: depthtween-core upsample SEQ -o OUT "
      "--scene-flow, or depthtween submit SEQ --scene-flow",
      lacking, sequence.color.size(), 1e-6 * static_cast<double>(tolerance_ns), absl::StrJoin(without, ", "),
      lacking > kNamedFrames ? ", ..." : ""));
}

PairSummary Summarise(const SceneFlow& flow) {
  std::vector<float> lengths;
  int64_t hidden = 0;
  for (size_t i = 0; i < flow.confidence.pixel_count(); ++i) {
    if (!(flow.confidence.data()[i] > 0.0F)) continue;
    const Float3 m = flow.motion_m.data()[i];
    lengths.push_back(std::sqrt(m.x * m.x + m.y * m.y + m.z * m.z));
    hidden += flow.hidden.data()[i] != 0 ? 1 : 0;
  }
  PairSummary summary;
  if (lengths.empty()) return summary;
  const auto middle = lengths.begin() + static_cast<ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  summary.median_m = *middle;
  summary.hidden_share = static_cast<double>(hidden) / static_cast<double>(lengths.size());
  summary.answered_share = static_cast<double>(lengths.size()) / static_cast<double>(flow.confidence.pixel_count());
  return summary;
}

// One scale for all columns: colour, flow, depth change.
Image<Rgb8> DrawPicture(const std::vector<PicturedPair>& columns) {
  const auto view = [](const PicturedPair& column) {
    return MotionField{column.flow_px, column.motion_m, column.valid};
  };
  MotionRange range;
  for (const PicturedPair& column : columns) {
    const MotionRange own = RangeOf(view(column));
    range = {std::max(range.full_px, own.full_px), std::max(range.full_m, own.full_m)};
  }
  std::vector<std::vector<Image<Rgb8>>> rows(3);
  for (const PicturedPair& column : columns) {
    rows[0].push_back(column.color.Clone());
    rows[1].push_back(ColorizeFlow(view(column), range.full_px));
    rows[2].push_back(ColorizeDepthChange(view(column), range.full_m));
  }
  return Tile(rows);
}

}  // namespace

absl::StatusOr<std::vector<FramePair>> PlanPairs(const Sequence& sequence, int every) {
  ASSIGN_OR_RETURN(const std::vector<int> depth_of, DepthOfColor(sequence));
  std::vector<FramePair> pairs;
  const int count = static_cast<int>(sequence.color.size());
  for (int from = 0; from < count - every; from += every)
    pairs.push_back({from, from + every, depth_of[from], depth_of[from + every]});
  if (pairs.empty())
    return absl::FailedPreconditionError(absl::StrFormat(
        "the recording has %d colour frame%s, must have at least %d: nothing moves from one to the %d. after it", count,
        count == 1 ? "" : "s", every + 1, every));
  return pairs;
}

json PairsToJson(const std::vector<FramePair>& pairs, const Sequence& sequence) {
  json intervals = json::array(), frames = json::array();
  for (size_t i = 0; i < pairs.size(); ++i) {
    const FrameRef& color = sequence.color[pairs[i].from];
    intervals.push_back({{"index", i}, {"first_frame", i}, {"frame_count", 1}, {"held", false}});
    frames.push_back({{"index", i}, {"time_ns", color.time_ns}, {"stem", color.Stem()}});
  }
  return {{"intervals", std::move(intervals)}, {"frames", std::move(frames)}};
}

json ToJson(const PairSummary& summary) {
  return {{"from", summary.from},
          {"to", summary.to},
          {"seconds", summary.seconds},
          {"median_motion_m", summary.median_m},
          {"hidden_share", summary.hidden_share},
          {"answered_share", summary.answered_share}};
}

absl::StatusOr<PairSummary> ParsePairSummary(std::string_view text) {
  try {
    const json value = json::parse(text);
    return PairSummary{.from = value.at("from"),
                       .to = value.at("to"),
                       .seconds = value.at("seconds"),
                       .median_m = value.at("median_motion_m"),
                       .hidden_share = value.at("hidden_share"),
                       .answered_share = value.at("answered_share")};
  } catch (const json::exception& error) {
    return absl::DataLossError(absl::StrCat("report of a pair: ", error.what()));
  }
}

std::vector<int> PairsToPicture(int count) {
  std::vector<int> pairs;
  for (int i = 0; i < count; ++i)
    if (i * kPicturedPairs / count == static_cast<int>(pairs.size())) pairs.push_back(i);
  return pairs;
}

absl::StatusOr<ComputedPair> ComputePair(const SequenceFolder& recording, const FramePair& pair,
                                         const SceneFlowOrder& order, std::stop_token stop, const std::string& dir,
                                         const std::function<void()>& on_item) {
  const Sequence& sequence = recording.sequence();
  const FrameRef &first = sequence.color[pair.from], &second = sequence.color[pair.to];
  ASSIGN_OR_RETURN(Image<Rgb8> from, recording.Color(pair.from));
  ASSIGN_OR_RETURN(const Image<Rgb8> to, recording.Color(pair.to));
  ASSIGN_OR_RETURN(const Image<float> from_m, recording.Depth(pair.from_depth));
  ASSIGN_OR_RETURN(const Image<float> to_m, recording.Depth(pair.to_depth));
  const SceneFlowOptions options{
      .method = order.method, .threads = order.threads, .stop = std::move(stop), .on_item = on_item};
  const auto start = std::chrono::steady_clock::now();
  absl::StatusOr<SceneFlow> flow = EstimateSceneFlow(sequence.camera, {from, from_m}, {to, to_m}, options);
  if (!flow.ok()) return WithContext(flow.status(), absl::StrCat(first.path, " to ", second.path));
  ComputedPair computed{.summary = Summarise(*flow)};
  computed.summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  computed.summary.from = first.path;
  computed.summary.to = second.path;
  RETURN_IF_ERROR(WriteSceneFlow(dir, first.Stem(), order.formats, sequence.camera, order.baseline_m, *flow));
  Image<uint8_t> valid(from.width(), from.height());
  for (size_t i = 0; i < valid.pixel_count(); ++i) valid.data()[i] = flow->confidence.data()[i] > 0.0F ? 1 : 0;
  computed.picture = {std::move(from), std::move(flow->flow_px), std::move(flow->motion_m), std::move(valid)};
  return computed;
}

absl::StatusOr<PicturedPair> ReadPicture(const SequenceFolder& recording, const FramePair& pair,
                                         const std::string& dir) {
  const std::string path = JoinPath(dir, SceneFlowNpzName(recording.sequence().color[pair.from].Stem()));
  PicturedPair picture;
  ASSIGN_OR_RETURN(picture.color, recording.Color(pair.from));
  ASSIGN_OR_RETURN(const Npz arrays, ReadNpz(path));
  const int width = picture.color.width(), height = picture.color.height();
  const size_t count = picture.color.pixel_count();
  const auto values = [&](const char* name, size_t per_pixel) -> absl::StatusOr<std::vector<float>> {
    const auto found = arrays.find(name);
    if (found == arrays.end() || found->second.element_count() != static_cast<int64_t>(per_pixel * count))
      return absl::DataLossError(absl::StrFormat("%s: has no '%s' of %d x %d pixels", path, name, width, height));
    return found->second.ToFloats();
  };
  ASSIGN_OR_RETURN(const std::vector<float> flow, values("flow", 2));
  ASSIGN_OR_RETURN(const std::vector<float> motion, values("motion", 3));
  ASSIGN_OR_RETURN(const std::vector<float> confidence, values("confidence", 1));
  picture.flow_px = Image<Flow2>(width, height);
  picture.motion_m = Image<Float3>(width, height);
  picture.valid = Image<uint8_t>(width, height);
  for (size_t i = 0; i < count; ++i) {
    picture.flow_px.data()[i] = {flow[2 * i], flow[2 * i + 1]};
    picture.motion_m.data()[i] = {motion[3 * i], motion[3 * i + 1], motion[3 * i + 2]};
    picture.valid.data()[i] = confidence[i] > 0.0F ? 1 : 0;
  }
  return picture;
}

absl::StatusOr<json> FinishSceneFlow(const SceneFlowOrder& order, const std::string& dir,
                                     const std::vector<PairSummary>& pairs, const std::vector<PicturedPair>& pictured) {
  ASSIGN_OR_RETURN(const std::string picture, EncodePngRgb8(DrawPicture(pictured)));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, "preview.png"), picture));
  json report = {{"method", order.method},
                 {"formats", order.formats},
                 {"kitti_baseline_m", order.baseline_m},
                 {"every", order.every},
                 {"pairs", json::array()}};
  for (const PairSummary& pair : pairs) report["pairs"].push_back(ToJson(pair));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, "report.json"),
                                   report.dump(1, ' ', false, json::error_handler_t::replace) + "\n"));
  return report;
}

absl::StatusOr<json> ComputeSceneFlow(const SequenceFolder& recording, const SceneFlowOrder& order,
                                      const std::string& out, bool force, std::stop_token stop,
                                      const std::function<void(int, int)>& on_pair) {
  ASSIGN_OR_RETURN(const std::vector<FramePair> pairs, PlanPairs(recording.sequence(), order.every));
  RETURN_IF_ERROR(
      ClearResult(out, force, {"report.json", "preview.png", "sceneflow", "flow", "depth_change", "kitti"}));
  RETURN_IF_ERROR(MakeSceneFlowFolders(out, order.formats));
  const int count = static_cast<int>(pairs.size());
  const std::vector<int> to_picture = PairsToPicture(count);
  std::vector<PairSummary> summaries;
  std::vector<PicturedPair> pictured;
  for (int i = 0; i < count; ++i) {
    on_pair(i, count);
    ASSIGN_OR_RETURN(ComputedPair computed, ComputePair(recording, pairs[i], order, stop, out));
    summaries.push_back(std::move(computed.summary));
    if (std::binary_search(to_picture.begin(), to_picture.end(), i)) pictured.push_back(std::move(computed.picture));
  }
  return FinishSceneFlow(order, out, summaries, pictured);
}

}  // namespace depthtween
