// The promises of server/store/store.h, method by method. Expected values are those promises, worked out by hand.
#include "tests/server/store/store_conformance.h"

#include <set>
#include <utility>

#include "absl/strings/str_format.h"

namespace depthtween::server {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr int64_t kRoom = int64_t{1} << 40;

Recording SomeRecording() {
  return {.camera = {.width = 64, .height = 48, .fx = 50, .fy = 51, .cx = 31.5, .cy = 23.5, .k1 = 0.01},
          .depth_scale = 5000,
          .color_frame_count = 9,
          .depth_frame_count = 2,
          .first_time_ns = -5,
          .last_time_ns = 1305031102175304000,
          .median_depth_m = 1.25};
}

JobPlan PlanOf(int intervals) {
  JobPlan plan;
  for (int i = 0; i < intervals; ++i) {
    plan.intervals.push_back({.index = i, .first_frame = 2 * i, .frame_count = 2});
    for (int frame = 2 * i; frame < 2 * i + 2; ++frame) {
      plan.frames.push_back({.index = frame, .time_ns = 1000 + frame, .stem = absl::StrFormat("%06d", frame)});
    }
  }
  return plan;
}

SequenceRecord StoreConformance::UploadedSequence() {
  const SequenceRecord sequence = Take(store().CreateSequence(kTenant, "clip", ""));
  const UploadRecord upload =
      Take(store().CreateUpload(kTenant, sequence.id, {{.path = "rgb.txt", .size_bytes = 3}}, kRoom, ""));
  EXPECT_THAT(store().SetCommittedSize(upload.id, 3), IsOk());
  EXPECT_THAT(store().FinishUpload(upload.id), IsOk());
  return Take(store().GetSequence(kTenant, sequence.id));
}

SequenceRecord StoreConformance::ReadySequence() {
  const SequenceRecord sequence = UploadedSequence();
  EXPECT_THAT(store().CommitSequence(kTenant, sequence.id), IsOk());
  EXPECT_THAT(store().FinishValidation(Claim().number, {.recording = SomeRecording()}), IsOk());
  return Take(store().GetSequence(kTenant, sequence.id));
}

JobRecord StoreConformance::PreparedJob(int intervals) {
  const JobRecord job = Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id}, "", false));
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(intervals)), IsOk());
  return Job(job.id);
}

Task StoreConformance::Claim(int batch) {
  return Take(store().ClaimTask([batch](const JobRecord&, TaskKind) { return batch; })).value_or(Task{});
}

// ---- sequences and uploads ----

TEST_P(StoreConformance, SequenceSurvivesReopening) {
  const SequenceRecord made = Take(store().CreateSequence(kTenant, "my clip", ""));
  EXPECT_EQ(made.id.size(), 16U);
  Open();
  const SequenceRecord read = Take(store().GetSequence(kTenant, made.id));
  EXPECT_EQ(read.display_name, "my clip");
  EXPECT_EQ(read.state, SequenceState::kUploading);
  EXPECT_EQ(read.create_time, made.create_time);
  EXPECT_THAT(store().GetSequence(kTenant, "0000000000000000"),
              HasReason(absl::StatusCode::kNotFound, "NO_SUCH_RESOURCE"));
}

TEST_P(StoreConformance, SameRequestMakesTheSameThing) {
  const SequenceRecord first = Take(store().CreateSequence(kTenant, "a", "request-1"));
  EXPECT_EQ(Take(store().CreateSequence(kTenant, "a", "request-1")).id, first.id);
  EXPECT_THAT(store().CreateSequence(kTenant, "b", "request-1"),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
  EXPECT_NE(Take(store().CreateSequence(kTenant, "a", "")).id, Take(store().CreateSequence(kTenant, "a", "")).id);

  const std::vector<UploadFile> files = {{.path = "rgb.txt", .size_bytes = 3}};
  const UploadRecord upload = Take(store().CreateUpload(kTenant, first.id, files, kRoom, "request-1"));
  // A resumed upload needs no room any more.
  EXPECT_EQ(Take(store().CreateUpload(kTenant, first.id, files, 0, "request-1")).id, upload.id);
  EXPECT_THAT(store().CreateUpload(kTenant, first.id, {{.path = "rgb.txt", .size_bytes = 4}}, kRoom, "request-1"),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));

  // What was deleted may be made anew.
  EXPECT_THAT(store().DeleteSequence(kTenant, first.id), IsOk());
  const SequenceRecord second = Take(store().CreateSequence(kTenant, "b", "request-1"));
  EXPECT_NE(second.id, first.id);
  EXPECT_THAT(store().CreateUpload(kTenant, second.id, files, kRoom, "request-1"), IsOk());
}

TEST_P(StoreConformance, ListsNewestFirstInPages) {
  std::vector<std::string> newest_first;
  for (int i = 0; i < 5; ++i) {
    newest_first.insert(newest_first.begin(), Take(store().CreateSequence(kTenant, absl::StrCat(i), "")).id);
  }
  std::vector<std::string> listed;
  PageRequest request{.size = 2};
  int pages = 0;
  do {
    const Page<SequenceRecord> page = Take(store().ListSequences(kTenant, {}, request));
    for (const SequenceRecord& record : page.items) listed.push_back(record.id);
    request.token = page.next_token;
    // What comes into being meanwhile is not part of later pages.
    if (++pages == 1) {
      EXPECT_THAT(store().CreateSequence(kTenant, "later", ""), IsOk());
    }
  } while (!request.token.empty());
  EXPECT_EQ(listed, newest_first);
  EXPECT_EQ(pages, 3);
  EXPECT_THAT(Take(store().ListSequences(kTenant, {.state = SequenceState::kReady}, {})).items, IsEmpty());
}

