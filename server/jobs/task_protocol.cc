#include "server/jobs/task_protocol.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "absl/strings/str_format.h"
#include "core/sequence/camera_json.h"
#include "nlohmann/json.hpp"
#include "server/store/error_info.h"
#include "server/store/records_json.h"

namespace depthtween::server {
namespace {

using nlohmann::json;

absl::Status Disagreement(std::string_view what) {
  return absl::InternalError(absl::StrFormat(
      "depthtween-core answered in a form this server does not know (%s); both must be of the same version",
      std::string(what)));
}

absl::Status ToStatus(const json& value) {
  const std::string name = value.at("code");
  absl::StatusCode code = absl::StatusCode::kUnknown;
  for (int candidate = 1; candidate <= 16; ++candidate) {
    if (absl::StatusCodeToString(static_cast<absl::StatusCode>(candidate)) == name) {
      code = static_cast<absl::StatusCode>(candidate);
    }
  }
  const std::string message = value.at("message");
  if (code == absl::StatusCode::kInvalidArgument && value.contains("field")) {
    return BadField(value.at("field").get<std::string>(), message);
  }
  return absl::Status(code, message);
}

std::vector<FileViolation> ToViolations(const json& answer) {
  std::vector<FileViolation> violations;
  for (const json& violation : answer.at("violations")) {
    violations.push_back({.file = violation.at("file"), .status = ToStatus(violation)});
  }
  return violations;
}

// `read` returns the value or an error, or throws what nlohmann::json throws about missing members and wrong types.
template <typename T, typename Read>
absl::StatusOr<T> ReadJson(std::string_view text, const Read& read) {
  absl::StatusOr<T> value;
  try {
    value = read(json::parse(text));
  } catch (const json::exception& error) {
    return Disagreement(error.what());
  }
  return value.ok() ? value : Disagreement(std::string(value.status().message()));
}

absl::StatusOr<Recording> ToRecording(const json& value) {
  ASSIGN_OR_RETURN(const CameraFile file, CameraFromJson(value.at("camera")));
  const json& color = value.at("color");
  return Recording{.camera = file.camera,
                   .depth_scale = file.depth_scale,
                   .color_frame_count = static_cast<int>(color.size()),
                   .depth_frame_count = static_cast<int>(value.at("depth").size()),
                   .first_time_ns = color.at(0).at("time_ns"),
                   .last_time_ns = color.at(color.size() - 1).at("time_ns"),
                   .median_depth_m = value.at("median_depth_m")};
}

bool IsPlainName(const std::string& name) {
  return !name.empty() && name.size() <= 255 && name.front() != '.' && name.find('/') == std::string::npos &&
         name.find('\0') == std::string::npos;
}

constexpr size_t kMaxText = 2000;  // of text for people
constexpr size_t kMaxWarnings = 50;

absl::StatusOr<JobPlan> CheckPlan(JobPlan plan) {
  if (plan.clock_estimate && plan.clock_estimate->reason.size() > kMaxText) {
    return Disagreement("a clock with too long a reason");
  }
  const auto is_long = [](const std::string& warning) { return warning.size() > kMaxText; };
  if (plan.warnings.size() > kMaxWarnings || std::any_of(plan.warnings.begin(), plan.warnings.end(), is_long)) {
    return Disagreement("too many or too long warnings");
  }
  if (plan.intervals.empty()) return Disagreement("a plan without intervals");
  int next_frame = 0;
  for (size_t i = 0; i < plan.intervals.size(); ++i) {
    const PlannedInterval& interval = plan.intervals[i];
    if (interval.index != static_cast<int>(i) || interval.first_frame != next_frame || interval.frame_count < 1 ||
        interval.frame_count > static_cast<int>(plan.frames.size()) - next_frame) {
      return Disagreement(absl::StrCat("interval ", i, " does not follow the one before it"));
    }
    next_frame += interval.frame_count;
  }
  if (next_frame != static_cast<int>(plan.frames.size())) return Disagreement("frames that belong to no interval");
  std::set<std::string_view> stems;
  for (size_t i = 0; i < plan.frames.size(); ++i) {
    const PlannedFrame& frame = plan.frames[i];
    if (frame.index != static_cast<int>(i)) return Disagreement(absl::StrCat("frame ", i, " has another index"));
    if (!IsPlainName(frame.stem) || !stems.insert(frame.stem).second) {
      return Disagreement(absl::StrCat("frame ", i, " has no unique plain name"));
    }
  }
  return plan;
}

}  // namespace

std::vector<std::string> TaskCommand(const Task& task, const TaskPaths& paths, std::string_view render) {
  std::vector<std::string> command = {
      paths.program, "task", std::string(ToString(task.kind)), "--sequence", paths.sequence, "--progress-fd", "3"};
  const auto add = [&command](const char* option, std::string value) {
    command.emplace_back(option);
    command.push_back(std::move(value));
  };
  if (task.kind == TaskKind::kValidate) {
    if (paths.max_pixels > 0) add("--max-pixels", absl::StrCat(paths.max_pixels));
    return command;
  }
  add("--options", paths.options);
  add("--threads", absl::StrCat(paths.threads));
  if (paths.keep_motion) command.emplace_back("--keep-motion");
  if (task.kind != TaskKind::kSelfCheck) add("--constants", paths.constants);
  if (task.kind == TaskKind::kIntervals || task.kind == TaskKind::kRender) {
    add("--first", absl::StrCat(task.first_interval));
    add("--count", absl::StrCat(task.interval_count));
  }
  if (task.kind == TaskKind::kRender) {
    add("--render", std::string(render));
    add("--result", paths.result);
  }
  if (task.kind != TaskKind::kPrepare) add("--out", paths.out);
  if (!paths.self_check.empty()) add("--self-check", paths.self_check);
  return command;
}

std::vector<std::string> UnpackCommand(const TaskPaths& paths, std::string_view archive, int max_files,
                                       int64_t max_bytes) {
  return {paths.program,
          "task",
          "unpack",
          "--sequence",
          paths.sequence,
          "--progress-fd",
          "3",
          "--archive",
          std::string(archive),
          "--out",
          paths.out,
          "--max-files",
          absl::StrCat(max_files),
          "--max-bytes",
          absl::StrCat(max_bytes)};
}

std::string OrderJson(JobKind kind, const std::string& options, const std::vector<RenderRecord>& renders) {
  json order = {{kind == JobKind::kUpsample ? "upsample" : "scene_flow", json::parse(options)}};
  for (const RenderRecord& render : renders) order["renders"].push_back(json::parse(render.options));
  return order.dump();
}

std::string FrameRenderJson(const std::string& options, const std::string& render, bool jpeg) {
  json order = {{"upsample", json::parse(options)}, {"render", json::parse(render)}};
  order["render"]["frame_format"] = jpeg ? "jpeg" : "png";
  return order.dump();
}

ProgressLine ParseProgressLine(std::string_view line) {
  const absl::StatusOr<ProgressLine> parsed = ReadJson<ProgressLine>(line, [](const json& value) {
    ProgressLine result;
    if (value.contains("error")) {
      const json& error = value.at("error");
      result.error = ToStatus(error);
      if (error.contains("lost")) {
        ProgressLine::Lost lost = {.what = error.at("lost").at("what"), .frame = error.at("lost").at("frame")};
        const bool known = lost.what == "depth" || lost.what == "motion" || lost.what == "color";
        if (known && lost.frame >= 0) result.lost = std::move(lost);
      }
    } else if (value.contains("interval_done")) {
      const double seconds = value.at("seconds");
      // JSON has no infinity, but a double of it may overflow into one.
      result.interval_done = {.interval = value.at("interval_done"),
                              .seconds = std::isfinite(seconds) ? std::max(0.0, seconds) : 0.0};
    } else if (value.contains("checked")) {
      result.checked = {.checked = value.at("checked"), .of = value.at("of")};
    } else if (value.contains("stage")) {
      result.stage = value.at("stage").get<std::string>().substr(0, 64);
    }
    return result;
  });
  return parsed.ok() ? *parsed : ProgressLine{};
}

absl::Status LostStatus(const ProgressLine::Lost& lost, std::string_view job_id, std::string_view sequence_id) {
  const std::string job = absl::StrCat("jobs/", std::string(job_id));
  if (lost.what == "depth") return FileLost(job + "/outputs/depth", lost.frame);
  if (lost.what == "motion") return FileOfJobLost(job, lost.what, lost.frame);
  const std::string sequence = absl::StrCat("sequences/", std::string(sequence_id));
  return WithErrorInfo(
      absl::DataLossError(
          absl::StrCat("colour frame ", lost.frame, " of ", sequence,
                       " was uploaded, but its file is lost from the server's disk; delete the sequence "
                       "and upload it again")),
      {.reason = "FILE_LOST", .metadata = {{"resource", sequence}, {"frame", absl::StrCat(lost.frame)}}});
}

absl::StatusOr<int> ParseMotionFrames(std::string_view text) {
  return ReadJson<int>(text, [](const json& value) { return value.at("motion_frames").get<int>(); });
}

absl::StatusOr<std::vector<RenderRecord>> ParseRenderPlans(std::string_view text, std::vector<RenderRecord> renders) {
  ASSIGN_OR_RETURN(const json plans, ReadJson<json>(text, [](const json& value) { return value.at("renders"); }));
  if (!plans.is_array() || plans.size() != renders.size()) return Disagreement("plans for other renders");
  std::set<std::string> outputs, names;
  for (size_t i = 0; i < renders.size(); ++i) {
    RenderRecord& render = renders[i];
    ASSIGN_OR_RETURN(render, ReadJson<RenderRecord>(plans[i].dump(), [&](const json& plan) {
                       return RenderRecord{.name = plan.at("name"),
                                           .options = render.options,
                                           .reach_frames = plan.at("reach_frames"),
                                           .anchor_frame = plan.at("anchor_frame"),
                                           .uses_motion = plan.at("uses_motion"),
                                           .streams = plan.at("streams").get<std::vector<std::string>>(),
                                           .extension = plan.at("extension"),
                                           .videos = plan.at("videos").get<std::vector<std::string>>()};
                     }));
    bool plain = IsPlainName(render.name) && names.insert(render.name).second && !render.streams.empty() &&
                 render.reach_frames >= 0 && (render.extension == "png" || render.extension == "jpg") &&
                 (render.videos.empty() || render.videos.size() == render.streams.size());
    for (const std::vector<std::string>* files : {&render.streams, &render.videos}) {
      for (const std::string& file : *files) plain = plain && IsPlainName(file) && outputs.insert(file).second;
    }
    if (!plain) return Disagreement(absl::StrCat("render ", i, " has no unique outputs"));
  }
  return renders;
}

absl::StatusOr<std::vector<FileViolation>> ParseUnpacking(std::string_view text) {
  using Violations = std::vector<FileViolation>;
  return ReadJson<Violations>(text, [](const json& value) -> absl::StatusOr<Violations> {
    Violations violations = ToViolations(value);
    if (value.at("ok").get<bool>() != violations.empty()) return Disagreement("an archive that is good and bad");
    return violations;
  });
}

absl::StatusOr<ValidationResult> ParseValidation(std::string_view text) {
  return ReadJson<ValidationResult>(text, [](const json& value) -> absl::StatusOr<ValidationResult> {
    ValidationResult result;
    result.warnings = value.at("warnings").get<std::vector<std::string>>();
    result.violations = ToViolations(value);
    if (value.at("ok").get<bool>()) {
      ASSIGN_OR_RETURN(result.recording, ToRecording(value));
    }
    return result;
  });
}

absl::StatusOr<SelfCheck> ReadSelfCheck(std::string_view text) {
  constexpr size_t kMaxListed = 100;
  const absl::StatusOr<SelfCheck> check = ParseSelfCheck(text);
  if (!check.ok()) return Disagreement(std::string(check.status().message()));
  bool plain = check->summary.size() <= kMaxText && check->reason.size() <= kMaxText && check->maps_checked >= 0 &&
               check->maps_held_out >= check->maps_checked && check->methods.size() <= kMaxListed &&
               check->worst_frames.size() <= kMaxListed && (check->reason.empty() != check->methods.empty());
  const auto is_share = [](double share) { return share >= 0.0 && share <= 1.0; };
  for (const SelfCheck::Method& method : check->methods) {
    plain = plain && method.name.size() <= kMaxText && is_share(method.completeness) &&
            is_share(method.within_one_sigma.value_or(0.0));
  }
  for (const SelfCheck::Frame& frame : check->worst_frames) plain = plain && IsPlainName(frame.stem);
  if (!plain) return Disagreement("a self-check with impossible numbers");
  return *check;
}

absl::StatusOr<JobPlan> ParsePlan(std::string_view text) {
  ASSIGN_OR_RETURN(
      JobPlan plan, ReadJson<JobPlan>(text, [](const json& value) {
        JobPlan read;
        for (const json& interval : value.at("intervals")) {
          read.intervals.push_back({.index = interval.at("index"),
                                    .first_frame = interval.at("first_frame"),
                                    .frame_count = interval.at("frame_count"),
                                    .held = interval.at("held")});
        }
        for (const json& frame : value.at("frames")) {
          read.frames.push_back({.index = frame.at("index"), .time_ns = frame.at("time_ns"), .stem = frame.at("stem")});
        }
        // A plan of scene flow has no clock and no constants.
        if (value.contains("clock") && value.at("clock").contains("estimate")) {
          read.clock_estimate = ClockEstimateFromJson(value.at("clock").at("estimate"));
        }
        if (value.contains("constants")) {
          read.warnings = value.at("constants").at("warnings").get<std::vector<std::string>>();
        }
        return read;
      }));
  return CheckPlan(std::move(plan));
}

}  // namespace depthtween::server
