// What is said to and by `depthtween-core task`, and the arithmetic of progress. Expected values are worked out by
// hand.
#include <gtest/gtest.h>

#include "server/jobs/progress.h"
#include "server/jobs/task_protocol.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;

TEST(TaskProtocol, CommandsAreThoseOfDepthtweenCore) {
  const TaskPaths paths = {.program = "core", .sequence = "S", .options = "O", .constants = "C", .out = "D"};
  EXPECT_THAT(TaskCommand({.kind = TaskKind::kValidate}, paths),
              ElementsAre("core", "task", "validate", "--sequence", "S", "--progress-fd", "3"));
  EXPECT_THAT(
      TaskCommand({.kind = TaskKind::kValidate}, {.program = "core", .sequence = "S", .max_pixels = 2'000'000'000'000}),
      ElementsAre("core", "task", "validate", "--sequence", "S", "--progress-fd", "3", "--max-pixels",
                  "2000000000000"));
  EXPECT_THAT(TaskCommand({.kind = TaskKind::kPrepare}, paths),
              ElementsAre("core", "task", "prepare", "--sequence", "S", "--progress-fd", "3", "--options", "O",
                          "--threads", "1", "--constants", "C"));
  EXPECT_THAT(TaskCommand({.kind = TaskKind::kIntervals, .first_interval = 4, .interval_count = 2}, paths),
              ElementsAre("core", "task", "intervals", "--sequence", "S", "--progress-fd", "3", "--options", "O",
                          "--threads", "1", "--constants", "C", "--first", "4", "--count", "2", "--out", "D"));
  EXPECT_THAT(
      TaskCommand({.kind = TaskKind::kRender, .first_interval = 4, .interval_count = 2},
                  {.program = "core", .sequence = "S", .options = "O", .constants = "C", .out = "D", .result = "R"},
                  "dof"),
      ElementsAre("core", "task", "render", "--sequence", "S", "--progress-fd", "3", "--options", "O", "--threads", "1",
                  "--constants", "C", "--first", "4", "--count", "2", "--render", "dof", "--result", "R", "--out",
                  "D"));
  EXPECT_THAT(TaskCommand({.kind = TaskKind::kSelfCheck}, paths),
              ElementsAre("core", "task", "self-check", "--sequence", "S", "--progress-fd", "3", "--options", "O",
                          "--threads", "1", "--out", "D"));
  EXPECT_THAT(
      TaskCommand(
          {.kind = TaskKind::kAssemble},
          {.program = "core", .sequence = "S", .options = "O", .constants = "C", .out = "D", .self_check = "X"}),
      ElementsAre("core", "task", "assemble", "--sequence", "S", "--progress-fd", "3", "--options", "O", "--threads",
                  "1", "--constants", "C", "--out", "D", "--self-check", "X"));
  EXPECT_THAT(TaskCommand({.kind = TaskKind::kPrepare},
                          {.program = "core", .options = "O", .constants = "C", .threads = 3, .keep_motion = true}),
              ElementsAre("core", "task", "prepare", "--sequence", "", "--progress-fd", "3", "--options", "O",
                          "--threads", "3", "--keep-motion", "--constants", "C"));
}

TEST(TaskProtocol, OrdersHoldTheDocumentsAsTheyAre) {
  EXPECT_EQ(OrderJson(JobKind::kUpsample, R"({"a":1})", {{.options = R"({"name":"a"})"}, {.options = "{}"}}),
            R"({"renders":[{"name":"a"},{}],"upsample":{"a":1}})");
  EXPECT_EQ(OrderJson(JobKind::kSceneFlow, R"({"every":2})"), R"({"scene_flow":{"every":2}})");
  EXPECT_EQ(FrameRenderJson("{}", R"({"stereo":{}})", true),
            R"({"render":{"frame_format":"jpeg","stereo":{}},"upsample":{}})");
}