TEST_P(StoreConformance, PageTokenBelongsToItsListAndFilter) {
  for (int i = 0; i < 3; ++i) EXPECT_THAT(store().CreateSequence(kTenant, "", ""), IsOk());
  const std::string token = Take(store().ListSequences(kTenant, {}, {.size = 1})).next_token;
  EXPECT_THAT(store().ListSequences(kTenant, {.state = SequenceState::kUploading}, {.size = 1, .token = token}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(store().ListJobs(kTenant, {}, {.size = 1, .token = token}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(store().ListSequences(kTenant, {}, {.size = 1, .token = "nonsense"}),
              HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(store().ListSequences(kTenant, {}, {.size = 0}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(store().ListSequences(kTenant, {}, {.size = 1001}), HasCode(absl::StatusCode::kInvalidArgument));
}

TEST_P(StoreConformance, UploadRefusesBadManifests) {
  const SequenceRecord sequence = Take(store().CreateSequence(kTenant, "", ""));
  const auto start = [&](std::vector<UploadFile> files) {
    return store().CreateUpload(kTenant, sequence.id, files, kRoom, "");
  };
  EXPECT_THAT(start({}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(start({{.path = "../etc/passwd", .size_bytes = 1}}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(start({{.path = "a", .size_bytes = -1}}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(start({{.path = "a", .size_bytes = 1, .sha256 = "short"}}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(start({{.path = "a"}, {.path = "a"}}), HasReason(absl::StatusCode::kAlreadyExists, "DUPLICATE_PATH"));
  EXPECT_THAT(start({{.path = "a"}, {.path = "a/b"}}), HasReason(absl::StatusCode::kAlreadyExists, "DUPLICATE_PATH"));
  // Two of these would overflow 64 bits.
  const int64_t huge = INT64_MAX - 1;
  EXPECT_THAT(start({{.path = "a", .size_bytes = huge}, {.path = "b", .size_bytes = huge}}),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(store().CreateUpload(kTenant, sequence.id, {{.path = "a", .size_bytes = 9}}, 8, ""),
              HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  // None of them has left anything behind.
  EXPECT_EQ(Take(store().GetSequence(kTenant, sequence.id)).file_count, 0);

  EXPECT_THAT(start({{.path = "x/y", .size_bytes = 7}, {.path = "z"}}), IsOk());
  EXPECT_THAT(start({{.path = "x/y"}}), HasReason(absl::StatusCode::kAlreadyExists, "DUPLICATE_PATH"));
  EXPECT_THAT(start({{.path = "x"}}), HasReason(absl::StatusCode::kAlreadyExists, "DUPLICATE_PATH"));
  EXPECT_THAT(start({{.path = "z/a"}}), HasReason(absl::StatusCode::kAlreadyExists, "DUPLICATE_PATH"));
  EXPECT_THAT(start({{.path = "x.y"}, {.path = "x/z"}}), IsOk());
  const SequenceRecord after = Take(store().GetSequence(kTenant, sequence.id));
  EXPECT_EQ(after.file_count, 4);
  EXPECT_EQ(after.size_bytes, 7);
}

TEST_P(StoreConformance, LimitsHold) {
  Open({.max_sequence_bytes = 10,
        .max_files_per_sequence = 3,
        .max_files_per_upload = 2,
        .max_queued_jobs = 1,
        .max_display_name_bytes = 4,
        .max_request_id_bytes = 4});
  EXPECT_THAT(store().CreateSequence(kTenant, "12345", ""), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(store().CreateSequence(kTenant, "1234", "12345"), HasCode(absl::StatusCode::kInvalidArgument));
  const std::string id = Take(store().CreateSequence(kTenant, "1234", "1234")).id;
  const auto start = [&](std::vector<UploadFile> files) { return store().CreateUpload(kTenant, id, files, kRoom, ""); };
  EXPECT_THAT(start({{.path = "a"}, {.path = "b"}, {.path = "c"}}),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(start({{.path = "a", .size_bytes = 11}}),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(start({{.path = "a", .size_bytes = 6}, {.path = "b"}}), IsOk());
  EXPECT_THAT(start({{.path = "c", .size_bytes = 5}}),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(start({{.path = "c"}, {.path = "d"}}), HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_THAT(start({{.path = "c", .size_bytes = 4}}), IsOk());

  const SequenceRecord ready = ReadySequence();
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = ready.id}, "", false), IsOk());
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = ready.id}, "", false),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
}

TEST_P(StoreConformance, UploadKnowsHowFarItIs) {
  const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
  const std::vector<UploadFile> files = {
      {.path = "a", .size_bytes = 3}, {.path = "b"}, {.path = "c", .size_bytes = 4, .sha256 = std::string(32, '\xAB')}};
  const UploadRecord upload = Take(store().CreateUpload(kTenant, id, files, kRoom, ""));
  EXPECT_EQ(upload.size_bytes, 7);
  EXPECT_EQ(upload.committed_size, 0);
  EXPECT_THAT(store().SetCommittedSize(upload.id, 5), IsOk());
  EXPECT_THAT(store().SetCommittedSize(upload.id, 8), HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(store().FinishUpload(upload.id), HasReason(absl::StatusCode::kFailedPrecondition, "WRONG_STATE"));
  EXPECT_THAT(store().CommitSequence(kTenant, id), HasReason(absl::StatusCode::kFailedPrecondition, "WRONG_STATE"));
  Open();
  EXPECT_EQ(Take(store().GetUpload(kTenant, id, upload.id)).committed_size, 5);
  EXPECT_THAT(store().GetUpload(kTenant, "0000000000000000", upload.id), HasCode(absl::StatusCode::kNotFound));
  const std::vector<UploadFile> read = Take(store().UploadFiles(upload.id));
  ASSERT_THAT(read, SizeIs(3));
  EXPECT_EQ(read[0].path + read[1].path + read[2].path, "abc");
  EXPECT_EQ(read[2].sha256, files[2].sha256);

  EXPECT_THAT(store().SetCommittedSize(upload.id, 7), IsOk());
  EXPECT_TRUE(Take(store().FinishUpload(upload.id)).finished);
  EXPECT_TRUE(Take(store().FinishUpload(upload.id)).finished);
  EXPECT_THAT(store().SetCommittedSize(upload.id, 3), HasCode(absl::StatusCode::kFailedPrecondition));
}

TEST_P(StoreConformance, CommittedSequenceTakesNoMoreFiles) {
  const std::string empty = Take(store().CreateSequence(kTenant, "", "")).id;
  EXPECT_THAT(store().CommitSequence(kTenant, empty), HasCode(absl::StatusCode::kFailedPrecondition));
  const std::string id = UploadedSequence().id;
  EXPECT_EQ(Take(store().CommitSequence(kTenant, id)).state, SequenceState::kValidating);
  EXPECT_EQ(Take(store().CommitSequence(kTenant, id)).state, SequenceState::kValidating);
  EXPECT_THAT(store().CreateUpload(kTenant, id, {{.path = "more"}}, kRoom, ""),
              HasCode(absl::StatusCode::kFailedPrecondition));
  // Committed twice, validated once.
  EXPECT_EQ(Claim().kind, TaskKind::kValidate);
  EXPECT_EQ(Claim().number, 0);
}

TEST_P(StoreConformance, DeletedWhileItIsValidated) {
  const std::string waiting = UploadedSequence().id, running = UploadedSequence().id;
  EXPECT_THAT(store().CommitSequence(kTenant, running), IsOk());
  EXPECT_THAT(store().CommitSequence(kTenant, waiting), IsOk());
  const Task task = Claim();
  EXPECT_EQ(task.sequence_id, running);
  EXPECT_THAT(store().DeleteSequence(kTenant, waiting), IsOk());
  EXPECT_THAT(store().DeleteSequence(kTenant, running), IsOk());
  EXPECT_THAT(store().GetSequence(kTenant, running), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(store().FinishValidation(task.number, {}), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().ReleaseTask(task.number), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Claim().number, 0);
}

TEST_P(StoreConformance, ValidationsGoFirstLastOrNotAtAll) {
  const std::string ready = ReadySequence().id, committed = UploadedSequence().id;
  const auto claim = [&](ClaimValidations validations) {
    const auto batch = [](const JobRecord&, TaskKind) { return 1; };
    return Take(store().ClaimTask(batch, validations)).value_or(Task{});
  };
  EXPECT_THAT(store().CommitSequence(kTenant, committed), IsOk());
  EXPECT_EQ(claim(ClaimValidations::kNone).number, 0);
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = ready}, "", false), IsOk());
  EXPECT_EQ(claim(ClaimValidations::kLast).kind, TaskKind::kPrepare);
  const Task last = claim(ClaimValidations::kLast);
  EXPECT_EQ(last.kind, TaskKind::kValidate);
  EXPECT_THAT(store().ReleaseTask(last.number), IsOk());
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = ready}, "", false), IsOk());
  EXPECT_EQ(claim(ClaimValidations::kFirst).kind, TaskKind::kValidate);
}

// Of two tenants the one whose sequences came later, and all at once for the other.
TEST_P(StoreConformance, TenantsTakeTurnsAtValidations) {
  const Tenant other("other");
  const auto committed = [&](const Tenant& tenant) {
    const std::string id = Take(store().CreateSequence(tenant, "", "")).id;
    const UploadRecord upload = Take(store().CreateUpload(tenant, id, {{.path = "empty"}}, kRoom, ""));
    EXPECT_THAT(store().FinishUpload(upload.id), IsOk());
    EXPECT_THAT(store().CommitSequence(tenant, id), IsOk());
    return id;
  };
  const std::string first = committed(kTenant), second = committed(kTenant), theirs = committed(other);
  EXPECT_EQ(Claim().sequence_id, first);
  EXPECT_EQ(Claim().sequence_id, theirs);
  EXPECT_EQ(Claim().sequence_id, second);
}

TEST_P(StoreConformance, ValidationIsKept) {
  const std::string id = UploadedSequence().id;
  EXPECT_THAT(store().CommitSequence(kTenant, id), IsOk());
  const Task task = Claim();
  EXPECT_EQ(task.sequence_id, id);
  EXPECT_THAT(
      store().FinishValidation(
          task.number, {.violations = {{.file = "depth/1.png", .status = absl::DataLossError("cut \xFF short")}},
                        .warnings = {"odd"}}),
      IsOk());
  Open();
  const SequenceRecord invalid = Take(store().GetSequence(kTenant, id));
  EXPECT_EQ(invalid.state, SequenceState::kInvalid);
  ASSERT_THAT(invalid.validation.violations, SizeIs(1));
  EXPECT_EQ(invalid.validation.violations[0].file, "depth/1.png");
  EXPECT_THAT(invalid.validation.violations[0].status, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(invalid.validation.warnings, ElementsAre("odd"));
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = id}, "", false),
              HasCode(absl::StatusCode::kFailedPrecondition));

  const SequenceRecord ready = ReadySequence();
  EXPECT_EQ(ready.state, SequenceState::kReady);
  const Recording expected = SomeRecording();
  const Recording& recording = *ready.validation.recording;
  EXPECT_EQ(recording.camera.fy, expected.camera.fy);
  EXPECT_EQ(recording.camera.k1, expected.camera.k1);
  EXPECT_EQ(recording.first_time_ns, expected.first_time_ns);
  EXPECT_EQ(recording.last_time_ns, expected.last_time_ns);
  EXPECT_EQ(recording.median_depth_m, expected.median_depth_m);
}

// ---- jobs ----

TEST_P(StoreConformance, JobIsCheckedBeforeItIsMade) {
  const std::string ready = ReadySequence().id;
  const auto create = [&](NewJob job) { return store().CreateJob(kTenant, job, "", false); };
  EXPECT_THAT(create({.sequence_id = "0000000000000000"}), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(create({.sequence_id = UploadedSequence().id}), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(create({.sequence_id = ready, .options = R"({"method":"magic"})"}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(create({.sequence_id = ready, .options = R"({"key_every":0})"}),
              HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(create({.sequence_id = ready, .threads = -1}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(create({.sequence_id = ready, .options = R"({"preset":"turbo"})"}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(create({.sequence_id = ready, .options = R"({"without":["luck"]})"}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(create({.sequence_id = ready, .options = R"({"method":"hold","preset":"fast"})"}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_EQ(Take(store().CreateJob(kTenant, {.sequence_id = ready}, "", /*validate_only=*/true)).id, "");
  EXPECT_THAT(Take(store().ListJobs(kTenant, {}, {})).items, IsEmpty());

  const NewJob job = {
      .display_name = "d", .sequence_id = ready, .options = R"({"method":"hold","key_every":8})", .threads = 2};
  const JobRecord made = Take(store().CreateJob(kTenant, job, "r", false));
  EXPECT_EQ(Take(store().CreateJob(kTenant, job, "r", false)).id, made.id);
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = ready}, "r", false),
              HasCode(absl::StatusCode::kAlreadyExists));
  Open();
  const JobRecord read = Job(made.id);
  EXPECT_THAT(read.options, HasSubstr(R"("key_every":8)"));
  EXPECT_THAT(read.options, HasSubstr(R"("method":"hold")"));
  EXPECT_THAT(read.options, HasSubstr(R"("preset":"balanced")")) << "what was left out has its default";
  EXPECT_EQ(read.threads, 2);
  EXPECT_EQ(read.state, JobState::kQueued);
  EXPECT_EQ(read.attempt, 1);
  EXPECT_EQ(read.recording.depth_scale, 5000);
  EXPECT_EQ(read.start_time, absl::InfiniteFuture());

  NewJob ablation = {.sequence_id = ready, .options = R"({"preset":"fast","without":["draw","median"]})"};
  const JobRecord ablated = Take(store().CreateJob(kTenant, ablation, "a", false));
  Open();
  EXPECT_THAT(Job(ablated.id).options, HasSubstr(R"("without":["draw","median"])"));
  ablation.options = R"({"preset":"fast","without":["draw"]})";
  EXPECT_THAT(store().CreateJob(kTenant, ablation, "a", false), HasCode(absl::StatusCode::kAlreadyExists));
}

TEST_P(StoreConformance, JobsAreListedByStateAndSequence) {
  const std::string a = ReadySequence().id, b = ReadySequence().id;
  const std::string a1 = Take(store().CreateJob(kTenant, {.sequence_id = a}, "", false)).id;
  const std::string b1 = Take(store().CreateJob(kTenant, {.sequence_id = b}, "", false)).id;
  const std::string a2 = Take(store().CreateJob(kTenant, {.sequence_id = a}, "", false)).id;
  EXPECT_THAT(store().CancelJob(kTenant, a1), IsOk());
  const auto ids = [&](const JobFilter& filter) {
    std::vector<std::string> found;
    for (const JobRecord& job : Take(store().ListJobs(kTenant, filter, {})).items) found.push_back(job.id);
    return found;
  };
  EXPECT_THAT(ids({}), ElementsAre(a2, b1, a1));
  EXPECT_THAT(ids({.sequence_id = a}), ElementsAre(a2, a1));
  EXPECT_THAT(ids({.state = JobState::kQueued}), ElementsAre(a2, b1));
  EXPECT_THAT(ids({.state = JobState::kCancelled, .sequence_id = b}), IsEmpty());
  EXPECT_EQ(Job(b1).queue_position, 0);
  EXPECT_EQ(Job(a2).queue_position, 1);
  EXPECT_EQ(Job(a1).queue_position, std::nullopt);
}

TEST_P(StoreConformance, WholeLifeOfAJob) {
  const std::string sequence = ReadySequence().id;
  const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const Task prepare = Claim();
  EXPECT_EQ(prepare.kind, TaskKind::kPrepare);
  EXPECT_EQ(prepare.job_id, id);
  EXPECT_EQ(prepare.sequence_id, sequence);
  EXPECT_EQ(Job(id).state, JobState::kRunning);
  EXPECT_NE(Job(id).start_time, absl::InfiniteFuture());
  EXPECT_EQ(Claim().number, 0) << "nothing to do before the plan is known";
  EXPECT_THAT(store().FinishPrepare(prepare.number, PlanOf(3)), IsOk());
  EXPECT_EQ(Job(id).intervals_total, 3);
  EXPECT_EQ(Job(id).frames_total, 6);

  const Task first = Claim(), second = Claim();
  EXPECT_EQ(first.kind, TaskKind::kIntervals);
  EXPECT_EQ(std::pair(first.first_interval, first.interval_count), std::pair(0, 2));
  EXPECT_EQ(std::pair(second.first_interval, second.interval_count), std::pair(2, 1));
  EXPECT_EQ(Claim().number, 0);

  EXPECT_EQ(Take(store().FinishInterval(second.number, 2, 0.5)).frames_done, 2);
  EXPECT_EQ(Take(store().FinishInterval(second.number, 2, 0.5)).frames_done, 2) << "repeating changes nothing";
  EXPECT_THAT(store().FinishInterval(second.number, 1, 0.5), HasCode(absl::StatusCode::kInternal)) << "not its own";
  EXPECT_THAT(store().CompleteTask(second.number), IsOk());
  const std::vector<FrameRecord> frames = Take(store().JobFrames(kTenant, id, 3, 2));
  ASSERT_THAT(frames, SizeIs(2));
  EXPECT_EQ(frames[0].index, 3);
  EXPECT_EQ(frames[0].time_ns, 1003);
  EXPECT_EQ(frames[0].stem, "000003");
  EXPECT_FALSE(frames[0].ready);
  EXPECT_TRUE(frames[1].ready);
  EXPECT_THAT(Take(store().JobFrames(kTenant, id, 5, 100)), SizeIs(1));
  EXPECT_THAT(Take(store().JobIntervals(id, 1, 100)), SizeIs(2));

  EXPECT_THAT(store().FinishInterval(first.number, 0, 1.0), IsOk());
  EXPECT_THAT(store().FinishInterval(first.number, 1, 1.5), IsOk());
  EXPECT_THAT(store().CompleteTask(first.number), IsOk());
  EXPECT_EQ(Job(id).interval_seconds, 3.0);
  const Task assemble = Claim();
  EXPECT_EQ(assemble.kind, TaskKind::kAssemble);
  EXPECT_EQ(Job(id).state, JobState::kRunning);
  EXPECT_THAT(store().DeleteSequence(kTenant, sequence), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().DeleteJob(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().CompleteTask(assemble.number), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kSucceeded);
  EXPECT_NE(Job(id).end_time, absl::InfiniteFuture());
  EXPECT_EQ(Claim().number, 0);

  EXPECT_THAT(store().CancelJob(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().RetryJob(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().DeleteSequence(kTenant, sequence), IsOk());
  EXPECT_THAT(Take(store().JobFrames(kTenant, id, 0, 100)), SizeIs(6)) << "a job outlives its sequence";
  EXPECT_THAT(store().DeleteJob(kTenant, id), IsOk());
  EXPECT_THAT(store().GetJob(kTenant, id), HasCode(absl::StatusCode::kNotFound));
}

TEST_P(StoreConformance, OlderJobsAndValidationsGoFirst) {
  const JobRecord older = PreparedJob(2);
  const std::string younger = Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id}, "", false)).id;
  EXPECT_THAT(store().CommitSequence(kTenant, UploadedSequence().id), IsOk());
  EXPECT_EQ(Claim(1).kind, TaskKind::kValidate);
  EXPECT_EQ(Claim(1).job_id, older.id);
  EXPECT_EQ(Claim(1).job_id, older.id);
  EXPECT_EQ(Claim(1).job_id, younger);
  EXPECT_EQ(Claim(1).number, 0);
}

TEST_P(StoreConformance, BatchSizeIsAskedWithTheJobAsItIs) {
  PreparedJob(4);
  int asked_done = -1;
  const auto claim = [&](int size) {
    return Take(store().ClaimTask([&](const JobRecord& job, TaskKind) {
      asked_done = job.intervals_done;
      return size;
    }));
  };
  const Task first = *claim(0);  // an answer below 1 counts as 1
  EXPECT_EQ(first.interval_count, 1);
  EXPECT_THAT(store().FinishInterval(first.number, 0, 1), IsOk());
  EXPECT_EQ(claim(100)->interval_count, 3);
  EXPECT_EQ(asked_done, 1);
}

// ---- when things go wrong ----

TEST_P(StoreConformance, ReleasedWorkLosesItsClaimButNotWhatIsDone) {
  const std::string id = PreparedJob(4).id;
  const Task before = Claim(4);
  EXPECT_THAT(store().FinishInterval(before.number, 1, 1), IsOk());
  // As after kill -9.
  Open();
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  // The fence: whoever still works on the old claim changes nothing.
  EXPECT_THAT(store().FinishInterval(before.number, 0, 1), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().CompleteTask(before.number), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().FailTask(before.number, absl::InternalError("late"), false),
              HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Job(id).intervals_done, 1);
  // Batches never reach over an interval that is done.
  const Task a = Claim(4), b = Claim(4);
  EXPECT_EQ(std::pair(a.first_interval, a.interval_count), std::pair(0, 1));
  EXPECT_EQ(std::pair(b.first_interval, b.interval_count), std::pair(2, 2));
  EXPECT_GT(a.number, before.number);
}

TEST_P(StoreConformance, EveryKindOfTaskComesBackAfterARestart) {
  const std::string uploaded = UploadedSequence().id;
  EXPECT_THAT(store().CommitSequence(kTenant, uploaded), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kValidate);
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  const Task validate = Claim();
  EXPECT_EQ(validate.kind, TaskKind::kValidate);
  EXPECT_THAT(store().FinishValidation(validate.number, {.recording = SomeRecording()}), IsOk());

  const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = uploaded}, "", false)).id;
  EXPECT_EQ(Claim().kind, TaskKind::kPrepare);
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  const Task prepare = Claim();
  EXPECT_EQ(prepare.kind, TaskKind::kPrepare);
  EXPECT_THAT(store().FinishPrepare(prepare.number, PlanOf(1)), IsOk());
  const Task intervals = Claim();
  EXPECT_THAT(store().FinishInterval(intervals.number, 0, 1), IsOk());
  // Killed between the last interval and the end of its task: assembling still follows.
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kAssemble);
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  const Task assemble = Claim();
  EXPECT_EQ(assemble.kind, TaskKind::kAssemble);
  EXPECT_THAT(store().CompleteTask(assemble.number), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kSucceeded);
}

TEST_P(StoreConformance, ThreeFailuresOfOneIntervalFailTheJob) {
  const std::string id = PreparedJob(3).id;
  for (int attempt = 1; attempt <= kMaxAttempts; ++attempt) {
    EXPECT_EQ(Job(id).state, JobState::kRunning);
    const Task task = Claim(3);
    // Interval 0 goes well the first time; interval 1 is the one that crashes, every time.
    EXPECT_EQ(task.first_interval, attempt == 1 ? 0 : 1);
    EXPECT_EQ(task.failures, attempt == 1 ? 0 : attempt - 1);
    if (attempt == 1) {
      EXPECT_THAT(store().FinishInterval(task.number, 0, 1), IsOk());
    }
    EXPECT_THAT(store().FailTask(task.number, absl::InternalError("killed by SIGSEGV"), /*retry=*/true), IsOk());
  }
  const JobRecord failed = Job(id);
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(std::string(failed.error.message()), HasSubstr("SIGSEGV"));
  EXPECT_EQ(Claim().number, 0);

  const JobRecord retried = Take(store().RetryJob(kTenant, id));
  EXPECT_EQ(retried.state, JobState::kQueued);
  EXPECT_EQ(retried.attempt, 2);
  EXPECT_THAT(retried.error, IsOk());
  EXPECT_EQ(retried.intervals_done, 1);
  const Task again = Claim(3);
  EXPECT_EQ(std::pair(again.first_interval, again.interval_count), std::pair(1, 2));
  EXPECT_EQ(again.failures, 0);
  EXPECT_EQ(Job(id).state, JobState::kRunning);
}

TEST_P(StoreConformance, FailureThatIsNotWorthRetryingFailsAtOnce) {
  const std::string id = PreparedJob(4).id;
  const Task first = Claim(2), second = Claim(2);
  EXPECT_THAT(store().FailTask(first.number, FileLost("jobs/1/outputs/depth", 3), /*retry=*/false), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kFailed);
  EXPECT_EQ(Job(id).error, FileLost("jobs/1/outputs/depth", 3)) << "with its reason";
  EXPECT_THAT(store().FinishInterval(second.number, 2, 1), HasCode(absl::StatusCode::kFailedPrecondition));

  // A prepare task counts its own failures.
  const std::string other = Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id}, "", false)).id;
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    const Task task = Claim();
    EXPECT_EQ(task.job_id, other);
    EXPECT_EQ(task.failures, attempt);
    EXPECT_THAT(store().FailTask(task.number, absl::InternalError("crash"), /*retry=*/true), IsOk());
  }
  EXPECT_EQ(Job(other).state, JobState::kFailed);
  EXPECT_THAT(Job(other).error, HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(store().RetryJob(kTenant, other), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kPrepare);
  EXPECT_EQ(Take(store().RetryJob(kTenant, id)).error, absl::OkStatus());
}

TEST_P(StoreConformance, ValidationThatCannotBeDoneMakesTheSequenceInvalid) {
  const std::string id = UploadedSequence().id;
  EXPECT_THAT(store().CommitSequence(kTenant, id), IsOk());
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    EXPECT_EQ(Take(store().GetSequence(kTenant, id)).state, SequenceState::kValidating);
    EXPECT_THAT(store().FailTask(Claim().number, absl::InternalError("killed by SIGSEGV"), /*retry=*/true), IsOk());
  }
  const SequenceRecord sequence = Take(store().GetSequence(kTenant, id));
  EXPECT_EQ(sequence.state, SequenceState::kInvalid);
  EXPECT_THAT(sequence.validation.error, HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(store().DeleteSequence(kTenant, id), IsOk());
}

TEST_P(StoreConformance, CancelWaitsForWhatRuns) {
  const std::string queued = Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id}, "", false)).id;
  EXPECT_EQ(Take(store().CancelJob(kTenant, queued)).state, JobState::kCancelled);
  EXPECT_EQ(Claim().number, 0);

  const std::string id = PreparedJob(4).id;
  const Task first = Claim(2), second = Claim(1);
  EXPECT_EQ(Take(store().CancelJob(kTenant, id)).state, JobState::kCancelling);
  EXPECT_EQ(Take(store().CancelJob(kTenant, id)).state, JobState::kCancelling);
  EXPECT_EQ(Claim().number, 0) << "nothing of a cancelled job starts any more";
  EXPECT_THAT(store().FinishInterval(first.number, 0, 1), IsOk()) << "what ends while it is stopped is kept";
  EXPECT_THAT(store().ReleaseTask(first.number), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelling);
  // A child that crashes when it is told to stop does not make the job fail.
  EXPECT_THAT(store().FailTask(second.number, absl::InternalError("crash"), /*retry=*/false), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelled);
  EXPECT_THAT(Job(id).error, IsOk());
  EXPECT_EQ(Take(store().CancelJob(kTenant, id)).state, JobState::kCancelled);

  EXPECT_EQ(Take(store().RetryJob(kTenant, id)).intervals_done, 1);
  EXPECT_EQ(Claim(4).first_interval, 1);
}

TEST_P(StoreConformance, CancelledWhilePreparingOrAssembling) {
  const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id}, "", false)).id;
  const Task prepare = Claim();
  EXPECT_THAT(store().CancelJob(kTenant, id), IsOk());
  EXPECT_THAT(store().FinishPrepare(prepare.number, PlanOf(1)), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelled);
  EXPECT_THAT(store().RetryJob(kTenant, id), IsOk());
  const Task intervals = Claim();
  EXPECT_EQ(intervals.kind, TaskKind::kIntervals) << "the plan is kept";
  EXPECT_THAT(store().FinishInterval(intervals.number, 0, 1), IsOk());
  EXPECT_THAT(store().CompleteTask(intervals.number), IsOk());
  const Task assemble = Claim();
  EXPECT_THAT(store().CancelJob(kTenant, id), IsOk());
  EXPECT_THAT(store().CompleteTask(assemble.number), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelled);
  EXPECT_THAT(store().RetryJob(kTenant, id), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kAssemble);
}

TEST_P(StoreConformance, RetryNeedsTheSequence) {
  const SequenceRecord sequence = ReadySequence();
  const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = sequence.id}, "", false)).id;
  EXPECT_THAT(store().RetryJob(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().CancelJob(kTenant, id), IsOk());
  EXPECT_THAT(store().DeleteSequence(kTenant, sequence.id), IsOk());
  EXPECT_THAT(store().RetryJob(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
}

// ---- self-check ----

SelfCheck SomeSelfCheck() {
  return {.summary = "ours errs by 7.1 mm",
          .maps_checked = 12,
          .maps_held_out = 40,
          .pixels = int64_t{1} << 40,
          .methods = {{.name = "ours",
                       .rmse_mm = 7.1,
                       .mae_mm = 1.0 / 3.0,
                       .edge_band_rmse_mm = 20.5,
                       .completeness = 0.99,
                       .within_one_sigma = 0.7},
                      {.name = "hold", .rmse_mm = 70, .mae_mm = 50, .completeness = 1}},
          .worst_frames = {{.frame = 17, .stem = "000017", .time_ns = 1305031102175304000, .rmse_mm = 9.25}},
          .sensor_floor = SelfCheck::Floor{.rmse_mm = 2.5, .mae_mm = 1.5},
          .seconds = 3.5};
}

void ExpectSame(const std::optional<SelfCheck>& check, const SelfCheck& expected) {
  ASSERT_TRUE(check.has_value());
  EXPECT_EQ(check->summary, expected.summary);
  EXPECT_EQ(check->reason, expected.reason);
  EXPECT_EQ(check->maps_checked, expected.maps_checked);
  EXPECT_EQ(check->maps_held_out, expected.maps_held_out);
  EXPECT_EQ(check->pixels, expected.pixels);
  ASSERT_EQ(check->methods.size(), expected.methods.size());
  for (size_t i = 0; i < expected.methods.size(); ++i) {
    EXPECT_EQ(check->methods[i].name, expected.methods[i].name);
    EXPECT_EQ(check->methods[i].rmse_mm, expected.methods[i].rmse_mm);
    EXPECT_EQ(check->methods[i].mae_mm, expected.methods[i].mae_mm);
    EXPECT_EQ(check->methods[i].edge_band_rmse_mm, expected.methods[i].edge_band_rmse_mm);
    EXPECT_EQ(check->methods[i].completeness, expected.methods[i].completeness);
    EXPECT_EQ(check->methods[i].within_one_sigma, expected.methods[i].within_one_sigma);
  }
  ASSERT_EQ(check->worst_frames.size(), expected.worst_frames.size());
  for (size_t i = 0; i < expected.worst_frames.size(); ++i) {
    EXPECT_EQ(check->worst_frames[i].frame, expected.worst_frames[i].frame);
    EXPECT_EQ(check->worst_frames[i].stem, expected.worst_frames[i].stem);
    EXPECT_EQ(check->worst_frames[i].time_ns, expected.worst_frames[i].time_ns);
    EXPECT_EQ(check->worst_frames[i].rmse_mm, expected.worst_frames[i].rmse_mm);
  }
  ASSERT_EQ(check->sensor_floor.has_value(), expected.sensor_floor.has_value());
  if (expected.sensor_floor) {
    EXPECT_EQ(check->sensor_floor->rmse_mm, expected.sensor_floor->rmse_mm);
    EXPECT_EQ(check->sensor_floor->mae_mm, expected.sensor_floor->mae_mm);
  }
  EXPECT_EQ(check->seconds, expected.seconds);
}

TEST_P(StoreConformance, SelfCheckGoesFirstAndSurvivesReopening) {
  const NewJob order = {.sequence_id = ReadySequence().id, .options = R"({"self_check":true})"};
  const std::string id = Take(store().CreateJob(kTenant, order, "r", false)).id;
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = order.sequence_id}, "r", false),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
  EXPECT_FALSE(Job(id).self_check.has_value());
  Task check = Claim();
  EXPECT_EQ(check.kind, TaskKind::kSelfCheck);
  EXPECT_EQ(check.job_id, id);
  EXPECT_EQ(Claim().number, 0) << "nothing is prepared meanwhile";
  // A server that dies meanwhile begins it anew.
  Open();
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  EXPECT_THAT(store().FinishSelfCheck(check.number, SomeSelfCheck()), HasCode(absl::StatusCode::kFailedPrecondition));
  check = Claim();
  EXPECT_EQ(check.kind, TaskKind::kSelfCheck);
  EXPECT_THAT(store().FinishSelfCheck(check.number, SomeSelfCheck()), IsOk());
  Open();
  EXPECT_TRUE(Job(id).facts.self_check);
  ExpectSame(Job(id).self_check, SomeSelfCheck());
  ExpectSame(Take(store().ListJobs(kTenant, {}, {})).items[0].self_check, SomeSelfCheck());
  const Task prepare = Claim();
  EXPECT_EQ(prepare.kind, TaskKind::kPrepare);
  EXPECT_THAT(store().FailTask(prepare.number, absl::DataLossError("x"), false), IsOk());
  EXPECT_THAT(store().RetryJob(kTenant, id), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kPrepare) << "what was measured is not measured again";
}

TEST_P(StoreConformance, SelfCheckThatFailsIsTriedAgainWithTheJob) {
  const NewJob order = {.sequence_id = ReadySequence().id, .options = R"({"self_check":true})"};
  const std::string id = Take(store().CreateJob(kTenant, order, "", false)).id;
  EXPECT_THAT(store().FailTask(Claim().number, absl::DataLossError("x"), false), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kFailed);
  EXPECT_THAT(store().RetryJob(kTenant, id), IsOk());
  const Task again = Claim();
  EXPECT_EQ(again.kind, TaskKind::kSelfCheck);
  EXPECT_THAT(store().CancelJob(kTenant, id), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelling);
  EXPECT_THAT(store().FinishSelfCheck(again.number, {.summary = "s", .reason = "too short"}), IsOk());
  EXPECT_EQ(Job(id).state, JobState::kCancelled);
  ExpectSame(Job(id).self_check, {.summary = "s", .reason = "too short"});
}

// ---- clock ----

TEST_P(StoreConformance, ClockAndItsEstimateSurviveReopening) {
  const std::string sequence = ReadySequence().id;
  const NewJob order = {.sequence_id = sequence, .options = R"({"clock":"estimate","causal":true})"};
  const std::string id = Take(store().CreateJob(kTenant, order, "r", false)).id;
  for (const char* const other : {R"({"clock":"estimate"})", R"({"causal":true})"}) {
    EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence, .options = other}, "r", false),
                HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
  }
  const ClockEstimate estimate = {
      .reason = "nothing moves",
      .model = {.reference_ns = 1305031102175304000, .offset_ns = 4e6 / 3, .drift_ppm = -300.25},
      .offset_sigma_ns = 5.5,
      .drift_sigma_ppm = 20,
      .stamp_sigma_ns = 7,
      .row_time_ns = 12000,
      .row_time_sigma_ns = 800,
      .keys = 66,
      .edges = int64_t{1} << 40};
  JobPlan plan = PlanOf(2);
  plan.clock_estimate = estimate;
  plan.warnings = {"nothing moves", "\"quoted\" \n"};
  EXPECT_THAT(store().FinishPrepare(Claim().number, plan), IsOk());
  Open();
  const JobRecord job = Job(id);
  EXPECT_THAT(job.options, HasSubstr(R"("clock":"estimate")"));
  ASSERT_TRUE(job.clock_estimate.has_value());
  EXPECT_EQ(depthtween::ToJson(*job.clock_estimate), depthtween::ToJson(estimate));
  EXPECT_EQ(job.warnings, plan.warnings);
}

// What core refuses is refused under the name that the request has for it.
TEST_P(StoreConformance, WrongOptionsNameTheirField) {
  const std::string sequence = ReadySequence().id;
  const std::pair<const char*, const char*> faults[] = {
      {R"({"preset":"reference","literal":["luck"]})", "job.options.literal"},
      {R"({"method":"hold","scene_flow":true})", "job.options.scene_flow"},
      {R"({"causal":true,"scene_flow":true})", "job.options.scene_flow"},
      {R"({"thread":2})", "job.options.thread"},
      {R"({"clock":"sundial"})", "job.options.clock"},
      {"[]", "job.options"}};
  for (const auto& [options, field] : faults) {
    const absl::Status refused =
        store().CreateJob(kTenant, {.sequence_id = sequence, .options = options}, "", false).status();
    EXPECT_THAT(refused, HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << options;
    EXPECT_EQ(GetErrorInfo(refused)->metadata.at("field"), field);
  }
}

// Said or left out: the same order. Any difference: another.
TEST_P(StoreConformance, OptionsArePartOfTheOrder) {
  const std::string sequence = ReadySequence().id;
  const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "r", false)).id;
  const NewJob spelt_out = {.sequence_id = sequence, .options = R"({"preset":"balanced","clock":"stamps"})"};
  EXPECT_EQ(Take(store().CreateJob(kTenant, spelt_out, "r", false)).id, id);
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence, .options = R"({"scene_flow":true})"}, "r", false),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence, .threads = 2}, "r", false),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
}

