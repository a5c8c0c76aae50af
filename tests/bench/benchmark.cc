#include "tests/bench/benchmark.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <opencv2/video/tracking.hpp>
#include <set>
#include <span>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/base/parallel.h"
#include "core/baselines/baselines.h"
#include "core/flow/dense_flow.h"
#include "core/sceneflow/scene_flow.h"
#include "core/sequence/sequence.h"
#include "core/session/clip_truth.h"
#include "core/session/preview.h"
#include "core/session/upsample_run.h"
#include "core/synthetic/synthetic_sequence.h"
#include "core/upsample/pipeline.h"
#include "tests/bench/parameters.h"

namespace depthtween {
namespace {

namespace fs = std::filesystem;

constexpr int kLongestRatio = 4;     // times as many colour frames per depth frame
constexpr int kRatioClipLength = 3;  // times as long: with 33 frames 12 intervals, which 1, 2, 3 and 4 divide
constexpr int kUsualRatio = 8;       // colour frames per depth frame: 240 over 30 fps
constexpr int kFewestKeys = 5;
constexpr int kMotionPairs = 4;                 // of each kind and clip, for the table sceneflow
constexpr char kRatioBaseline[] = "flow-warp";  // the strongest of the baselines
// What a strip shows beside ours, of what was run: the strongest baseline, and the one that the paper compares with.
constexpr const char* kStripBaselines[] = {"flow-warp", "dolson"};
constexpr int kStripFrames = 3;
// The parts that look for better motion than the flow's; the others settle depth.
constexpr const char* kBetterMotion[] = {"recover", "thin", "draw", "solve", "propagation"};
constexpr char kTimedScene[] = "kick";
constexpr int kTimedFrames = 17;  // two intervals: the one timed has a depth frame beyond it to settle keys by
constexpr int kYardstickFlows = 16;

absl::Status Unknown(const char* field, const std::string& name, const std::vector<std::string>& known) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s '%s' is not known: there are %s", field, name, absl::StrJoin(known, ", ")));
}

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// One of the methods of a table, and what owns it.
struct Variant {
  std::string name;
  std::unique_ptr<Upsampler> upsampler;
  bool is_baseline = false;
};

// A folder that goes when this goes.
class TemporaryFolder {
 public:
  static absl::StatusOr<TemporaryFolder> Make() {
    std::error_code error;
    std::string path = (fs::temp_directory_path(error) / "depthtween-benchmark-XXXXXX").string();
    if (error || mkdtemp(path.data()) == nullptr)
      return ErrnoStatus(error ? error.value() : errno, "making a temporary folder " + path);
    return TemporaryFolder(std::move(path));
  }
  TemporaryFolder(TemporaryFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;
  ~TemporaryFolder() {
    std::error_code ignored;  // what cannot be removed is left to the system
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  const std::string& path() const { return path_; }

 private:
  explicit TemporaryFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

struct SequenceSpec {
  std::string dir;
  int key_every = 0;  // 0: not said
};

absl::StatusOr<SequenceSpec> ParseSequence(const std::string& text) {
  const size_t colon = text.rfind(':');
  if (colon == std::string::npos || fs::exists(text)) return SequenceSpec{.dir = text};
  SequenceSpec spec{.dir = text.substr(0, colon)};
  if (!absl::SimpleAtoi(text.substr(colon + 1), &spec.key_every) || spec.key_every < 1 || spec.key_every > 1'000'000)
    return absl::InvalidArgumentError(absl::StrFormat(
        "sequence '%s': what follows the colon must be a number from 1 to 1000000, such as recording:8 to keep every "
        "8th depth map",
        text));
  return spec;
}

Image<float> Copy(ImageView<const float> view) {
  Image<float> copy(view.width(), view.height());
  for (int y = 0; y < view.height(); ++y) std::copy_n(view.row(y), view.width(), copy.row(y));
  return copy;
}

// kStripFrames of `frames`, spread over the clip, each the nearest to the middle of an interval: there errors are
// largest.
std::set<int> MidIntervalFrames(const Sequence& keys, const std::vector<int>& frames) {
  std::vector<int> middles;
  for (const Interval& interval : PlanIntervals(keys))
    if (!interval.Held()) middles.push_back(interval.first_frame + interval.frame_count / 2);
  std::set<int> chosen;
  for (size_t i = 0; i < kStripFrames && !middles.empty(); ++i) {
    const int middle = middles[(2 * i + 1) * middles.size() / (2 * kStripFrames)];
    const auto nearest = std::min_element(frames.begin(), frames.end(),
                                          [&](int a, int b) { return std::abs(a - middle) < std::abs(b - middle); });
    if (nearest != frames.end()) chosen.insert(*nearest);
  }
  return chosen;
}

// Gathers what a strip shows while frames are scored.
struct StripMaker {
  std::vector<std::string> methods;
  std::vector<size_t> method_indices;  // into the methods scored
  std::set<int> frames;
  PreviewRange range;
  std::vector<StripFrame> gathered;

  void Look(const Sequence& sequence, const TruthFrame& truth, std::span<const MethodFrame> estimates) {
    if (!frames.contains(truth.color_index)) return;
    StripFrame frame{.index = truth.color_index,
                     .time_ns = sequence.color[truth.color_index].time_ns - sequence.color[0].time_ns,
                     .color = Image<Rgb8>(truth.color.width(), truth.color.height()),
                     .truth_m = Copy(truth.depth_m)};
    for (int y = 0; y < truth.color.height(); ++y)
      std::copy_n(truth.color.row(y), truth.color.width(), frame.color.row(y));
    for (const size_t m : method_indices) frame.estimates_m.push_back(Copy(estimates[m].depth_m));
    gathered.push_back(std::move(frame));
  }
};

// The colour frames at which the recording has keys.
std::vector<int> KeyFrames(const Sequence& keys) {
  std::vector<int> frames;
  for (const FrameRef& key : keys.depth) frames.push_back(NearestColorFrame(keys, key.time_ns));
  return frames;
}

bool HasTruth(const SequenceFolder& folder) {
  const auto truth = ClipTruth::Open(folder, {}, 1);
  return truth.ok() && !truth->IsLeftOutDepth();
}

// Halves the ratio until there are enough keys.
int UsualKeyEvery(const Sequence& sequence) {
  const double color_per_depth =
      static_cast<double>(sequence.color.size()) / static_cast<double>(std::max<size_t>(sequence.depth.size(), 1));
  int every = std::max(2, static_cast<int>(std::lround(kUsualRatio / color_per_depth)));
  while (every > 2 && (static_cast<int>(sequence.depth.size()) - 1) / every + 1 < kFewestKeys) every /= 2;
  return every;
}

class Run {
 public:
  Run(const BenchmarkOptions& options, const std::function<absl::Status(const Benchmark&)>& on_clip)
      : options_(options), on_clip_(on_clip) {}

  absl::StatusOr<Benchmark> All() {
    if (Wants("time")) {
      RETURN_IF_ERROR(WithContext(Times(), "table time"));
      RETURN_IF_ERROR(Tell());
    }
    for (const std::string& scene : options_.scenes) RETURN_IF_ERROR(WithContext(Scene(scene), "scene " + scene));
    for (const std::string& sequence : options_.sequences) RETURN_IF_ERROR(WithContext(Folder(sequence), sequence));
    return std::move(benchmark_);
  }

 private:
  bool Wants(const std::string& table) const { return Contains(options_.tables, table); }
  bool WantsShortClip() const { return Wants("depth") || Wants("ablation") || Wants("parameters"); }
  absl::Status Tell() { return on_clip_ ? on_clip_(benchmark_) : absl::OkStatus(); }

  std::function<void(int, int)> Counter(const std::string& what) const {
    return [this, what](int done, int total) {
      if (options_.on_progress) options_.on_progress(what, done, total);
    };
  }

  absl::Status Scene(const std::string& scene) {
    ClipBenchmark clip{.name = scene, .kind = ClipKind::kScene};
    const auto on_folder = [&](int frames, const auto& body) -> absl::Status {
      ASSIGN_OR_RETURN(const TemporaryFolder temporary, TemporaryFolder::Make());
      const std::string dir = (fs::path(temporary.path()) / scene).string();
      RETURN_IF_ERROR(WriteSyntheticSequence(
          {.scene = scene, .frames = frames, .width = options_.width, .height = options_.height}, dir,
          {.threads = options_.threads, .stop = options_.stop, .on_progress = Counter(scene + ", rendered: files")}));
      ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(dir));
      return body(*folder);
    };
    if (WantsShortClip())
      RETURN_IF_ERROR(
          on_folder(options_.frames, [&](const SequenceFolder& folder) { return ShortTables(folder, clip); }));
    if (Wants("sceneflow")) RETURN_IF_ERROR(SceneFlowOfScene(scene, clip));
    if (Wants("ratio"))
      RETURN_IF_ERROR(on_folder(kRatioClipLength * (options_.frames - 1) + 1,
                                [&](const SequenceFolder& folder) { return Ratios(folder, clip); }));
    return Finish(std::move(clip));
  }

  absl::Status Folder(const std::string& text) {
    if (!WantsShortClip() && !Wants("ratio") && !Wants("sceneflow")) return absl::OkStatus();
    ASSIGN_OR_RETURN(const SequenceSpec spec, ParseSequence(text));
    ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> folder, SequenceFolder::Open(spec.dir));
    const bool has_truth = HasTruth(*folder);
    ClipBenchmark clip{.name = fs::absolute(spec.dir).lexically_normal().filename().string(),
                       .kind = has_truth ? ClipKind::kRendered : ClipKind::kReal,
                       .key_every = spec.key_every > 0 ? spec.key_every
                                    : has_truth        ? 1
                                                       : UsualKeyEvery(folder->sequence())};
    if (clip.name.empty()) clip.name = fs::absolute(spec.dir).lexically_normal().parent_path().filename().string();
    if (clip.key_every > 1 && (WantsShortClip() || Wants("ratio"))) absl::StrAppend(&clip.name, ":", clip.key_every);
    if (WantsShortClip()) RETURN_IF_ERROR(ShortTables(*folder, clip));
    if (Wants("ratio")) RETURN_IF_ERROR(Ratios(*folder, clip));
    if (Wants("sceneflow")) {
      ASSIGN_OR_RETURN(const auto pairs, FolderPairs(spec.dir, kMotionPairs));
      RETURN_IF_ERROR(MotionTables(pairs, clip));
    }
    return Finish(std::move(clip));
  }

  absl::Status Finish(ClipBenchmark clip) {
    if (!clip.depth && !clip.ablation && clip.parameters.empty() && clip.ratios.empty() && clip.scene_flow.empty())
      return absl::OkStatus();
    const std::string name = clip.name;
    const auto taken = [&] {
      return std::any_of(benchmark_.clips.begin(), benchmark_.clips.end(),
                         [&](const ClipBenchmark& other) { return other.name == clip.name; });
    };
    for (int copy = 2; taken(); ++copy) clip.name = absl::StrFormat("%s (%d)", name, copy);
    benchmark_.clips.push_back(std::move(clip));
    return Tell();
  }

  absl::Status ShortTables(const SequenceFolder& folder, ClipBenchmark& clip) {
    if (Wants("depth")) RETURN_IF_ERROR(Depth(folder, clip));
    if (Wants("ablation")) RETURN_IF_ERROR(Ablation(folder, clip));
    if (Wants("parameters")) RETURN_IF_ERROR(Parameters(folder, clip));
    return absl::OkStatus();
  }

  PipelineOptions Preset() const { return *PipelineOptions::ForPreset(options_.preset); }  // Validate has seen it

  absl::StatusOr<ClipScores> Score(const SequenceFolder& folder, int key_every, const std::vector<Variant>& variants,
                                   const std::string& what, const std::function<bool(int)>& keep = nullptr,
                                   StripMaker* strip = nullptr) const {
    ASSIGN_OR_RETURN(const ClipPlan plan, PrepareClip(folder, {.key_every = key_every, .threads = options_.threads}));
    ASSIGN_OR_RETURN(ClipTruth truth, ClipTruth::Open(folder, plan.alignment, key_every));
    if (keep) truth.Keep(keep);
    if (strip != nullptr) {
      strip->frames = MidIntervalFrames(InputOf(folder.sequence(), plan.alignment.clock, key_every), truth.Frames());
      strip->range = {.near_m = static_cast<float>(plan.constants.preview_near_m),
                      .far_m = static_cast<float>(plan.constants.preview_far_m)};
    }
    std::vector<ScoredMethod> methods;
    for (const Variant& variant : variants)
      methods.push_back({.name = variant.name,
                         .upsampler = variant.upsampler.get(),
                         .any_frame = variant.is_baseline,
                         .predicts_sigma = &variant == variants.data()});
    return ScoreMethods(folder, std::move(truth), methods,
                        {.alignment = plan.alignment,
                         .key_every = key_every,
                         .constants = plan.constants,
                         .threads = options_.threads,
                         .stop = options_.stop,
                         .on_frame = Counter(what + ": frames"),
                         .on_scored = [&](const TruthFrame& frame, std::span<const MethodFrame> estimates) {
                           if (strip != nullptr) strip->Look(folder.sequence(), frame, estimates);
                         }});
  }

  std::vector<Variant> Ours() const {
    std::vector<Variant> variants;
    variants.push_back({.name = "ours", .upsampler = MakePipeline(Preset())});
    return variants;
  }

  absl::Status AddBaseline(const std::string& name, std::vector<Variant>& variants) const {
    ASSIGN_OR_RETURN(std::unique_ptr<Upsampler> baseline, MakeBaseline(name));
    variants.push_back({.name = name, .upsampler = std::move(baseline), .is_baseline = true});
    return absl::OkStatus();
  }

  absl::Status Depth(const SequenceFolder& folder, ClipBenchmark& clip) const {
    std::vector<Variant> variants = Ours();
    for (const std::string& name : options_.baselines) RETURN_IF_ERROR(AddBaseline(name, variants));
    StripMaker strip{.methods = {"ours"}, .method_indices = {0}};
    for (size_t m = 1; m < variants.size(); ++m)
      if (std::find(std::begin(kStripBaselines), std::end(kStripBaselines), variants[m].name) !=
          std::end(kStripBaselines)) {
        strip.methods.push_back(variants[m].name);
        strip.method_indices.push_back(m);
      }
    ASSIGN_OR_RETURN(clip.depth, Score(folder, clip.key_every, variants, clip.name + ", depth", nullptr, &strip));
    if (!strip.gathered.empty()) clip.strip = DrawErrorStrip(strip.gathered, strip.methods, strip.range);
    return absl::OkStatus();
  }

  absl::Status Ablation(const SequenceFolder& folder, ClipBenchmark& clip) const {
    std::vector<Variant> variants = Ours();
    for (const std::string& part : PartNames()) {
      PipelineOptions without = Preset();
      if (!without.Uses(part)) continue;
      RETURN_IF_ERROR(without.SwitchOff(part));
      variants.push_back({.name = part, .upsampler = MakePipeline(without)});
    }
    // What is left with the flow's motion alone.
    PipelineOptions flow_alone = Preset();
    std::vector<std::string> left_out;
    for (const char* part : kBetterMotion) {
      if (!flow_alone.Uses(part)) continue;
      RETURN_IF_ERROR(flow_alone.SwitchOff(part));
      left_out.emplace_back(part);
    }
    if (left_out.size() > 1)
      variants.push_back({.name = absl::StrJoin(left_out, " + "), .upsampler = MakePipeline(flow_alone)});
    ASSIGN_OR_RETURN(clip.ablation, Score(folder, clip.key_every, variants, clip.name + ", ablation"));
    return absl::OkStatus();
  }

  absl::Status Parameters(const SequenceFolder& folder, ClipBenchmark& clip) const {
    for (const PipelineParameter& parameter : PipelineParameters()) {
      std::vector<Variant> variants;
      for (const double value : parameter.studied) {
        PipelineOptions changed = Preset();
        parameter.set(changed, value);
        variants.push_back({.name = absl::StrFormat("%g", value), .upsampler = MakePipeline(changed)});
      }
      const std::string name(parameter.name);
      ASSIGN_OR_RETURN(const ClipScores scores,
                       Score(folder, clip.key_every, variants, absl::StrCat(clip.name, ", ", name)));
      ClipBenchmark::Parameter& added =
          clip.parameters.emplace_back(ClipBenchmark::Parameter{.name = name, .preset_value = parameter.get(Preset())});
      for (size_t i = 0; i < variants.size(); ++i)
        added.scores.emplace_back(parameter.studied[i], scores.score.methods[i]);
    }
    return absl::OkStatus();
  }

  // All ratios are scored on the same frames: those that no ratio has a key at and all have keys around.
  absl::Status Ratios(const SequenceFolder& folder, ClipBenchmark& clip) const {
    const std::vector<int> keys = KeyFrames(InputOf(folder.sequence(), {}, clip.key_every));
    const int last = static_cast<int>(keys.size()) - 1;
    std::vector<int> factors;
    int end = keys.back();
    for (int factor = 1; factor <= kLongestRatio; ++factor) {
      const int last_kept = last / factor * factor;
      if (2 * last_kept < last || last_kept == 0) break;  // would leave too little of the clip for all
      factors.push_back(factor);
      end = std::min(end, keys[last_kept]);
    }
    const std::set<int> at_keys(keys.begin(), keys.end());
    const auto keep = [&](int frame) { return frame < end && !at_keys.contains(frame); };
    std::vector<Variant> variants = Ours();
    RETURN_IF_ERROR(AddBaseline(kRatioBaseline, variants));
    for (const int factor : factors) {
      if (factors.size() < 2) break;  // nothing to compare
      const int color_per_depth = (keys[factor] - keys[0]);
      ASSIGN_OR_RETURN(ClipScores scores, Score(folder, clip.key_every * factor, variants,
                                                absl::StrFormat("%s, ratio %d", clip.name, color_per_depth), keep));
      if (scores.score.common_pixels == 0) continue;
      clip.ratios.push_back({.color_per_depth = color_per_depth, .scores = std::move(scores)});
    }
    return absl::OkStatus();
  }

  absl::Status Times() {
    ASSIGN_OR_RETURN(
        const auto rendered,
        SyntheticSequence::Create(
            {.scene = kTimedScene, .frames = kTimedFrames, .width = options_.width, .height = options_.height},
            options_.threads));
    std::vector<Image<Rgb8>> color;
    std::vector<Image<float>> depth;
    std::vector<Image<uint8_t>> luma;
    const auto count = Counter("time, rendered: frames");
    for (int i = 0; i < static_cast<int>(rendered->sequence().color.size()); ++i) {
      if (options_.stop.stop_requested()) return absl::CancelledError("stopped on request");
      count(i, kTimedFrames);
      ASSIGN_OR_RETURN(color.emplace_back(), rendered->Color(i));
      luma.push_back(Luma(color.back()));
    }
    for (int k = 0; k < static_cast<int>(rendered->sequence().depth.size()); ++k) {
      ASSIGN_OR_RETURN(depth.emplace_back(), rendered->Depth(k));
    }
    const MemorySource source(rendered->sequence(), std::move(color), std::move(depth));
    ASSIGN_OR_RETURN(const ClipConstants constants, EstimateClipConstants(source));
    const Interval interval = PlanIntervals(source.sequence())[0];
    benchmark_.timed_width = options_.width;
    benchmark_.timed_height = options_.height;
    for (const std::string& preset : PresetNames())
      for (const int threads : {1, 2}) {
        ASSIGN_OR_RETURN(benchmark_.times.emplace_back(), Time(source, constants, interval, luma, preset, threads));
      }
    return absl::OkStatus();
  }

  absl::Status SceneFlowOfScene(const std::string& scene, ClipBenchmark& clip) const {
    ASSIGN_OR_RETURN(
        const std::unique_ptr<SyntheticSequence> rendered,
        SyntheticSequence::Create(
            {.scene = scene, .frames = options_.frames, .width = options_.width, .height = options_.height},
            options_.threads));
    return MotionTables(ScenePairs(*rendered, kUsualRatio, kMotionPairs, options_.threads), clip);
  }

  absl::Status MotionTables(const std::vector<std::unique_ptr<MotionPairs>>& kinds, ClipBenchmark& clip) const {
    std::vector<std::string> methods = SceneFlowMethods();
    if (options_.baselines.empty()) methods.resize(1);
    for (const auto& pairs : kinds) {
      const std::string what = absl::StrCat(clip.name, ", ", std::string(PairStepName(pairs->step())), ": pairs");
      ASSIGN_OR_RETURN(clip.scene_flow.emplace_back(), BenchmarkSceneFlow(*pairs, {.methods = methods,
                                                                                   .threads = options_.threads,
                                                                                   .stop = options_.stop,
                                                                                   .on_pair = Counter(what)}));
    }
    return absl::OkStatus();
  }

  static double Median(std::vector<double> values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
  }

  absl::StatusOr<TimeBenchmark> Time(const FrameSource& source, const ClipConstants& constants,
                                     const Interval& interval, const std::vector<Image<uint8_t>>& luma,
                                     const std::string& preset, int threads) const {
    ASSIGN_OR_RETURN(const PipelineOptions pipeline_options, PipelineOptions::ForPreset(preset));
    const std::unique_ptr<Upsampler> pipeline = MakePipeline(pipeline_options);
    const auto count = Counter(absl::StrFormat("time, %s on %d: rounds", preset, threads));
    std::vector<double> whole, flows, ratios;
    std::map<std::string, std::vector<double>> stages;
    for (int round = 0; round <= options_.rounds; ++round) {
      count(round, options_.rounds + 1);
      const auto start = std::chrono::steady_clock::now();
      ASSIGN_OR_RETURN(const IntervalSummary summary,
                       pipeline->Run(source, constants, interval, {.threads = threads, .stop = options_.stop},
                                     [](const DepthResult&) { return absl::OkStatus(); }));
      const auto between = std::chrono::steady_clock::now();
      YardstickFlows(luma, threads);
      const auto end = std::chrono::steady_clock::now();
      if (round == 0) continue;  // warms caches and thread pools
      whole.push_back(std::chrono::duration<double>(between - start).count());
      flows.push_back(std::chrono::duration<double>(end - between).count());
      ratios.push_back(whole.back() / flows.back());
      for (const auto& [stage, seconds] : summary.stage_seconds) stages[stage].push_back(seconds);
    }
    TimeBenchmark time{.preset = preset,
                       .threads = threads,
                       .seconds = Median(whole),
                       .flows_seconds = Median(flows),
                       .ratio = Median(ratios)};
    for (auto& [stage, seconds] : stages) time.stage_seconds[stage] = Median(std::move(seconds));
    return time;
  }

  // Both directions between the nine colour frames of an interval.
  static void YardstickFlows(const std::vector<Image<uint8_t>>& luma, int threads) {
    ParallelFor(kYardstickFlows, threads, [&](int i) {
      const auto mat = [&](int frame) {
        const Image<uint8_t>& image = luma[frame];
        return cv::Mat(image.height(), image.width(), CV_8UC1, const_cast<uint8_t*>(image.data()));
      };
      const int pair = i / 2;
      cv::Mat flow;
      cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM)
          ->calc(mat(pair + i % 2), mat(pair + 1 - i % 2), flow);
    });
  }

