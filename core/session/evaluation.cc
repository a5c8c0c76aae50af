#include "core/session/evaluation.h"

#include <algorithm>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/baselines/baselines.h"
#include "core/io/result_folder.h"
#include "core/io/sequence_folder.h"

namespace depthtween {
namespace {

using nlohmann::json;

// Result frame of each colour frame of the reference, by time stamp; -1 where there is none.
absl::StatusOr<std::vector<int>> MatchFrames(const ResultFolder& result, const SequenceFolder& reference) {
  const Sequence& sequence = reference.sequence();
  if (result.camera().width != sequence.camera.width || result.camera().height != sequence.camera.height)
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is %d x %d, %s %d x %d, must be the same: name the sequence that the result was made from", result.dir(),
        result.camera().width, result.camera().height, reference.dir(), sequence.camera.width, sequence.camera.height));
  std::map<int64_t, int> by_time;
  for (size_t i = 0; i < result.frames().size(); ++i) by_time[result.frames()[i].time_ns] = static_cast<int>(i);
  std::vector<int> matches;
  for (const FrameRef& frame : sequence.color) {
    const auto found = by_time.find(frame.time_ns);
    matches.push_back(found == by_time.end() ? -1 : found->second);
  }
  if (std::all_of(matches.begin(), matches.end(), [](int match) { return match < 0; }))
    return absl::InvalidArgumentError(
        absl::StrFormat("no frame of %s has the time stamp of a colour frame of %s: name the sequence that the result "
                        "was made from",
                        result.dir(), reference.dir()));
  return matches;
}

absl::StatusOr<ResultFolder> OpenResult(const std::string& dir) {
  auto result = ResultFolder::Open(dir);
  if (result.ok()) return result;
  return absl::Status(result.status().code(),
                      absl::StrCat(result.status().message(),
                                   ": name a folder that `depthtween-core upsample SEQ -o OUT` has finished"));
}

struct ResultFacts {
  std::string method;
  int key_every = 1;
  ClipAlignment alignment;
};

absl::StatusOr<ResultFacts> ReadFacts(const ResultFolder& result) {
  const json options = result.report().value("options", json::object());
  const auto method = options.find("method"), key_every = options.find("key_every");
  if (method == options.end() || !method->is_string() || key_every == options.end() ||
      !key_every->is_number_integer() || key_every->get<int64_t>() < 1 || key_every->get<int64_t>() > 1'000'000)
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s/report.json does not say options.method and options.key_every: evaluate a folder that upsample wrote",
        result.dir()));
  ResultFacts facts{.method = method->get<std::string>(), .key_every = key_every->get<int>()};
  try {
    facts.alignment = AlignmentOf(result.report());
  } catch (const json::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(result.dir(), "/report.json: clock or registration: ", error.what()));
  }
  return facts;
}

}  // namespace

absl::StatusOr<Evaluation> Evaluate(const EvaluationOptions& options) {
  ASSIGN_OR_RETURN(const ResultFolder result, OpenResult(options.result_dir));
  ASSIGN_OR_RETURN(const ResultFacts facts, ReadFacts(result));
  ASSIGN_OR_RETURN(const std::unique_ptr<SequenceFolder> reference, SequenceFolder::Open(options.reference_dir));
  ASSIGN_OR_RETURN(const std::vector<int> matches, MatchFrames(result, *reference));
  ASSIGN_OR_RETURN(ClipTruth truth, ClipTruth::Open(*reference, facts.alignment, facts.key_every));
  const int missing = truth.Keep([&](int color) { return matches[color] >= 0; });
  if (truth.Frames().empty())
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s has no frame that %s has truth for: run upsample on all of it", options.result_dir, options.reference_dir));

  const StoredResult stored(result, matches);
  std::vector<ScoredMethod> methods = {
      {.name = facts.method, .upsampler = &stored, .any_frame = true, .predicts_sigma = true}};
  std::vector<std::unique_ptr<Upsampler>> baselines;
  for (const std::string& name : options.baselines) {
    ASSIGN_OR_RETURN(std::unique_ptr<Upsampler> baseline, MakeBaseline(name));
    if (std::any_of(methods.begin(), methods.end(), [&](const ScoredMethod& method) { return method.name == name; }))
      continue;
    methods.push_back({.name = name, .upsampler = baseline.get(), .any_frame = true});
    baselines.push_back(std::move(baseline));
  }

  ASSIGN_OR_RETURN(ClipScores scores, ScoreMethods(*reference, std::move(truth), methods,
                                                   {.alignment = facts.alignment,
                                                    .key_every = facts.key_every,
                                                    .far_m = options.far_m,
                                                    .threads = options.threads,
                                                    .stop = options.stop,
                                                    .on_frame = options.on_progress}));
  if (missing > 0)
    scores.notes.push_back(absl::StrFormat("%d frames with truth are not scored: they are not in the result", missing));
  return Evaluation{{std::move(scores)}, options.result_dir, options.reference_dir, facts.method};
}

}  // namespace depthtween