// Which frames have a file of what is made at the end is not known before, and of jobs that end without such files
// never.
TEST_P(StoreConformance, FramesThatWereAssembledAreRemembered) {
  const std::string sequence = ReadySequence().id;
  for (const std::optional<std::vector<int>>& made :
       {std::optional<std::vector<int>>({0, 2}), std::optional<std::vector<int>>()}) {
    const std::string id = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
    EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(2)), IsOk());
    const Task depth = Claim(2);
    for (const int interval : {0, 1}) EXPECT_THAT(store().FinishInterval(depth.number, interval, 1.0), IsOk());
    EXPECT_THAT(store().CompleteTask(depth.number), IsOk());
    for (const FrameRecord& frame : Take(store().JobFrames(kTenant, id, 0, 10)))
      EXPECT_FALSE(frame.assembled.has_value());
    EXPECT_THAT(store().CompleteTask(Claim().number, made), IsOk());
    EXPECT_EQ(Job(id).state, JobState::kSucceeded);
    Open();
    std::vector<std::optional<bool>> assembled;
    for (const FrameRecord& frame : Take(store().JobFrames(kTenant, id, 0, 10))) assembled.push_back(frame.assembled);
    const std::vector<std::optional<bool>> expected =
        made ? std::vector<std::optional<bool>>{true, false, true, false} : std::vector<std::optional<bool>>(4);
    EXPECT_EQ(assembled, expected);
  }
}