  const BenchmarkOptions& options_;
  const std::function<absl::Status(const Benchmark&)>& on_clip_;
  Benchmark benchmark_;
};

}  // namespace

const std::vector<std::string>& BenchmarkTables() {
  static const auto* const kNames =
      new std::vector<std::string>{"depth", "ablation", "parameters", "ratio", "sceneflow", "time"};
  return *kNames;
}

const std::vector<std::string>& BenchmarkScenes() {
  static const auto* const kNames = [] {
    auto* const names = new std::vector<std::string>;
    for (const SceneInfo& scene : SceneList())
      if (scene.name != "still") names->emplace_back(scene.name);
    return names;
  }();
  return *kNames;
}

std::string_view ClipKindName(ClipKind kind) {
  switch (kind) {
    case ClipKind::kScene:
      return "library's scenes";
    case ClipKind::kRendered:
      return "rendered sequences";
    case ClipKind::kReal:
      return "real sequences";
  }
  return "";
}

absl::Status BenchmarkOptions::Validate() const {
  const auto error = [](const char* field, int value, const std::string& rule) {
    return absl::InvalidArgumentError(absl::StrFormat("%s = %d, must be %s", field, value, rule));
  };
  for (const std::string& table : tables)
    if (!Contains(BenchmarkTables(), table)) return Unknown("table", table, BenchmarkTables());
  for (const std::string& baseline : baselines)
    if (!Contains(BaselineNames(), baseline)) return Unknown("baseline", baseline, BaselineNames());
  for (const std::string& scene : scenes) {
    const bool known =
        std::any_of(SceneList().begin(), SceneList().end(), [&](const SceneInfo& info) { return info.name == scene; });
    if (!known) return Unknown("scene", scene, BenchmarkScenes());
  }
  for (const std::string& sequence : sequences) RETURN_IF_ERROR(ParseSequence(sequence).status());
  RETURN_IF_ERROR(PipelineOptions::ForPreset(preset).status());
  // Two intervals: the fewest that keys can be settled in.
  if (frames < 2 * kUsualRatio + 1 || frames > 100'000) return error("frames", frames, "between 17 and 100000");
  if (rounds < 1 || rounds > 1000) return error("rounds", rounds, "between 1 and 1000");
  if (threads < 1 || threads > kMaxThreads)
    return error("threads", threads, absl::StrCat("between 1 and ", kMaxThreads));
  return SyntheticOptions{.frames = frames, .width = width, .height = height}.Validate();
}

absl::StatusOr<Benchmark> RunBenchmark(const BenchmarkOptions& options,
                                       const std::function<absl::Status(const Benchmark&)>& on_clip) {
  RETURN_IF_ERROR(options.Validate());
  return Run(options, on_clip).All();
}

}  // namespace depthtween
