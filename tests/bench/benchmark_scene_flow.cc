#include "tests/bench/benchmark_scene_flow.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "core/metrics/regions.h"
#include "core/sceneflow/scene_flow.h"
#include "core/session/scene_flow_picture.h"

namespace depthtween {
namespace {

// Errors of at least this share of what moves show in full colour, and of at least this many metres.
constexpr float kErrorShownShare = 0.5F, kErrorShownM = 0.02F;

// An answer as the metrics read it.
struct Answer {
  SceneFlow flow;
  Image<uint8_t> valid;
  MotionField View() const { return {flow.flow_px, flow.motion_m, valid}; }
};

Answer AnswerOf(SceneFlow flow) {
  Answer answer{std::move(flow), {}};
  answer.valid = Image<uint8_t>(answer.flow.confidence.width(), answer.flow.confidence.height());
  for (size_t i = 0; i < answer.valid.pixel_count(); ++i)
    answer.valid.data()[i] = answer.flow.confidence.data()[i] > 0.0F ? 1 : 0;
  return answer;
}

Image<Rgb8> DrawStrip(const MotionPair& pair, std::span<const Answer> answers) {
  const MotionField reference = pair.has_truth ? pair.Truth().motion : answers[0].View();
  const MotionRange range = RangeOf(reference);
  std::vector<std::vector<Image<Rgb8>>> rows(pair.has_truth ? 4 : 3);
  const auto blank = [&] { return Image<Rgb8>(pair.from_color.width(), pair.from_color.height(), {255, 255, 255}); };
  rows[0].push_back(pair.from_color.Clone());
  rows[0].push_back(pair.to_color.Clone());
  if (pair.has_truth) {
    rows[0].push_back(ColorizeFlow(reference, range.full_px));
    rows[0].push_back(ColorizeDepthChange(reference, range.full_m));
  }
  for (const Answer& answer : answers) {
    rows[1].push_back(ColorizeFlow(answer.View(), range.full_px));
    rows[2].push_back(ColorizeDepthChange(answer.View(), range.full_m));
    if (pair.has_truth)
      rows[3].push_back(
          ColorizeMotionError(answer.View(), reference, std::max(kErrorShownShare * range.full_m, kErrorShownM)));
  }
  size_t columns = 0;
  for (const auto& row : rows) columns = std::max(columns, row.size());
  for (auto& row : rows)
    while (row.size() < columns) row.push_back(blank());
  return Tile(rows);
}

}  // namespace

absl::StatusOr<SceneFlowBenchmark> BenchmarkSceneFlow(const MotionPairs& pairs,
                                                      const SceneFlowBenchmarkOptions& options) {
  SceneFlowBenchmark result{.step = pairs.step(), .pairs = pairs.count()};
  result.seconds.assign(options.methods.size(), 0.0);
  SceneFlowComparison comparison(options.methods);
  bool has_truth = false;
  for (const std::string& name : options.methods) result.transfer.push_back({.name = name});
  for (int i = 0; i < pairs.count(); ++i) {
    if (options.on_pair) options.on_pair(i, pairs.count());
    ASSIGN_OR_RETURN(const MotionPair pair, pairs.Read(i));
    std::vector<Answer> answers;
    std::vector<MotionField> fields;
    for (size_t m = 0; m < options.methods.size(); ++m) {
      const auto start = std::chrono::steady_clock::now();
      ASSIGN_OR_RETURN(SceneFlow flow,
                       EstimateSceneFlow(pairs.camera(), {pair.from_color, pair.from_m}, {pair.to_color, pair.to_m},
                                         {.method = options.methods[m],
                                          .to_camera = pair.to_camera,
                                          .threads = options.threads,
                                          .stop = options.stop}));
      const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
      result.seconds[m] += took.count() / pairs.count();
      answers.push_back(AnswerOf(std::move(flow)));
    }
    for (const Answer& answer : answers) fields.push_back(answer.View());
    if (i == pairs.count() / 2) result.strip = DrawStrip(pair, answers);
    if (pair.has_truth) {
      has_truth = true;
      comparison.Add(pair.Truth(), fields, kFarthestTruthM);
      continue;
    }
    const std::vector<TransferScore> scores =
        ScoreTransfer({pair.from_color, pair.from_m}, {pair.to_color, pair.to_m}, options.methods, fields);
    for (size_t m = 0; m < scores.size(); ++m) {
      TransferScore& sum = result.transfer[m];
      const auto pixels = static_cast<double>(scores[m].pixels);
      sum.pixels += scores[m].pixels;
      sum.depth_error += pixels * scores[m].depth_error;
      sum.depth_outliers += pixels * scores[m].depth_outliers;
      sum.color_error += pixels * scores[m].color_error;
      sum.coverage += scores[m].coverage / pairs.count();
    }
  }
  if (has_truth) {
    result.scores = comparison.Scores();
    result.transfer.clear();
  }
  for (TransferScore& mean : result.transfer) {
    const auto pixels = static_cast<double>(std::max<int64_t>(mean.pixels, 1));
    mean.depth_error /= pixels;
    mean.depth_outliers /= pixels;
    mean.color_error /= pixels;
  }
  return result;
}

}  // namespace depthtween