TEST_P(StoreConformance, SceneFlowJobsSurviveReopening) {
  const std::string sequence = ReadySequence().id;
  const NewJob order = {.sequence_id = sequence,
                        .kind = JobKind::kSceneFlow,
                        .options = R"({"method":"pd-flow","formats":["flo"],"every":3,"baseline_m":0.54})",
                        .threads = 2};
  EXPECT_EQ(Take(store().CreateJob(kTenant, order, "", true)).kind, JobKind::kSceneFlow);
  const std::string id = Take(store().CreateJob(kTenant, order, "r", false)).id;
  NewJob other = order;
  other.options = R"({"method":"pd-flow","formats":["flo"],"every":4,"baseline_m":0.54})";
  EXPECT_THAT(store().CreateJob(kTenant, other, "r", false),
              HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
  Open();
  const JobRecord job = Job(id);
  EXPECT_EQ(job.kind, JobKind::kSceneFlow);
  EXPECT_EQ(job.options, R"({"baseline_m":0.54,"every":3,"formats":["npz","flo"],"method":"pd-flow"})");
  EXPECT_EQ(job.facts.outputs.size(), 3U);
  EXPECT_EQ(Job(Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id).kind, JobKind::kUpsample);
}

// Each breaks one rule: of the options themselves, or that nothing of an upsampling goes with them.
TEST_P(StoreConformance, SceneFlowOptionsAreChecked) {
  const NewJob good = {.sequence_id = ReadySequence().id, .kind = JobKind::kSceneFlow};
  EXPECT_THAT(store().CreateJob(kTenant, good, "", true), IsOk());
  const std::vector<std::function<void(NewJob&)>> faults = {
      [](NewJob& job) { job.options = R"({"method":"luck"})"; },
      [](NewJob& job) { job.options = R"({"formats":["npz","exr"]})"; },
      [](NewJob& job) { job.options = R"({"every":0})"; },
      [](NewJob& job) { job.options = R"({"baseline_m":"NaN"})"; },
      [](NewJob& job) { job.options = R"({"preset":"best"})"; },
      [](NewJob& job) { job.renders = {{.options = "{}"}}; },
      [](NewJob& job) { job.depth_from = "0123456789abcdef"; }};
  for (size_t i = 0; i < faults.size(); ++i) {
    NewJob job = good;
    faults[i](job);
    EXPECT_THAT(store().CreateJob(kTenant, job, "", true), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"))
        << i;
  }
}

// ---- renders ----

RenderRecord RenderOf(const std::string& name, int reach_frames, int anchor_frame = -1) {
  return {.name = name,
          .options = "{\"name\":\"" + name + "\"}",
          .reach_frames = reach_frames,
          .anchor_frame = anchor_frame,
          .uses_motion = true,
          .streams = {name + "-left", name + "-right"},
          .extension = "jpg",
          .videos = {name + "_L.mp4", name + "_R.mp4"}};
}

TEST_P(StoreConformance, RendersSurviveReopening) {
  const NewJob order = {.sequence_id = ReadySequence().id, .renders = {RenderOf("a", 3, 5), RenderOf("b", 0)}};
  const std::string id = Take(store().CreateJob(kTenant, order, "", false)).id;
  Open();
  const JobRecord job = Job(id);
  ASSERT_THAT(job.renders, SizeIs(2));
  EXPECT_EQ(job.renders[0].name, "a");
  EXPECT_EQ(job.renders[0].options, order.renders[0].options);
  EXPECT_EQ(job.renders[0].reach_frames, 3);
  EXPECT_EQ(job.renders[0].anchor_frame, 5);
  EXPECT_TRUE(job.renders[0].uses_motion);
  EXPECT_EQ(job.renders[0].streams, order.renders[0].streams);
  EXPECT_EQ(job.renders[0].videos, order.renders[0].videos);
  EXPECT_EQ(job.renders[0].extension, "jpg");
  EXPECT_THAT(Take(store().ListJobs(kTenant, {}, {})).items[0].renders, SizeIs(2));
  // The same request is the same job; with another render it is another request.
  const std::string again = Take(store().CreateJob(kTenant, order, "r", false)).id;
  EXPECT_EQ(Take(store().CreateJob(kTenant, order, "r", false)).id, again);
  EXPECT_THAT(
      store().CreateJob(kTenant, {.sequence_id = order.sequence_id, .renders = {RenderOf("a", 3, 5)}}, "r", false),
      HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
}

// Intervals have two frames; a render that looks one frame to either side needs its neighbours' intervals.
TEST_P(StoreConformance, PicturesWaitForTheFramesAroundThemAndGoBeforeFurtherDepth) {
  const std::string id =
      Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id, .renders = {RenderOf("a", 1)}}, "", false))
          .id;
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(4)), IsOk());
  const Task first = Claim(1);
  EXPECT_EQ(first.kind, TaskKind::kIntervals);
  EXPECT_THAT(store().FinishInterval(first.number, 0, 1.0), IsOk());
  EXPECT_THAT(store().CompleteTask(first.number), IsOk());
  const Task second = Claim(1);
  EXPECT_EQ(second.kind, TaskKind::kIntervals) << "interval 0 looks at interval 1";
  EXPECT_THAT(store().FinishInterval(second.number, 1, 1.0), IsOk());

  const Task pictures = Claim(8);
  EXPECT_EQ(pictures.kind, TaskKind::kRender);
  EXPECT_EQ(pictures.render, 0);
  EXPECT_EQ(pictures.first_interval, 0);
  EXPECT_EQ(pictures.interval_count, 1) << "interval 1 looks at interval 2";
  EXPECT_FALSE(Take(store().JobFrames(kTenant, id, 0, 1, 0))[0].ready);
  EXPECT_EQ(Take(store().FinishInterval(pictures.number, 0, 0.5)).renders[0].frames_done, 2);
  EXPECT_EQ(Take(store().FinishInterval(pictures.number, 0, 0.5)).renders[0].frames_done, 2) << "said again";
  EXPECT_TRUE(Take(store().JobFrames(kTenant, id, 0, 1, 0))[0].ready);
  EXPECT_FALSE(Take(store().JobFrames(kTenant, id, 2, 1, 0))[0].ready);
  EXPECT_EQ(Job(id).renders[0].seconds, 0.5);

  const Task rest = Claim(8);
  EXPECT_EQ(rest.kind, TaskKind::kIntervals);
  EXPECT_EQ(rest.interval_count, 2);
  for (const int interval : {2, 3}) EXPECT_THAT(store().FinishInterval(rest.number, interval, 1.0), IsOk());
  for (const Task& task : {second, pictures, rest}) EXPECT_THAT(store().CompleteTask(task.number), IsOk());
  const Task last = Claim(8);
  EXPECT_EQ(last.kind, TaskKind::kRender);
  EXPECT_EQ(last.first_interval, 1);
  EXPECT_EQ(last.interval_count, 3);
  EXPECT_EQ(Claim().number, 0) << "nothing is assembled before the last picture";
  for (const int interval : {1, 2, 3}) EXPECT_THAT(store().FinishInterval(last.number, interval, 0.5), IsOk());
  EXPECT_THAT(store().CompleteTask(last.number), IsOk());
  EXPECT_EQ(Claim().kind, TaskKind::kAssemble);
  EXPECT_TRUE(Job(id).IsComputed());
}