TEST(TaskProtocol, ProgressLines) {
  EXPECT_EQ(ParseProgressLine(R"({"stage":"flow","interval":3})").stage, "flow");
  const auto done = ParseProgressLine(R"({"interval_done":3,"seconds":0.61,"frames":8})").interval_done;
  ASSERT_TRUE(done.has_value());
  EXPECT_EQ(done->interval, 3);
  EXPECT_EQ(done->seconds, 0.61);
  EXPECT_EQ(ParseProgressLine(R"({"checked":12,"of":66})").checked->of, 66);
  EXPECT_THAT(*ParseProgressLine(R"({"error":{"code":"DATA_LOSS","message":"m"}})").error,
              HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(*ParseProgressLine(R"({"error":{"code":"NONSENSE","message":"m"}})").error,
              HasCode(absl::StatusCode::kUnknown));
}

TEST(TaskProtocol, NothingAChildSaysDoesHarm) {
  for (const char* line :
       {"", "{", "[]", "null", "7", "{\"stage\":7}", "{\"interval_done\":\"x\",\"seconds\":1}", "{\"interval_done\":1}",
        "{\"checked\":1}", "{\"error\":\"x\"}", "\xFF\xFE", "{\"frame\":17}"}) {
    const ProgressLine parsed = ParseProgressLine(line);
    EXPECT_FALSE(parsed.stage || parsed.interval_done || parsed.checked || parsed.error) << line;
  }
  const ProgressLine lost =
      ParseProgressLine(R"({"error":{"code":"DATA_LOSS","message":"m","lost":{"what":"motion","frame":7}}})");
  EXPECT_THAT(*lost.error, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_EQ(lost.lost->what, "motion");
  EXPECT_EQ(lost.lost->frame, 7);
  EXPECT_FALSE(ParseProgressLine(R"({"error":{"code":"DATA_LOSS","message":"m","lost":{"what":"../x","frame":7}}})")
                   .lost.has_value());
  EXPECT_EQ(ParseProgressLine(R"({"interval_done":1,"seconds":-5})").interval_done->seconds, 0);
  for (const char* text : {"", "{}", "[]", R"({"ok":true,"violations":[],"warnings":[]})", R"({"ok":"yes"})"}) {
    EXPECT_THAT(ParseValidation(text), HasCode(absl::StatusCode::kInternal)) << text;
  }
}

TEST(TaskProtocol, AnArchiveIsGoodOrBad) {
  EXPECT_THAT(Take(ParseUnpacking(R"({"ok":true,"violations":[],"files":3,"bytes":5})")), testing::IsEmpty());
  const std::string bad = R"({"file":"../x","code":"INVALID_ARGUMENT","message":"leads out of its folder"})";
  const std::vector<FileViolation> violations = Take(ParseUnpacking(R"({"ok":false,"violations":[)" + bad + "]}"));
  ASSERT_EQ(violations.size(), 1U);
  EXPECT_EQ(violations[0].file, "../x");
  EXPECT_THAT(violations[0].status, HasCode(absl::StatusCode::kInvalidArgument));
  for (const std::string& text : {std::string(), std::string("{}"), std::string(R"({"ok":false,"violations":[]})"),
                                  R"({"ok":true,"violations":[)" + bad + "]}"}) {
    EXPECT_THAT(ParseUnpacking(text), HasCode(absl::StatusCode::kInternal)) << text;
  }
}

TEST(TaskProtocol, PlansAreChecked) {
  const auto plan = [](const std::string& intervals, const std::string& frames) {
    return ParsePlan("{\"constants\":{\"warnings\":[]},\"intervals\":[" + intervals + "],\"frames\":[" + frames + "]}");
  };
  const std::string interval = R"({"index":0,"first_frame":0,"frame_count":1,"held":true})";
  const std::string frame = R"({"index":0,"time_ns":-7,"stem":"a"})";
  const JobPlan good = Take(plan(interval, frame));
  EXPECT_TRUE(good.intervals[0].held);
  EXPECT_EQ(good.frames[0].time_ns, -7);
  const auto is_refused = HasCode(absl::StatusCode::kInternal);
  EXPECT_THAT(plan("", ""), is_refused);
  EXPECT_THAT(plan(interval, ""), is_refused) << "frames that do not exist";
  EXPECT_THAT(plan(interval, frame + R"(,{"index":1,"time_ns":0,"stem":"b"})"), is_refused) << "a frame left over";
  EXPECT_THAT(plan(interval + R"(,{"index":1,"first_frame":0,"frame_count":1,"held":true})", frame), is_refused);
  EXPECT_THAT(plan(R"({"index":0,"first_frame":0,"frame_count":2000000000,"held":true})", frame), is_refused);
  for (const char* stem : {"", "../x", "/etc/passwd", ".x", "a/b"}) {
    EXPECT_THAT(plan(interval, std::string(R"({"index":0,"time_ns":0,"stem":")") + stem + "\"}"), is_refused) << stem;
  }
}

TEST(TaskProtocol, APlanTellsWarnings) {
  const auto plan = [](const std::string& warnings) {
    return ParsePlan(R"({"intervals":[{"index":0,"first_frame":0,"frame_count":1,"held":true}],"frames":)"
                     R"([{"index":0,"time_ns":-7,"stem":"a"}],"constants":{"warnings":)" +
                     warnings + "}}");
  };
  EXPECT_THAT(Take(plan("[]")).warnings, testing::IsEmpty());
  EXPECT_THAT(Take(plan(R"(["one", "two"])")).warnings, testing::ElementsAre("one", "two"));
  EXPECT_THAT(plan(R"(["one", 2])"), HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(plan("[\"" + std::string(3000, 'x') + "\"]"), HasCode(absl::StatusCode::kInternal));
}

TEST(TaskProtocol, APlanTellsTheClock) {
  const auto plan = [](const std::string& clock) {
    return ParsePlan(R"({"intervals":[{"index":0,"first_frame":0,"frame_count":1,"held":true}],"frames":)"
                     R"([{"index":0,"time_ns":-7,"stem":"a"}],"clock":{"offset_ns":4e6)" +
                     clock + "}}");
  };
  const auto estimate = [&plan](const std::string& reason, const std::string& offset) {
    return plan(R"(,"estimate":{"trusted":true,"summary":"s","reason":")" + reason +
                R"(","reference_ns":5,"offset_ns":)" + offset +
                R"(,"offset_sigma_ns":1,"drift_ppm":2,"drift_sigma_ppm":-1,"stamp_sigma_ns":3,"row_time_ns":4,)"
                R"("row_time_sigma_ns":-1,"keys":6,"edges":7})");
  };
  EXPECT_FALSE(Take(plan("")).clock_estimate.has_value()) << "none was asked for";
  const ClockEstimate good = *Take(estimate("", "4e6")).clock_estimate;
  EXPECT_EQ(good.model.offset_ns, 4e6);
  EXPECT_EQ(good.drift_sigma_ppm, -1);
  EXPECT_EQ(good.edges, 7);
  const auto is_refused = HasCode(absl::StatusCode::kInternal);
  EXPECT_THAT(estimate("", "\"4\""), is_refused);
  EXPECT_THAT(estimate(std::string(3000, 'x'), "4"), is_refused);
  EXPECT_THAT(plan(R"(,"estimate":{})"), is_refused);
}

TEST(TaskProtocol, SelfChecksAreChecked) {
  const auto check = [](const std::string& completeness, const std::string& stem, int maps_held_out = 2) {
    return ReadSelfCheck(R"({"summary":"s","maps_checked":2,"maps_held_out":)" + std::to_string(maps_held_out) +
                         R"(,"pixels":5,"seconds":1,"methods":[{"name":"ours","rmse_mm":7,"mae_mm":5,"completeness":)" +
                         completeness + R"(}],"worst_frames":[{"frame":3,"stem":")" + stem +
                         R"(","time_ns":7,"rmse_mm":8}]})");
  };
  const SelfCheck good = Take(check("0.5", "000003"));
  EXPECT_EQ(good.methods[0].completeness, 0.5);
  EXPECT_FALSE(good.methods[0].edge_band_rmse_mm.has_value());
  EXPECT_EQ(good.worst_frames[0].stem, "000003");
  EXPECT_EQ(Take(ReadSelfCheck(R"({"summary":"s","reason":"too short"})")).reason, "too short");
  const auto is_refused = HasCode(absl::StatusCode::kInternal);
  EXPECT_THAT(check("1.5", "000003"), is_refused) << "no share";
  EXPECT_THAT(check("1e999", "000003"), is_refused) << "no number";
  EXPECT_THAT(check("0.5", "../../x"), is_refused);
  EXPECT_THAT(check("0.5", "000003", 1), is_refused) << "more checked than there were";
  for (const std::string& text : {std::string(), std::string("[]"), std::string("{}"),
                                  R"({"summary":"s","reason":")" + std::string(3000, 'x') + "\"}"}) {
    EXPECT_THAT(ReadSelfCheck(text), is_refused) << text;
  }
}

