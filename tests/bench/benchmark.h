// The tables by which the pipeline is judged, on the library's own scenes and on any sequence folders.
//
//   depth       ours beside the baselines, by region, with its uncertainty
//   ablation    what each part that the preset uses is worth: of PartNames(), switched off one by one;
//               last, all that look for better motion than the flow's, together
//   parameters  PipelineParameters() over their ranges
//   ratio       1 to 4 times as many colour frames per depth frame, by dropping keys; scored on the same frames
//   sceneflow   3-D motion between two RGB-D frames: ours beside re-implemented baselines
//   time        seconds for an interval beside 16 dense flows of OpenCV timed in the same run, by preset and stage
//
// All errors are those of core/metrics, on the pixels that all methods of a table fill.
#ifndef DEPTHTWEEN_TESTS_BENCH_BENCHMARK_H_
#define DEPTHTWEEN_TESTS_BENCH_BENCHMARK_H_

#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/session/clip_scoring.h"
#include "tests/bench/benchmark_scene_flow.h"

namespace depthtween {

// "depth", "ablation", "parameters", "ratio", "sceneflow", "time".
const std::vector<std::string>& BenchmarkTables();
// Those of SceneList() in which something moves: a still one tells methods apart by noise alone.
const std::vector<std::string>& BenchmarkScenes();

struct BenchmarkOptions {
  // Folders, each "FOLDER" or "FOLDER:N": every N-th depth map is input. Without N: all where there is gt/depth, else
  // as many as leave about 8 colour frames between two, and at least 5 maps.
  std::vector<std::string> sequences;
  std::vector<std::string> scenes = BenchmarkScenes();  // rendered into a temporary folder, 240 and 30 fps
  std::vector<std::string> tables = BenchmarkTables();
  std::vector<std::string> baselines;  // of the table depth; names of core/baselines. None: sceneflow has ours alone
  std::string preset = "balanced";     // of ours; the table time takes all
  int frames = 33;                     // colour frames of a scene; 3 times as long for the table ratio. >= 17
  int width = 512, height = 424;       // of scenes, and of the table time
  int rounds = 3;                      // of the table time, which tells medians. >= 1
  int threads = 1;                     // does not change the numbers, but for the table time, which takes 1 and 2. >= 1
  std::stop_token stop = {};
  // Called now and then from the calling thread: "kick, ablation: frames", 3, 31. May be empty.
  std::function<void(const std::string& what, int done, int total)> on_progress = nullptr;

  // InvalidArgument with field, value, rule.
  absl::Status Validate() const;
};

enum class ClipKind { kScene, kRendered, kReal };
// "library's scenes", "rendered sequences" (with gt/depth), "real sequences".
std::string_view ClipKindName(ClipKind kind);

// What was measured on one clip; a table that was not run is empty.
struct ClipBenchmark {
  std::string name;  // of the scene or folder; unlike all others
  ClipKind kind = ClipKind::kScene;
  int key_every = 1;
  std::optional<ClipScores> depth;     // ours, then the baselines
  Image<Rgb8> strip;                   // with `depth`: frames in mid-interval, errors of the methods (DrawErrorStrip)
  std::optional<ClipScores> ablation;  // ours, then without each part that the preset uses, then all for motion
  struct Parameter {
    std::string name;
    double preset_value = 0.0;
    std::vector<std::pair<double, MethodScore>> scores;  // by value
  };
  std::vector<Parameter> parameters;
  struct Ratio {
    int color_per_depth = 0;  // colour frames from one key to the next
    ClipScores scores;        // ours and flow-warp
  };
  std::vector<Ratio> ratios;
  std::vector<SceneFlowBenchmark> scene_flow;  // key to key, frame to frame: what there is truth for
};

// Medians over the rounds, of one interval of `kick`: 8 frames of the size of scenes, rendered into memory.
struct TimeBenchmark {
  std::string preset;
  int threads = 1;
  double seconds = 0.0;
  double flows_seconds = 0.0;  // 16 flows of OpenCV's DIS, preset medium, as many at a time as there are threads
  double ratio = 0.0;          // of the two, round by round
  std::map<std::string, double> stage_seconds;
};

struct Benchmark {
  std::vector<ClipBenchmark> clips;
  std::vector<TimeBenchmark> times;
  int timed_width = 0, timed_height = 0;
};

// In memory at a time: the frames of one interval of each method of a table. Calls `on_clip`, if any, whenever a clip
// is done or times are taken, with all that was measured so far; its error ends the run. Errors: InvalidArgument for
// options; Cancelled when `stop` fires; what reading, rendering and methods return, naming the clip.
absl::StatusOr<Benchmark> RunBenchmark(const BenchmarkOptions& options,
                                       const std::function<absl::Status(const Benchmark& so_far)>& on_clip = nullptr);

nlohmann::json ToJson(const Benchmark& benchmark);

// Writes report.md, report.json and the plots and strips that report.md shows into `dir`, replacing earlier ones.
// `command` says in the report how it was made.
absl::Status WriteBenchmarkReport(const Benchmark& benchmark, const std::string& command, const std::string& dir);

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_BENCHMARK_H_