TEST_P(StoreConformance, AnAnchoredRenderWaitsForItsAnchor) {
  Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id, .renders = {RenderOf("a", 0, 5)}}, "", false));
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(4)), IsOk());
  const Task depth = Claim(4);
  for (const int interval : {0, 1}) EXPECT_THAT(store().FinishInterval(depth.number, interval, 1.0), IsOk());
  EXPECT_EQ(Claim().number, 0) << "frame 5 lies in interval 2";
  EXPECT_THAT(store().FinishInterval(depth.number, 2, 1.0), IsOk());
  EXPECT_EQ(Claim(8).interval_count, 3);
}

TEST_P(StoreConformance, PicturesThatFailAreTriedAgainAndAreTheOnesToBlame) {
  const std::string id =
      Take(store().CreateJob(kTenant, {.sequence_id = ReadySequence().id, .renders = {RenderOf("a", 0)}}, "", false))
          .id;
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(2)), IsOk());
  const Task depth = Claim(2);
  for (const int interval : {0, 1}) EXPECT_THAT(store().FinishInterval(depth.number, interval, 1.0), IsOk());
  EXPECT_THAT(store().CompleteTask(depth.number), IsOk());
  for (int failures = 0; failures < kMaxAttempts; ++failures) {
    const Task task = Claim(2);
    EXPECT_EQ(task.kind, TaskKind::kRender);
    EXPECT_EQ(task.failures, failures);
    EXPECT_THAT(store().FailTask(task.number, absl::InternalError("crashed"), true), IsOk());
  }
  EXPECT_EQ(Job(id).state, JobState::kFailed);
  EXPECT_THAT(store().RetryJob(kTenant, id), IsOk());
  const Task again = Claim(2);
  EXPECT_EQ(again.kind, TaskKind::kRender);
  EXPECT_EQ(again.failures, 0);
  Open();
  EXPECT_THAT(store().ReleaseAllTasks(), IsOk());
  EXPECT_EQ(Claim(2).interval_count, 2) << "a killed server's pictures are rendered again";
}