TEST(TaskProtocol, RenderPlansAreChecked) {
  const auto plan = [](const std::string& name, const std::string& streams, const std::string& videos) {
    return R"({"name":")" + name + R"(","reach_frames":2,"anchor_frame":-1,"uses_motion":true,"streams":)" + streams +
           R"(,"extension":"png","videos":)" + videos + "}";
  };
  const auto parse = [](const std::string& plans, size_t count) {
    return ParseRenderPlans(R"({"renders":[)" + plans + "]}", std::vector<RenderRecord>(count, {.options = "{}"}));
  };
  const std::string good = plan("a", R"(["a-left","a-right"])", R"(["l.mp4","r.mp4"])");
  const std::vector<RenderRecord> renders = Take(parse(good, 1));
  EXPECT_EQ(renders[0].options, "{}");
  EXPECT_EQ(renders[0].reach_frames, 2);
  EXPECT_THAT(renders[0].streams, ElementsAre("a-left", "a-right"));
  const auto is_refused = HasCode(absl::StatusCode::kInternal);
  EXPECT_THAT(parse(good, 2), is_refused) << "a plan is missing";
  EXPECT_THAT(parse(good + "," + good, 2), is_refused) << "two of one name";
  EXPECT_THAT(parse(plan("../a", R"(["a"])", "[]"), 1), is_refused);
  EXPECT_THAT(parse(plan("a", R"(["/a"])", "[]"), 1), is_refused);
  EXPECT_THAT(parse(plan("a", R"(["a"])", R"(["a"])"), 1), is_refused);
  EXPECT_THAT(parse(plan("a", "[]", "[]"), 1), is_refused);
  EXPECT_THAT(parse("7", 1), is_refused);
}