TEST_P(StoreConformance, DepthIsTakenOverFromAJobThatHasIt) {
  const SequenceRecord sequence = ReadySequence();
  const JobRecord from = Take(store().CreateJob(kTenant, {.sequence_id = sequence.id}, "", false));
  NewJob order = {.sequence_id = sequence.id, .renders = {RenderOf("a", 2)}, .depth_from = from.id};
  EXPECT_THAT(store().CreateJob(kTenant, order, "", false),
              HasReason(absl::StatusCode::kFailedPrecondition, "WRONG_STATE"));
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(2)), IsOk());
  const Task depth = Claim(2);
  for (const int interval : {0, 1}) EXPECT_THAT(store().FinishInterval(depth.number, interval, 1.0), IsOk());
  EXPECT_THAT(store().CompleteTask(depth.number), IsOk());
  EXPECT_THAT(store().CompleteTask(Claim().number), IsOk());

  // The last one: the other job kept no motion to make it from.
  for (const char* const other : {R"({"key_every":2})", R"({"preset":"fast"})", R"({"causal":true})",
                                  R"({"clock":"4"})", R"({"scene_flow":true})"}) {
    order.options = other;
    EXPECT_THAT(store().CreateJob(kTenant, order, "", false),
                HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  }
  order.options = "{}";
  order.renders.clear();
  EXPECT_THAT(store().CreateJob(kTenant, order, "", false), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  order.renders = {RenderOf("a", 2)};
  const JobRecord job = Take(store().CreateJob(kTenant, order, "", false));
  JobPlan plan = PlanOf(2);
  plan.depth_done = true;
  EXPECT_THAT(store().FinishPrepare(Claim().number, plan), IsOk());
  EXPECT_EQ(Job(job.id).frames_done, 4);
  EXPECT_EQ(Claim(8).kind, TaskKind::kRender);
}

TEST_P(StoreConformance, ASelfCheckIsTakenOverWithTheDepth) {
  const SequenceRecord sequence = ReadySequence();
  const NewJob measured = {.sequence_id = sequence.id, .options = R"({"self_check":true})"};
  const std::string from = Take(store().CreateJob(kTenant, measured, "", false)).id;
  EXPECT_THAT(store().FinishSelfCheck(Claim().number, SomeSelfCheck()), IsOk());
  EXPECT_THAT(store().FinishPrepare(Claim().number, PlanOf(1)), IsOk());
  const Task depth = Claim(1);
  EXPECT_THAT(store().FinishInterval(depth.number, 0, 1.0), IsOk());
  EXPECT_THAT(store().CompleteTask(depth.number), IsOk());
  EXPECT_THAT(store().CompleteTask(Claim().number), IsOk());

  NewJob order = {.sequence_id = sequence.id,
                  .options = R"({"self_check":true})",
                  .renders = {RenderOf("a", 0)},
                  .depth_from = from};
  ExpectSame(Take(store().CreateJob(kTenant, order, "", false)).self_check, SomeSelfCheck());
  EXPECT_EQ(Claim().kind, TaskKind::kPrepare) << "it is not measured again";
  order.options = "{}";
  EXPECT_FALSE(Take(store().CreateJob(kTenant, order, "", false)).self_check.has_value()) << "nobody asked";
}

// ---- tenants ----

// What one tenant makes does not exist for another, under any method that names or lists it; the server sees all.
TEST_P(StoreConformance, TenantsSeeNothingOfOneAnother) {
  const Tenant other("other");
  const auto none = HasReason(absl::StatusCode::kNotFound, "NO_SUCH_RESOURCE");
  const SequenceRecord uploading = Take(store().CreateSequence(kTenant, "mine", ""));
  const UploadRecord upload =
      Take(store().CreateUpload(kTenant, uploading.id, {{.path = "rgb.txt", .size_bytes = 3}}, kRoom, ""));
  const JobRecord job = PreparedJob(1);

  EXPECT_THAT(store().GetSequence(other, uploading.id), none);
  EXPECT_THAT(store().DeleteSequence(other, uploading.id), none);
  EXPECT_THAT(store().CommitSequence(other, uploading.id), none);
  EXPECT_THAT(store().CreateUpload(other, uploading.id, {{.path = "x", .size_bytes = 1}}, kRoom, ""), none);
  EXPECT_THAT(store().GetUpload(other, uploading.id, upload.id), none);
  EXPECT_THAT(store().CreateJob(other, {.sequence_id = job.sequence_id}, "", false), none);
  EXPECT_THAT(store().GetJob(other, job.id), none);
  EXPECT_THAT(store().CancelJob(other, job.id), none);
  EXPECT_THAT(store().RetryJob(other, job.id), none);
  EXPECT_THAT(store().DeleteJob(other, job.id), none);
  EXPECT_THAT(store().JobFrames(other, job.id, 0, 1), none);
  EXPECT_THAT(Take(store().ListSequences(other, {}, {})).items, IsEmpty());
  EXPECT_THAT(Take(store().ListJobs(other, {}, {})).items, IsEmpty());

  EXPECT_EQ(Take(store().GetJob(kTenant, job.id)).tenant, kTenant.name());
  EXPECT_THAT(Take(store().ListSequences(kTenant, {}, {})).items, SizeIs(2));
  EXPECT_EQ(Take(store().GetJob(Tenant::Everyone(), job.id)).id, job.id);
  EXPECT_THAT(Take(store().ListJobs(Tenant::Everyone(), {}, {})).items, SizeIs(1));
}

TEST_P(StoreConformance, TenantsShareNeitherRequestIdsNorPageTokens) {
  const Tenant other("other");
  const SequenceRecord mine = Take(store().CreateSequence(kTenant, "a", "request-1"));
  const SequenceRecord theirs = Take(store().CreateSequence(other, "b", "request-1"));
  EXPECT_NE(mine.id, theirs.id);
  EXPECT_EQ(Take(store().CreateSequence(other, "b", "request-1")).id, theirs.id);
  Take(store().CreateSequence(kTenant, "c", ""));
  const Page<SequenceRecord> page = Take(store().ListSequences(kTenant, {}, {.size = 1}));
  ASSERT_FALSE(page.next_token.empty());
  EXPECT_THAT(store().ListSequences(other, {}, {.size = 1, .token = page.next_token}),
              HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
}

TEST_P(StoreConformance, JobsAreCountedByTenantAndState) {
  EXPECT_THAT(Take(store().CountJobs()), IsEmpty());
  const JobRecord running = PreparedJob(1);
  for (int i = 0; i < 2; ++i) Take(store().CreateJob(kTenant, {.sequence_id = running.sequence_id}, "", false));
  std::map<JobState, int> counts;
  for (const Store::JobCount& entry : Take(store().CountJobs())) {
    EXPECT_EQ(entry.tenant, kTenant.name());
    counts[entry.state] = entry.count;
  }
  EXPECT_EQ(counts, (std::map<JobState, int>{{JobState::kQueued, 2}, {JobState::kRunning, 1}}));
}

// What nobody owns could be seen by nobody.
TEST_P(StoreConformance, NothingIsMadeWithoutAnOwner) {
  EXPECT_THAT(store().CreateSequence(Tenant::Everyone(), "", ""), HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(store().CreateJob(Tenant::Everyone(), {.sequence_id = ReadySequence().id}, "", false),
              HasCode(absl::StatusCode::kInternal));
}

// ---- files ----

FileChecksum ChecksumWith(const std::string& path, int64_t size_bytes, const std::string& blocks) {
  return {.path = path, .size_bytes = size_bytes, .blocks = blocks};
}

std::vector<std::string> PathsOf(const std::vector<FileChecksum>& files) {
  std::vector<std::string> paths;
  for (const FileChecksum& file : files) paths.push_back(file.path);
  return paths;
}

// With what is announced, in one transaction: a call that fails keeps none.
TEST_P(StoreConformance, ChecksumsAreKeptWithWhatTheyAreOf) {
  const SequenceRecord sequence = Take(store().CreateSequence(kTenant, "", ""));
  const UploadRecord upload = Take(store().CreateUpload(
      kTenant, sequence.id, {{.path = "a", .size_bytes = 3}, {.path = "b", .size_bytes = 4}}, kRoom, ""));
  EXPECT_THAT(store().SetCommittedSize(upload.id, 8, {ChecksumWith("a", 3, "1234")}),
              HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(Take(store().SequenceFiles(sequence.id)), IsEmpty());
  EXPECT_THAT(store().SetCommittedSize(upload.id, 5, {ChecksumWith("a", 3, "1234")}), IsOk());
  EXPECT_THAT(PathsOf(Take(store().SequenceFiles(sequence.id))), ElementsAre("a"));

  const JobRecord job = PreparedJob(2);
  const Task task = Claim();
  EXPECT_THAT(store().FinishInterval(task.number, 7, 1.0, {ChecksumWith("out/x", 1, "abcd")}),
              HasCode(absl::StatusCode::kInternal));
  EXPECT_EQ(Take(store().JobFile(job.id, "out/x")), std::nullopt);
  EXPECT_THAT(store().FinishInterval(task.number, 0, 1.0, {ChecksumWith("out/y", 1, "abcd")}), IsOk());
  EXPECT_THAT(store().FinishInterval(task.number, 1, 1.0, {ChecksumWith("out/x", 2, std::string("a\0b\xff", 4))}),
              IsOk());
  EXPECT_THAT(store().CompleteTask(task.number), IsOk());
  EXPECT_THAT(store().CompleteTask(Claim().number, std::nullopt, {ChecksumWith("out/y", 9, "efgh")}), IsOk());
  Open();
  EXPECT_THAT(PathsOf(Take(store().JobFiles(job.id))), ElementsAre("out/x", "out/y"));
  EXPECT_EQ(Take(store().JobFile(job.id, "out/x"))->blocks, std::string("a\0b\xff", 4));
  EXPECT_EQ(Take(store().JobFile(job.id, "out/y"))->size_bytes, 9) << "made anew";
  EXPECT_THAT(store().DeleteJob(kTenant, job.id), IsOk());
  EXPECT_THAT(Take(store().JobFiles(job.id)), IsEmpty());
}

TEST_P(StoreConformance, StoredFilesAreListedPageByPage) {
  const SequenceRecord sequence = Take(store().CreateSequence(kTenant, "", ""));
  const UploadRecord upload = Take(store().CreateUpload(
      kTenant, sequence.id, {{.path = "a b", .size_bytes = 3}, {.path = "c", .size_bytes = 4}, {.path = "d"}}, kRoom,
      ""));
  EXPECT_THAT(store().SetCommittedSize(upload.id, 5, {ChecksumWith("a b", 3, "1234")}), IsOk());
  const JobRecord job = PreparedJob(1);
  EXPECT_THAT(store().FinishInterval(Claim().number, 0, 1.0, {ChecksumWith("out/x", 7, "abcd")}), IsOk());
  std::vector<std::string> expected = {"sequences/" + sequence.id + "/a b", "sequences/" + job.sequence_id + "/rgb.txt",
                                       "jobs/" + job.id + "/out/x"};
  for (const int size : {1, 2, 3, 100}) {
    std::vector<std::string> listed;
    PageRequest request{.size = size};
    do {
      const Page<StoredFile> page = Take(store().StoredFiles(request));
      for (const StoredFile& file : page.items) {
        listed.push_back(file.path);
        // The fixture's upload has none, as one of an older version.
        EXPECT_EQ(file.checksum.has_value(), file.path.find("rgb.txt") == std::string::npos);
      }
      request.token = page.next_token;
    } while (!request.token.empty());
    EXPECT_EQ(listed, expected) << size;
  }
  EXPECT_EQ(Take(store().StoredBytes()), 3 + 7);
}

TEST_P(StoreConformance, AScrubIsRemembered) {
  EXPECT_TRUE(Take(store().GetScrub()).over);
  EXPECT_EQ(Take(store().GetScrub()).start_time, absl::InfinitePast());
  const absl::Time start = absl::FromUnixSeconds(1'000'000);
  for (const bool over : {false, true}) {
    EXPECT_THAT(store().SetScrub({.start_time = start, .cursor = "s 1 a", .over = over}), IsOk());
    Open();
    const ScrubRecord read = Take(store().GetScrub());
    EXPECT_EQ(read.start_time, start);
    EXPECT_EQ(read.over, over);
    EXPECT_EQ(read.cursor, over ? "" : "s 1 a");
  }
}

// What unfinished uploads have announced and not sent is not free.
TEST_P(StoreConformance, AnnouncedBytesAreReserved) {
  const std::string sequence = Take(store().CreateSequence(kTenant, "", "")).id;
  const auto upload = [&](const std::string& path, int64_t size_bytes, int64_t room) {
    return store().CreateUpload(kTenant, sequence, {{.path = path, .size_bytes = size_bytes}}, room, "");
  };
  const UploadRecord first = Take(upload("a", 60, 100));
  EXPECT_THAT(upload("b", 41, 100), HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  EXPECT_THAT(upload("c", 40, 100), IsOk());
  // 50 of them are on the disk now, and no longer free.
  EXPECT_THAT(store().SetCommittedSize(first.id, 50), IsOk());
  EXPECT_THAT(upload("d", 1, 50), HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"));
  EXPECT_THAT(upload("d", 1, 51), IsOk());
  // What is finished or deleted reserves nothing.
  EXPECT_THAT(store().DeleteSequence(kTenant, sequence), IsOk());
  const std::string other = Take(store().CreateSequence(kTenant, "", "")).id;
  EXPECT_THAT(store().CreateUpload(kTenant, other, {{.path = "a", .size_bytes = 100}}, 100, ""), IsOk());
}

// What is given up is not part of the sequence: not its bytes, not its paths, and it hinders no commit.
TEST_P(StoreConformance, AnUploadIsGivenUp) {
  const std::string id = UploadedSequence().id;
  const std::vector<UploadFile> files = {{.path = "a", .size_bytes = 3}, {.path = "b/c", .size_bytes = 4}};
  const UploadRecord upload = Take(store().CreateUpload(kTenant, id, files, kRoom, "request", "name YQ=="));
  EXPECT_EQ(Take(store().GetUpload(kTenant, id, upload.id)).metadata, "name YQ==");
  EXPECT_THAT(store().SetCommittedSize(upload.id, 5, {ChecksumWith("a", 3, "1234")}), IsOk());

  EXPECT_THAT(store().RewindUpload(kTenant, id, upload.id), IsOk());
  EXPECT_EQ(Take(store().GetUpload(kTenant, id, upload.id)).committed_size, 0);
  EXPECT_THAT(Take(store().SequenceFiles(id)), IsEmpty()) << "the scrub must not look for what is being removed";
  EXPECT_THAT(store().DeleteUpload(Tenant("other"), id, upload.id), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(store().DeleteUpload(kTenant, ReadySequence().id, upload.id), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(store().DeleteUpload(kTenant, id, upload.id), IsOk());
  EXPECT_THAT(store().DeleteUpload(kTenant, id, upload.id), HasReason(absl::StatusCode::kNotFound, "NO_SUCH_RESOURCE"));
  const SequenceRecord sequence = Take(store().GetSequence(kTenant, id));
  EXPECT_EQ(sequence.size_bytes, 3);
  EXPECT_EQ(sequence.file_count, 1);
  // The request is forgotten, the paths are free.
  const UploadRecord again = Take(store().CreateUpload(kTenant, id, files, kRoom, "request"));
  EXPECT_NE(again.id, upload.id);
  EXPECT_THAT(store().CommitSequence(kTenant, id), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().DeleteUpload(kTenant, id, again.id), IsOk());
  EXPECT_THAT(store().CommitSequence(kTenant, id), IsOk());
}

TEST_P(StoreConformance, AFinishedUploadIsNotGivenUp) {
  const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
  const UploadRecord upload = Take(store().CreateUpload(kTenant, id, {{.path = "a"}}, kRoom, ""));
  EXPECT_THAT(store().FinishUpload(upload.id), IsOk());
  const auto refused = HasReason(absl::StatusCode::kFailedPrecondition, "WRONG_STATE");
  EXPECT_THAT(store().RewindUpload(kTenant, id, upload.id), refused);
  EXPECT_THAT(store().DeleteUpload(kTenant, id, upload.id), refused);
}

// A validate task whose sequence is this file alone; there is no other task.
Task StoreConformance::ArchiveTask(const std::string& path, int64_t size_bytes) {
  const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
  const UploadRecord upload =
      Take(store().CreateUpload(kTenant, id, {{.path = path, .size_bytes = size_bytes}}, kRoom, ""));
  EXPECT_THAT(store().SetCommittedSize(upload.id, size_bytes, {ChecksumWith(path, size_bytes, "1234")}), IsOk());
  EXPECT_THAT(store().FinishUpload(upload.id), IsOk());
  EXPECT_THAT(store().CommitSequence(kTenant, id), IsOk());
  return Claim();
}

// What an archive held counts in its place: files, bytes, checksums.
TEST_P(StoreConformance, FilesTakeTheirArchivesPlace) {
  const Task task = ArchiveTask("clip.ZIP", 10);
  const SequenceArchive archive = *Take(store().GetArchive(task.sequence_id));
  EXPECT_EQ(archive.path, "clip.ZIP");
  EXPECT_FALSE(archive.unpacked);
  const std::vector<FileChecksum> files = {ChecksumWith("rgb.txt", 3, "abcd"), ChecksumWith("rgb/0", 40, "efgh")};
  EXPECT_THAT(store().FinishUnpacking(task.number + 1, archive, files), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().FinishUnpacking(task.number, archive, files), IsOk());
  EXPECT_THAT(store().FinishUnpacking(task.number, archive, files), HasCode(absl::StatusCode::kInternal)) << "once";
  Open();
  EXPECT_TRUE(Take(store().GetArchive(task.sequence_id))->unpacked);
  EXPECT_EQ(Take(store().GetArchive(task.sequence_id))->path, "clip.ZIP");
  const SequenceRecord sequence = Take(store().GetSequence(kTenant, task.sequence_id));
  EXPECT_EQ(sequence.state, SequenceState::kValidating) << "the task goes on";
  EXPECT_EQ(sequence.size_bytes, 43);
  EXPECT_EQ(sequence.file_count, 2);
  EXPECT_THAT(PathsOf(Take(store().SequenceFiles(task.sequence_id))), ElementsAre("rgb.txt", "rgb/0"));
  EXPECT_THAT(store().DeleteSequence(kTenant, task.sequence_id), IsOk());
}

TEST_P(StoreConformance, WhatComesOutOfAnArchiveIsLimited) {
  Limits limits;
  limits.max_sequence_bytes = 50;
  limits.max_files_per_sequence = 2;
  limits.max_tenant_bytes = 60;
  Open(limits);
  const std::string other = Take(store().CreateSequence(kTenant, "", "")).id;
  EXPECT_THAT(store().CreateUpload(kTenant, other, {{.path = "a", .size_bytes = 20}}, kRoom, ""), IsOk());
  const Task task = ArchiveTask("clip.zip", 10);
  const SequenceArchive archive = *Take(store().GetArchive(task.sequence_id));
  const auto finish = [&](const std::vector<FileChecksum>& files) {
    return store().FinishUnpacking(task.number, archive, files);
  };
  const auto limit = [](const absl::Status& status) { return GetErrorInfo(status)->metadata["limit"]; };
  EXPECT_EQ(limit(finish({ChecksumWith("a", 51, "1234")})), "max_sequence_bytes");
  EXPECT_EQ(limit(finish({ChecksumWith("a", 41, "1234")})), "max_tenant_bytes");
  EXPECT_EQ(limit(finish({ChecksumWith("a", 1, "1234"), ChecksumWith("b", 1, "1234"), ChecksumWith("c", 1, "1234")})),
            "max_files_per_sequence");
  EXPECT_FALSE(Take(store().GetArchive(task.sequence_id))->unpacked);
  EXPECT_THAT(finish({ChecksumWith("a", 40, "1234")}), IsOk()) << "the archive itself no longer counts";
}

TEST_P(StoreConformance, OnlyAFileAloneIsAnArchive) {
  EXPECT_FALSE(Take(store().GetArchive(ReadySequence().id)).has_value());
  EXPECT_FALSE(Take(store().GetArchive("0000000000000000")).has_value());
  for (const char* path : {"folder/clip.zip", "clip.zip.png", "zip"}) {
    const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
    EXPECT_THAT(store().CreateUpload(kTenant, id, {{.path = path}}, kRoom, ""), IsOk());
    EXPECT_FALSE(Take(store().GetArchive(id)).has_value()) << path;
  }
  const std::string two = Take(store().CreateSequence(kTenant, "", "")).id;
  EXPECT_THAT(store().CreateUpload(kTenant, two, {{.path = "a.zip"}, {.path = "b.zip"}}, kRoom, ""), IsOk());
  EXPECT_FALSE(Take(store().GetArchive(two)).has_value());
}

// By the rule of AbandonedSequences: the end is so long after the last byte, or after the last upload began.
TEST_P(StoreConformance, AnUploadSaysWhenItExpires) {
  const auto upload_in = [this](absl::Duration keep) {
    Limits limits;
    limits.keep_uploads = keep;
    Open(limits);
    const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
    return Take(store().CreateUpload(kTenant, id, {{.path = "a", .size_bytes = 3}}, kRoom, ""));
  };
  EXPECT_EQ(upload_in(absl::ZeroDuration()).expire_time, absl::InfiniteFuture());
  const absl::Time before = absl::Now() - absl::Microseconds(1);
  const UploadRecord upload = upload_in(absl::Hours(5));
  EXPECT_GE(upload.expire_time, before + absl::Hours(5));
  EXPECT_LE(upload.expire_time, absl::Now() + absl::Hours(5));
  EXPECT_THAT(store().SetCommittedSize(upload.id, 3), IsOk());
  EXPECT_GE(Take(store().GetUpload(kTenant, upload.sequence_id, upload.id)).expire_time, upload.expire_time);
  EXPECT_EQ(Take(store().FinishUpload(upload.id)).expire_time, absl::InfiniteFuture());
}

TEST_P(StoreConformance, MetadataOfAnUploadIsAHeader) {
  const std::string id = Take(store().CreateSequence(kTenant, "", "")).id;
  const auto with = [&](const std::string& metadata) {
    return store().CreateUpload(kTenant, id, {{.path = "a"}}, kRoom, "request", metadata);
  };
  for (const std::string& bad : {std::string("a\r\nSet-Cookie: b"), std::string("\xC3\xA4"), std::string(4097, 'x')}) {
    EXPECT_THAT(with(bad), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << bad.substr(0, 20);
  }
  const std::string longest(4096, 'x');
  EXPECT_EQ(Take(with(longest)).metadata, longest);
  EXPECT_EQ(Take(with(longest)).metadata, longest) << "the same request";
  EXPECT_THAT(with("other"), HasReason(absl::StatusCode::kAlreadyExists, "IDEMPOTENCY_MISMATCH"));
}

// ---- fair share ----

// With one worker, two tenants: whoever waited longer goes next, however long the other's queue is.
TEST_P(StoreConformance, TenantsTakeTurns) {
  const Tenant other("other");
  const std::string sequence = ReadySequence().id;
  std::vector<std::string> mine;
  for (int i = 0; i < 3; ++i) {
    mine.push_back(Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id);
  }
  const SequenceRecord theirs = Take(store().CreateSequence(other, "", ""));
  const UploadRecord upload =
      Take(store().CreateUpload(other, theirs.id, {{.path = "rgb.txt", .size_bytes = 0}}, kRoom, ""));
  ASSERT_THAT(store().FinishUpload(upload.id), IsOk());
  ASSERT_THAT(store().CommitSequence(other, theirs.id), IsOk());
  ASSERT_THAT(store().FinishValidation(Claim().number, {.recording = SomeRecording()}), IsOk());
  const std::string late = Take(store().CreateJob(other, {.sequence_id = theirs.id}, "", false)).id;

  const Task first = Claim();
  EXPECT_EQ(first.job_id, mine[0]);
  const Task second = Claim();
  EXPECT_EQ(second.job_id, late) << "the other tenant has no task at work";
  ASSERT_THAT(store().FinishPrepare(first.number, PlanOf(2)), IsOk());
  ASSERT_THAT(store().FinishPrepare(second.number, PlanOf(2)), IsOk());
  const Task third = Claim(1);
  EXPECT_EQ(third.job_id, mine[0]) << "it has waited longer";
  ASSERT_THAT(store().ReleaseTask(third.number), IsOk());
  EXPECT_EQ(Claim(1).job_id, late);
}

TEST_P(StoreConformance, PlacesInTheQueueAreThoseOfTheJobs) {
  const std::string sequence = ReadySequence().id;
  std::vector<std::string> jobs;
  for (const int priority : {0, 3, 0, 3, -1}) {
    const NewJob job = {.sequence_id = sequence, .priority = priority};
    jobs.push_back(Take(store().CreateJob(kTenant, job, "", false)).id);
  }
  Claim();
  const auto places = Take(store().QueuePositions());
  EXPECT_EQ(places.size(), 4U);
  for (const std::string& job : jobs) {
    const auto place = places.find(job);
    EXPECT_EQ(place == places.end() ? std::nullopt : std::optional(place->second), Job(job).queue_position);
  }
}

TEST_P(StoreConformance, TheEndOfAJobIsToldOnceToItsWebhook) {
  const NewJob order = {.sequence_id = ReadySequence().id, .webhook_url = "https://example.org/hook"};
  const std::string job = Take(store().CreateJob(kTenant, order, "request", false)).id;
  EXPECT_EQ(Job(job).webhook->state, WebhookState::kWaiting);
  EXPECT_THAT(Take(store().DueWebhooks(absl::Now(), 10)), IsEmpty());
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = order.sequence_id}, "request", false),
              HasCode(absl::StatusCode::kAlreadyExists));

  ASSERT_THAT(store().CancelJob(kTenant, job), IsOk());
  Open();
  const std::vector<DueWebhook> due = Take(store().DueWebhooks(absl::Now(), 10));
  ASSERT_THAT(due, SizeIs(1));
  EXPECT_EQ(due[0].job_id, job);
  EXPECT_EQ(due[0].url, order.webhook_url);
  EXPECT_EQ(due[0].attempts, 0);
  const absl::Time later = absl::Now() + absl::Hours(1);
  EXPECT_THAT(store().RecordWebhook(
                  due[0].event_id,
                  {.state = WebhookState::kSending, .attempts = 1, .next_time = later, .last_error = "refused"}),
              IsOk());
  EXPECT_THAT(Take(store().DueWebhooks(absl::Now(), 10)), IsEmpty());
  EXPECT_THAT(Take(store().DueWebhooks(later + absl::Seconds(1), 10)), SizeIs(1));
  EXPECT_EQ(Job(job).webhook->last_error, "refused");
  EXPECT_EQ(Job(job).webhook->attempts, 1);
  EXPECT_THAT(store().RecordWebhook(due[0].event_id, {.state = WebhookState::kDelivered, .attempts = 2}), IsOk());
  EXPECT_THAT(Take(store().DueWebhooks(later + absl::Seconds(1), 10)), IsEmpty());
  EXPECT_EQ(Job(job).webhook->state, WebhookState::kDelivered);
  EXPECT_EQ(Job(job).webhook->last_error, "");
  EXPECT_THAT(store().RecordWebhook(due[0].event_id, {.state = WebhookState::kGivenUp}),
              HasCode(absl::StatusCode::kNotFound));

  // Its next end is another event.
  ASSERT_THAT(store().RetryJob(kTenant, job), IsOk());
  EXPECT_EQ(Job(job).webhook->state, WebhookState::kWaiting);
  ASSERT_THAT(store().CancelJob(kTenant, job), IsOk());
  const std::vector<DueWebhook> again = Take(store().DueWebhooks(absl::Now(), 10));
  ASSERT_THAT(again, SizeIs(1));
  EXPECT_NE(again[0].event_id, due[0].event_id);
  ASSERT_THAT(store().DeleteJob(kTenant, job), IsOk());
  EXPECT_THAT(Take(store().DueWebhooks(absl::Now(), 10)), IsEmpty());
}

TEST_P(StoreConformance, TheHigherPriorityGoesFirst) {
  const std::string sequence = ReadySequence().id;
  const std::string usual = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const std::string urgent = Take(store().CreateJob(kTenant, {.sequence_id = sequence, .priority = 5}, "", false)).id;
  EXPECT_EQ(Job(urgent).queue_position, 0);
  EXPECT_EQ(Job(usual).queue_position, 1);
  EXPECT_EQ(Job(urgent).priority, 5);
  EXPECT_EQ(Claim().job_id, urgent);
  EXPECT_EQ(Claim().job_id, usual);
  for (const int bad : {-11, 11}) {
    EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence, .priority = bad}, "", false),
                HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  }
}

TEST_P(StoreConformance, ATenantHasLimitsOfItsOwn) {
  Open({.max_tenant_bytes = 10, .max_tenant_queued_jobs = 2, .max_tenant_tasks = 1, .max_tenant_uploads = 1});
  const std::string sequence = ReadySequence().id;  // of three bytes
  const SequenceRecord more = Take(store().CreateSequence(kTenant, "", ""));
  EXPECT_THAT(store().CreateUpload(kTenant, more.id, {{.path = "a", .size_bytes = 8}}, kRoom, ""),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  const UploadRecord upload = Take(store().CreateUpload(kTenant, more.id, {{.path = "a", .size_bytes = 6}}, kRoom, ""));
  EXPECT_THAT(store().CreateUpload(kTenant, more.id, {{.path = "b", .size_bytes = 1}}, kRoom, ""),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"))
      << "one upload at a time";
  EXPECT_THAT(store().SetCommittedSize(upload.id, 6), IsOk());
  EXPECT_THAT(store().FinishUpload(upload.id), IsOk());
  EXPECT_THAT(store().CreateUpload(kTenant, more.id, {{.path = "b", .size_bytes = 1}}, kRoom, ""), IsOk());
  for (int i = 0; i < 2; ++i) Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false));
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  EXPECT_NE(Claim().number, 0);
  EXPECT_EQ(Claim().number, 0) << "one task at a time";
}

TEST_P(StoreConformance, LimitsChangeWhileTheStoreIsOpen) {
  Limits limits = store().limits().Get();
  limits.max_queued_jobs = 1;
  const std::string sequence = ReadySequence().id;
  Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false));
  Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false));
  EXPECT_THAT(store().limits().Set(limits), IsOk());
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false),
              HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
  limits.max_queued_jobs = 3;
  EXPECT_THAT(store().limits().Set(limits), IsOk());
  EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false), IsOk());
}