TEST(TaskProtocol, AChildNamesTheFieldThatIsWrong) {
  EXPECT_THAT(*ParseProgressLine(
                   R"({"error":{"code":"INVALID_ARGUMENT","message":"renders[0].name = x","field":"renders[0].name"}})")
                   .error,
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
}

TEST(Progress, IsMeasuredNeverInvented) {
  JobRecord job = {.state = JobState::kRunning};
  EXPECT_EQ(DescribeProgress(job, "", 2).stage, "prepare");
  EXPECT_EQ(DescribeProgress(job, "", 2).fraction, 0);
  job.facts.self_check = true;
  EXPECT_EQ(DescribeProgress(job, "", 2).stage, "self-check");
  job.self_check.emplace();
  EXPECT_EQ(DescribeProgress(job, "", 2).stage, "prepare");
  job.intervals_total = 10;
  job.frames_total = 80;
  EXPECT_FALSE(DescribeProgress(job, "flow", 2).eta.has_value());
  EXPECT_EQ(DescribeProgress(job, "flow", 2).stage, "flow");
  job.intervals_done = 4;
  job.frames_done = 32;
  job.interval_seconds = 2.0;
  const Progress progress = DescribeProgress(job, "flow", 2);
  EXPECT_EQ(progress.fraction, 0.4);
  // 6 left on 2 workers are 3 rounds of 0.5 s.
  EXPECT_EQ(progress.eta->remaining, absl::Seconds(1.5));
  EXPECT_EQ(progress.eta->seconds_per_interval, 0.5);
  EXPECT_EQ(progress.eta->measured_intervals, 4);
  EXPECT_EQ(progress.eta->workers, 2);
  EXPECT_EQ(DescribeProgress(job, "flow", 100).eta->workers, 6) << "no more workers than intervals left";
  JobRecord computed = job;
  computed.intervals_done = computed.intervals_total;
  EXPECT_FALSE(DescribeProgress(computed, "", 2).eta.has_value()) << "nothing has measured what assembling takes";
  EXPECT_EQ(DescribeProgress(computed, "", 2).stage, "assemble");
  job.intervals_done = 10;
  job.frames_done = 80;
  EXPECT_LT(DescribeProgress(job, "", 2).fraction, 1) << "assembling is still to come";
  job.state = JobState::kFailed;
  EXPECT_FALSE(DescribeProgress(job, "", 2).eta.has_value());
  EXPECT_EQ(DescribeProgress(job, "flow", 2).stage, "failed");
}

TEST(Progress, CountsPicturesToo) {
  JobRecord job = {.renders = {{.frames_done = 8, .seconds = 4.0}, {}},
                   .state = JobState::kRunning,
                   .intervals_done = 4,
                   .intervals_total = 4,
                   .frames_done = 32,
                   .frames_total = 32,
                   .interval_seconds = 2.0};
  const Progress progress = DescribeProgress(job, "", 2);
  EXPECT_EQ(progress.stage, "render");
  EXPECT_EQ(progress.rendered_frames_done, 8);
  EXPECT_EQ(progress.rendered_frames_total, 64);
  EXPECT_NEAR(progress.fraction, 40.0 / 96.0, 1e-12);
  // 56 pictures of 0.5 s are left for 2 workers.
  EXPECT_EQ(progress.eta->remaining, absl::Seconds(14));
  EXPECT_EQ(progress.eta->seconds_per_rendered_frame, 0.5);
  EXPECT_EQ(progress.eta->measured_rendered_frames, 8);
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kRender, 1), 1);
  job.renders[0].frames_done = 0;
  EXPECT_FALSE(DescribeProgress(job, "", 2).eta.has_value()) << "no picture was measured";
}

TEST(Progress, BatchesKeepAllWorkersBusy) {
  JobRecord job = {.intervals_total = 400};
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kIntervals, 2), 8) << "little at first: nothing is measured";
  job.intervals_done = 10;
  job.interval_seconds = 5;
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kIntervals, 2), 50) << "a quarter of a worker's share, 25 s";
  job.interval_seconds = 20;
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kIntervals, 2), 30) << "60 s at 2 s each";
  job.interval_seconds = 5000;
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kIntervals, 2), 1);
  job.intervals_total = 4;
  EXPECT_EQ(IntervalsPerBatch(job, TaskKind::kIntervals, 2), 1);
}

}  // namespace
}  // namespace depthtween::server