// ---- time limits and retention ----

// The shorter of two limits counts, and zero is none: with one of a microsecond, which has passed, what fails is known.
TEST_P(StoreConformance, JobsBeyondTheirTimeFail) {
  const std::string sequence = ReadySequence().id;
  const std::string runs = PreparedJob(2).id;
  const std::string waits = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const std::string patient =
      Take(store().CreateJob(kTenant, {.sequence_id = sequence, .limits = {.queue = absl::Hours(1)}}, "", false)).id;
  const Task task = Claim(1);
  ASSERT_EQ(task.job_id, runs);
  EXPECT_THAT(Take(store().FailOverdueJobs({})), IsEmpty());
  EXPECT_THAT(Take(store().FailOverdueJobs({.queue = absl::Hours(2), .run = absl::Hours(2)})), IsEmpty());

  EXPECT_THAT(Take(store().FailOverdueJobs({.run = absl::Microseconds(1)})), ElementsAre(runs));
  EXPECT_EQ(Job(runs).state, JobState::kFailed);
  EXPECT_THAT(Job(runs).error, HasReason(absl::StatusCode::kDeadlineExceeded, "TIME_LIMIT"));
  EXPECT_THAT(std::string(Job(runs).error.message()), HasSubstr("run_time_limit"));
  EXPECT_THAT(store().FinishInterval(task.number, 0, 1), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Job(waits).state, JobState::kQueued);

  // A retry waits anew, and what was finished is not lost with the limit.
  Take(store().RetryJob(kTenant, runs));
  EXPECT_THAT(Take(store().FailOverdueJobs({.queue = absl::Hours(1), .run = absl::Microseconds(1)})), IsEmpty());
  EXPECT_THAT(Take(store().FailOverdueJobs({.queue = absl::Microseconds(1)})), ElementsAre(runs, waits, patient));
  EXPECT_THAT(std::string(Job(waits).error.message()), HasSubstr("queue_time_limit"));
  Open();
  EXPECT_EQ(Job(patient).limits.queue, absl::Hours(1));

  for (const absl::Duration bad : {absl::Milliseconds(999), absl::Hours(100'000), -absl::Seconds(1)}) {
    EXPECT_THAT(store().CreateJob(kTenant, {.sequence_id = sequence, .limits = {.run = bad}}, "", false),
                HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  }
}

TEST_P(StoreConformance, WhatHasEndedMayBeCollectedUnlessItIsPinnedOrUsedAgain) {
  const auto ids = [](const std::vector<Collectable>& list) {
    std::vector<std::string> found;
    for (const Collectable& one : list) found.push_back(one.id);
    return found;
  };
  const std::string sequence = ReadySequence().id, unused = ReadySequence().id;
  const std::string job = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  EXPECT_THAT(Take(store().CollectableJobs()), IsEmpty());
  EXPECT_THAT(ids(Take(store().CollectableSequences())), ElementsAre(unused)) << "a job needs the other one";
  Take(store().CancelJob(kTenant, job));
  const std::vector<Collectable> jobs = Take(store().CollectableJobs());
  ASSERT_THAT(ids(jobs), ElementsAre(job));
  EXPECT_EQ(jobs[0].tenant, kTenant.name());
  EXPECT_EQ(jobs[0].job_state, JobState::kCancelled);
  EXPECT_EQ(jobs[0].since, Job(job).end_time);
  std::vector<Collectable> sequences = Take(store().CollectableSequences());
  ASSERT_THAT(ids(sequences), ElementsAre(unused, sequence)) << "the one that was used last comes last";
  EXPECT_EQ(sequences[1].since, Job(job).end_time);
  EXPECT_EQ(Take(store().BytesOfSequence(sequence)), 3);

  // Pinned after it was listed: it stays.
  EXPECT_TRUE(Take(store().PinJob(kTenant, job, true)).pinned);
  EXPECT_TRUE(Take(store().PinSequence(kTenant, unused, true)).pinned);
  EXPECT_THAT(store().CollectJob(jobs[0]), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().CollectSequence(sequences[0]), HasCode(absl::StatusCode::kFailedPrecondition));
  Open();
  EXPECT_TRUE(Job(job).pinned);
  EXPECT_THAT(Take(store().CollectableJobs()), IsEmpty());
  EXPECT_THAT(ids(Take(store().CollectableSequences())), ElementsAre(sequence));
  EXPECT_THAT(store().PinJob(Tenant("other"), job, false), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(store().PinSequence(Tenant("other"), unused, false), HasCode(absl::StatusCode::kNotFound));

  // Used again after it was listed: so does this.
  EXPECT_FALSE(Take(store().PinJob(kTenant, job, false)).pinned);
  Take(store().RetryJob(kTenant, job));
  EXPECT_THAT(store().CollectJob(jobs[0]), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(store().CollectSequence(sequences[1]), HasCode(absl::StatusCode::kFailedPrecondition));
  Take(store().CancelJob(kTenant, job));
  EXPECT_THAT(store().CollectJob(jobs[0]), HasCode(absl::StatusCode::kFailedPrecondition))
      << "it ended at another time";
  EXPECT_THAT(store().CollectJob(Take(store().CollectableJobs()).at(0)), IsOk());
  EXPECT_THAT(store().GetJob(kTenant, job), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(store().CollectSequence(Take(store().CollectableSequences()).at(0)), IsOk());
  EXPECT_THAT(store().GetSequence(kTenant, sequence), HasCode(absl::StatusCode::kNotFound));
}

TEST_P(StoreConformance, AJobWhoseDepthIsStillToBeReusedIsNotCollected) {
  const JobRecord from = PreparedJob(1);
  const Task computed = Claim(1);
  Take(store().FinishInterval(computed.number, 0, 1));
  EXPECT_THAT(store().CompleteTask(computed.number), IsOk());
  EXPECT_THAT(store().CompleteTask(Claim().number), IsOk());
  ASSERT_EQ(Job(from.id).state, JobState::kSucceeded);
  EXPECT_THAT(Take(store().CollectableJobs()), SizeIs(1));
  const std::string renders = Take(store().CreateJob(kTenant,
                                                     {.sequence_id = from.sequence_id,
                                                      .renders = {{.name = "dof", .options = "{}", .streams = {"dof"}}},
                                                      .depth_from = from.id},
                                                     "", false))
                                  .id;
  EXPECT_THAT(Take(store().CollectableJobs()), IsEmpty());
  Take(store().CancelJob(kTenant, renders));
  EXPECT_THAT(Take(store().CollectableJobs()), SizeIs(2));
}

// A short list is the long one without what it leaves out, and both know each job's place in the queue.
TEST_P(StoreConformance, AShortListKnowsTheSameJobs) {
  const std::string sequence = ReadySequence().id;
  const std::string runs = PreparedJob(2).id;
  const std::string low = Take(store().CreateJob(kTenant, {.sequence_id = sequence, .priority = -1}, "", false)).id;
  const std::string usual = Take(store().CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const std::map<std::string, std::optional<int>> places = {{runs, std::nullopt}, {low, 2}, {usual, 1}};
  for (const JobDetail detail : {JobDetail::kFull, JobDetail::kBasic}) {
    const Page<JobRecord> page = Take(store().ListJobs(kTenant, {}, {}, detail));
    ASSERT_THAT(page.items, SizeIs(3));
    for (const JobRecord& job : page.items) {
      EXPECT_EQ(job.queue_position, places.at(job.id));
      EXPECT_EQ(job.queue_position, Job(job.id).queue_position);
      EXPECT_EQ(job.intervals_total, Job(job.id).intervals_total);
      EXPECT_EQ(job.recording.color_frame_count, detail == JobDetail::kFull ? 9 : 0);
    }
  }
}

}  // namespace depthtween::server
