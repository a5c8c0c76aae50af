// Jobs over a real connection, with fake_core: what the interface's documentation promises.
#include <set>
#include <thread>

#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"
#include "server/rpc/encode.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Not;

class JobServiceTest : public RpcTest {
 protected:
  grpc::Status Create(const v1::CreateJobRequest& request, v1::Job* job) {
    grpc::ClientContext context;
    return jobs_stub().CreateJob(&context, request, job);
  }
  grpc::Status Get(const std::string& name) {
    grpc::ClientContext context;
    v1::GetJobRequest request;
    request.set_name(name);
    v1::Job job;
    return jobs_stub().GetJob(&context, request, &job);
  }
  grpc::Status Cancel(const std::string& name, v1::Job* job) {
    grpc::ClientContext context;
    v1::CancelJobRequest request;
    request.set_name(name);
    return jobs_stub().CancelJob(&context, request, job);
  }
  grpc::Status Retry(const std::string& name, v1::Job* job) {
    grpc::ClientContext context;
    v1::RetryJobRequest request;
    request.set_name(name);
    return jobs_stub().RetryJob(&context, request, job);
  }
  grpc::Status Delete(const std::string& name) {
    grpc::ClientContext context;
    v1::DeleteJobRequest request;
    request.set_name(name);
    google::protobuf::Empty response;
    return jobs_stub().DeleteJob(&context, request, &response);
  }
  grpc::Status List(const std::string& filter, v1::ListJobsResponse* response) {
    grpc::ClientContext context;
    v1::ListJobsRequest request;
    request.set_filter(filter);
    return jobs_stub().ListJobs(&context, request, response);
  }
  std::unique_ptr<grpc::ClientReader<v1::JobEvent>> Watch(grpc::ClientContext* context, const std::string& name,
                                                          const std::string& resume_token = "") {
    v1::WatchJobRequest request;
    request.set_name(name);
    request.set_resume_token(resume_token);
    return jobs_stub().WatchJob(context, request);
  }
};

v1::CreateJobRequest Request(const std::string& sequence) {
  v1::CreateJobRequest request;
  request.mutable_job()->set_sequence(sequence);
  return request;
}

TEST_F(JobServiceTest, AJobRunsToItsEnd) {
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest request = Request(sequence.name());
  request.mutable_job()->set_display_name("mine");
  request.mutable_job()->mutable_options()->set_method("flow-warp");
  request.mutable_job()->mutable_options()->set_key_every(8);
  v1::Job job;
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.name().rfind("jobs/", 0), 0U);
  EXPECT_EQ(job.display_name(), "mine");
  EXPECT_EQ(job.sequence(), sequence.name());
  EXPECT_FALSE(job.has_end_time());

  const v1::Job ended = WaitUntilEnded(job.name());
  EXPECT_EQ(ended.state(), v1::Job::STATE_SUCCEEDED) << ended.error().message();
  EXPECT_EQ(ended.options().method(), "flow-warp");
  EXPECT_EQ(ended.options().key_every(), 8);
  EXPECT_EQ(ended.progress().fraction(), 1.0);
  EXPECT_EQ(ended.progress().frames_done(), 6);
  EXPECT_EQ(ended.progress().intervals_total(), 3);
  EXPECT_TRUE(ended.has_start_time());
  EXPECT_TRUE(ended.has_end_time());
}

TEST_F(JobServiceTest, ValidateOnlyChecksAndCreatesNothing) {
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest request = Request(sequence.name());
  request.set_validate_only(true);
  v1::Job job;
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.name(), "");
  v1::ListJobsResponse list;
  ASSERT_THAT(List("", &list), Succeeds());
  EXPECT_EQ(list.jobs_size(), 0);
  request.mutable_job()->mutable_options()->set_key_every(-1);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.key_every"));
}

TEST_F(JobServiceTest, RequestIdMakesCreationIdempotent) {
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest request = Request(sequence.name());
  request.set_request_id("r1");
  v1::Job first, again;
  ASSERT_THAT(Create(request, &first), Succeeds());
  ASSERT_THAT(Create(request, &again), Succeeds());
  EXPECT_EQ(again.name(), first.name());
  request.mutable_job()->mutable_options()->set_key_every(2);
  EXPECT_THAT(Create(request, &again), Fails(grpc::ALREADY_EXISTS, "IDEMPOTENCY_MISMATCH"));
}

TEST_F(JobServiceTest, BadRequestsNameTheirField) {
  v1::Job job;
  EXPECT_THAT(Create(v1::CreateJobRequest(), &job), FailsAtField("job.sequence"));
  EXPECT_THAT(Create(Request("sequences/../x"), &job), FailsAtField("job.sequence"));
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest request = Request(sequence.name());
  request.mutable_job()->set_threads(-2);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.threads"));
  request = Request(sequence.name());
  request.mutable_job()->mutable_options()->set_method("luck");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.method"));
  request = Request(sequence.name());
  request.mutable_job()->mutable_options()->set_preset("luck");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.preset"));
  request.mutable_job()->mutable_options()->set_preset("fast");
  request.mutable_job()->mutable_options()->add_without("luck");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.without"));
  request.mutable_job()->mutable_options()->set_without(0, "draw");
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.options().preset(), "fast");
  EXPECT_EQ(job.options().without(0), "draw");
  request.mutable_job()->mutable_options()->add_literal("short");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.literal"));
  request.mutable_job()->mutable_options()->set_preset("reference");
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_THAT(job.options().literal(), testing::ElementsAre("short"));
  request.mutable_job()->mutable_options()->add_literal("luck");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.literal"));
  request = Request(sequence.name());
  request.mutable_job()->mutable_options()->set_method("hold");
  request.mutable_job()->mutable_options()->set_self_check(true);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.self_check"));
  request.mutable_job()->mutable_options()->set_self_check(false);
  request.mutable_job()->mutable_options()->set_causal(true);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.causal"));
  request.mutable_job()->mutable_options()->set_causal(false);
  request.mutable_job()->mutable_options()->set_scene_flow(true);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options.scene_flow"));
  request.mutable_job()->mutable_options()->set_scene_flow(false);
  request.mutable_job()->set_threads(kMaxThreads + 1);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.threads"));
  request.mutable_job()->set_threads(kMaxThreads);
  for (const std::string clock : {"sundial", "4,", "nan", "4,1e12"}) {
    request.mutable_job()->mutable_options()->set_clock(clock);
    EXPECT_THAT(Create(request, &job), FailsAtField("job.options.clock")) << clock;
  }
  request.mutable_job()->mutable_options()->set_clock("-4.5,300");
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.options().clock(), "-4.5,300");
  v1::ListJobsResponse list;
  EXPECT_THAT(List("state = DONE", &list), FailsAtField("filter"));
  EXPECT_THAT(List("owner = me", &list), FailsAtField("filter"));
  for (const std::string name : {"", "job", "jobs/", "jobs/../x", "sequences/1"}) {
    EXPECT_THAT(Get(name), FailsAtField("name"));
    EXPECT_THAT(Cancel(name, &job), FailsAtField("name"));
    EXPECT_THAT(Retry(name, &job), FailsAtField("name"));
    EXPECT_THAT(Delete(name), FailsAtField("name"));
    grpc::ClientContext context;
    EXPECT_THAT(Watch(&context, name)->Finish(), FailsAtField("name"));
  }
}

TEST_F(JobServiceTest, SceneFlowIsAJobOfItsOwn) {
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest request = Request(sequence.name());
  v1::SceneFlowOptions& options = *request.mutable_job()->mutable_scene_flow_options();
  v1::Job job;
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.scene_flow_options().method(), "ours");
  EXPECT_THAT(job.scene_flow_options().formats(), testing::ElementsAre("npz"));
  EXPECT_EQ(job.scene_flow_options().every(), 1);
  EXPECT_EQ(job.scene_flow_options().baseline_m(), 0.1);
  EXPECT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);

  options.set_method("luck");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.scene_flow_options.method"));
  options.set_method("pd-flow");
  options.add_formats("");
  EXPECT_THAT(Create(request, &job), FailsAtField("job.scene_flow_options.formats"));
  options.set_formats(0, "kitti");
  options.set_every(-1);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.scene_flow_options.every"));
  options.set_every(2);
  options.set_baseline_m(-1);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.scene_flow_options.baseline_m"));
  options.set_baseline_m(0.54);
  request.mutable_job()->mutable_options()->set_key_every(2);
  EXPECT_THAT(Create(request, &job), FailsAtField("job.options"));
  request.mutable_job()->clear_options();
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_EQ(job.scene_flow_options().method(), "pd-flow");
  EXPECT_EQ(job.scene_flow_options().formats_size(), 2);
}

// A message has a field for each option that core knows, of a type that JSON maps to the option's, and no other.
template <typename Message>
void ExpectFieldsOf(const std::vector<OptionSpec>& specs) {
  using google::protobuf::FieldDescriptor;
  const google::protobuf::Descriptor& message = *Message::descriptor();
  EXPECT_EQ(static_cast<size_t>(message.field_count()), specs.size());
  for (const OptionSpec& spec : specs) {
    const FieldDescriptor* const field = message.FindFieldByName(spec.name);
    ASSERT_NE(field, nullptr) << spec.name;
    EXPECT_EQ(field->is_repeated(), spec.type == OptionType::kWords) << spec.name;
    const FieldDescriptor::Type expected = spec.type == OptionType::kFlag      ? FieldDescriptor::TYPE_BOOL
                                           : spec.type == OptionType::kInteger ? FieldDescriptor::TYPE_INT32
                                           : spec.type == OptionType::kNumber  ? FieldDescriptor::TYPE_DOUBLE
                                                                               : FieldDescriptor::TYPE_STRING;
    EXPECT_EQ(field->type(), expected) << spec.name;
  }
}
TEST(JobOptions, MessagesHaveTheOptionsOfCore) {
  ExpectFieldsOf<v1::UpsampleOptions>(UpsampleOptionSpecs());
  ExpectFieldsOf<v1::SceneFlowOptions>(SceneFlowOptionSpecs());
}

TEST_F(JobServiceTest, UnknownIdsAreNotFound) {
  v1::Job job;
  grpc::ClientContext context;
  const std::string name = "jobs/0123456789abcdef";
  for (const grpc::Status& status :
       {Get(name), Cancel(name, &job), Retry(name, &job), Delete(name), Watch(&context, name)->Finish()}) {
    EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
    ASSERT_TRUE(Detail<google::rpc::ResourceInfo>(status).has_value());
    EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_type(), "depthtween/Job");
    EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_name(), name);
  }
  const grpc::Status status = Create(Request("sequences/0123456789abcdef"), &job);
  EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
  EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_type(), "depthtween/Sequence");
}

// The folder for what is deleted is a file: the job's cannot be moved there.
TEST_F(JobServiceTest, ADeleteThatFailsNamesNoPathOfTheServer) {
  const v1::Job job = CreateJob(ReadySequence());
  WaitUntilEnded(job.name());
  std::filesystem::rename(directory().path() + "/trash", directory().path() + "/elsewhere");
  WriteText(directory().path() + "/trash", "a file where a folder is to be");
  const grpc::Status status = Delete(job.name());
  EXPECT_THAT(status.error_message(), HasSubstr(job.name() + " is deleted, but its files stay"));
  EXPECT_THAT(status.error_message(), Not(HasSubstr(directory().path())));
}

TEST_F(JobServiceTest, TheWrongStateIsAFailedPrecondition) {
  v1::Job job;
  const v1::Sequence uploading = CreateSequence();
  const grpc::Status too_early = Create(Request(uploading.name()), &job);
  EXPECT_THAT(too_early, Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  EXPECT_EQ(Detail<google::rpc::PreconditionFailure>(too_early)->violations(0).subject(), uploading.name());

  const v1::Sequence sequence = ReadySequence("wait_at 1");
  job = CreateJob(sequence);
  EXPECT_THAT(Delete(job.name()), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  EXPECT_THAT(Retry(job.name(), &job), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  Go(sequence);
  job = WaitUntilEnded(job.name());
  EXPECT_THAT(Cancel(job.name(), &job), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
  EXPECT_THAT(Delete(job.name()), Succeeds());
  EXPECT_THAT(Get(job.name()), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

TEST_F(JobServiceTest, AFullQueueSaysWhenToTryAgain) {
  limits.max_queued_jobs = 1;
  const v1::Sequence sequence = ReadySequence("wait_at 0");
  v1::Job job;
  grpc::Status status;
  for (int i = 0; i < 3 && status.ok(); ++i) status = Create(Request(sequence.name()), &job);
  EXPECT_THAT(status, Fails(grpc::RESOURCE_EXHAUSTED, "LIMIT_EXCEEDED"));
  EXPECT_EQ(Detail<google::rpc::QuotaFailure>(status)->violations(0).subject(), "max_queued_jobs");
  EXPECT_TRUE(Detail<google::rpc::RetryInfo>(status).has_value());
}

TEST_F(JobServiceTest, CancelAndRetry) {
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  v1::Job job = CreateJob(sequence);
  while (GetJob(job.name()).progress().frames_done() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  ASSERT_THAT(Cancel(job.name(), &job), Succeeds());
  EXPECT_THAT(Cancel(job.name(), &job), Succeeds());  // asking again changes nothing
  EXPECT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_CANCELLED);
  Go(sequence);
  ASSERT_THAT(Retry(job.name(), &job), Succeeds());
  EXPECT_EQ(job.attempt(), 2);
  EXPECT_EQ(job.progress().frames_done(), 2);
  EXPECT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);
}

TEST_F(JobServiceTest, AFailureSaysWhy) {
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence("error_at 1 INVALID_ARGUMENT")).name());
  EXPECT_EQ(job.state(), v1::Job::STATE_FAILED);
  EXPECT_EQ(job.error().code(), grpc::INVALID_ARGUMENT);
  EXPECT_THAT(job.error().message(), HasSubstr("as the script says"));
  EXPECT_LT(job.progress().fraction(), 1.0);
}

TEST_F(JobServiceTest, ListsByStateAndSequence) {
  const v1::Sequence one = ReadySequence(), two = ReadySequence();
  const v1::Job first = WaitUntilEnded(CreateJob(one).name()), second = WaitUntilEnded(CreateJob(two).name());
  v1::ListJobsResponse list;
  ASSERT_THAT(List("", &list), Succeeds());
  ASSERT_EQ(list.jobs_size(), 2);
  EXPECT_EQ(list.jobs(0).name(), second.name());  // newest first
  list.Clear();
  ASSERT_THAT(List("state = SUCCEEDED AND sequence = \"" + one.name() + "\"", &list), Succeeds());
  ASSERT_EQ(list.jobs_size(), 1);
  EXPECT_EQ(list.jobs(0).name(), first.name());
  list.Clear();
  ASSERT_THAT(List("state = FAILED", &list), Succeeds());
  EXPECT_EQ(list.jobs_size(), 0);
}

// Of jobs that have much to say fewer come at once: a list that no client can take would hide them all.
TEST_F(JobServiceTest, APageIsNoLargerThanAClientTakes) {
  constexpr int kJobs = 48;
  const v1::Sequence sequence = ReadySequence("babble_at 0");
  std::vector<std::string> names;
  for (int i = 0; i < kJobs; ++i) names.push_back(CreateJob(sequence).name());
  for (const std::string& name : names) EXPECT_EQ(WaitUntilEnded(name).state(), v1::Job::STATE_FAILED);
  size_t bytes = 0;
  int pages = 0;
  std::vector<std::string> listed;
  v1::ListJobsRequest request;
  do {
    grpc::ClientContext context;
    v1::ListJobsResponse list;
    ASSERT_THAT(jobs_stub().ListJobs(&context, request, &list), Succeeds());
    bytes += list.ByteSizeLong();
    ++pages;
    for (const v1::Job& job : list.jobs()) listed.insert(listed.begin(), job.name());
    request.set_page_token(list.next_page_token());
  } while (!request.page_token().empty());
  EXPECT_GT(bytes, size_t{4} << 20) << "else this tests nothing";
  EXPECT_GT(pages, 1);
  EXPECT_EQ(listed, names);
}

// API.md: first a snapshot, then numbered deltas; the last event says how the job ended.
TEST_F(JobServiceTest, WatchTellsEveryChangeOnce) {
  const v1::Sequence sequence = ReadySequence("wait_at 0");
  const v1::Job job = CreateJob(sequence);
  grpc::ClientContext context;
  const auto reader = Watch(&context, job.name());
  std::vector<v1::JobEvent> events;
  v1::JobEvent event;
  ASSERT_TRUE(reader->Read(&event));
  ASSERT_TRUE(event.has_snapshot());
  EXPECT_EQ(event.snapshot().name(), job.name());
  events.push_back(event);
  Go(sequence);
  while (reader->Read(&event)) events.push_back(event);
  EXPECT_THAT(reader->Finish(), Succeeds());

  int frames_ready = 0;
  for (size_t i = 1; i < events.size(); ++i) {
    EXPECT_EQ(events[i].number(), events[i - 1].number() + 1);
    if (!events[i].has_frames_ready()) continue;
    EXPECT_EQ(events[i].frames_ready().first_frame(), frames_ready);
    frames_ready += events[i].frames_ready().frame_count();
  }
  EXPECT_EQ(frames_ready, 6);
  ASSERT_TRUE(events.back().has_state_change());
  EXPECT_EQ(events.back().state_change().state(), v1::Job::STATE_SUCCEEDED);

  // From any event on, what was missed comes again, or the job as it stands if that is no longer known.
  for (const v1::JobEvent& from : events) {
    grpc::ClientContext resumed_context;
    const auto resumed = Watch(&resumed_context, job.name(), from.resume_token());
    v1::JobEvent last;
    int count = 0;
    while (resumed->Read(&last)) ++count;
    EXPECT_THAT(resumed->Finish(), Succeeds());
    ASSERT_GT(count, 0);
    EXPECT_EQ(last.has_snapshot() ? last.snapshot().state() : last.state_change().state(), v1::Job::STATE_SUCCEEDED);
  }
}

// What fake_core measures; a watcher hears of it once it is known, and everybody who asks later.
TEST_F(JobServiceTest, ASelfCheckIsPartOfTheJob) {
  const v1::Sequence sequence = ReadySequence("wait_check");
  v1::CreateJobRequest request = Request(sequence.name());
  request.mutable_job()->mutable_options()->set_self_check(true);
  v1::Job job;
  ASSERT_THAT(Create(request, &job), Succeeds());
  EXPECT_TRUE(job.options().self_check());
  EXPECT_FALSE(job.has_self_check());
  grpc::ClientContext context;
  const auto reader = Watch(&context, job.name());
  v1::JobEvent event;
  ASSERT_TRUE(reader->Read(&event));
  Go(sequence);
  v1::SelfCheck heard;
  int frames_before = 0;
  while (reader->Read(&event)) {
    if (event.has_state_change() && event.state_change().has_self_check()) {
      if (heard.summary().empty()) heard = event.state_change().self_check();
    } else if (event.has_frames_ready() && heard.summary().empty()) {
      ++frames_before;
    }
  }
  EXPECT_THAT(reader->Finish(), Succeeds());
  EXPECT_EQ(frames_before, 0);
  const v1::SelfCheck check = GetJob(job.name()).self_check();
  EXPECT_EQ(heard.SerializeAsString(), check.SerializeAsString());
  EXPECT_EQ(check.summary(), "it errs by 7 mm");
  EXPECT_EQ(check.reason(), "");
  EXPECT_EQ(check.maps_checked(), 1);
  EXPECT_EQ(check.maps_held_out(), 2);
  EXPECT_EQ(check.pixels(), 12);
  EXPECT_EQ(check.seconds(), 0.5);
  ASSERT_EQ(check.methods_size(), 2);
  EXPECT_EQ(check.methods(0).name(), "ours");
  EXPECT_EQ(check.methods(0).rmse_mm(), 7);
  EXPECT_EQ(check.methods(0).mae_mm(), 5);
  EXPECT_EQ(check.methods(0).edge_band_rmse_mm(), 9);
  EXPECT_EQ(check.methods(0).completeness(), 0.5);
  EXPECT_EQ(check.methods(0).within_one_sigma(), 0.25);
  EXPECT_FALSE(check.methods(1).has_edge_band_rmse_mm());
  EXPECT_FALSE(check.methods(1).has_within_one_sigma());
  ASSERT_EQ(check.worst_frames_size(), 1);
  EXPECT_EQ(check.worst_frames(0).frame(), 3);
  EXPECT_EQ(check.worst_frames(0).stem(), "000003");
  EXPECT_EQ(check.worst_frames(0).time_ns(), 3000);
  EXPECT_EQ(check.worst_frames(0).rmse_mm(), 8);
  EXPECT_EQ(check.sensor_floor_rmse_mm(), 2);
  EXPECT_EQ(check.sensor_floor_mae_mm(), 1);
}

TEST_F(JobServiceTest, AClockThatWasMeasuredIsPartOfTheJob) {
  v1::CreateJobRequest request = Request(ReadySequence().name());
  request.mutable_job()->mutable_options()->set_causal(true);
  request.mutable_job()->mutable_options()->set_clock("estimate");
  v1::Job job;
  ASSERT_THAT(Create(request, &job), Succeeds());
  job = WaitUntilEnded(job.name());
  EXPECT_TRUE(job.options().causal());
  EXPECT_EQ(job.options().clock(), "estimate");
  EXPECT_THAT(job.warnings(), testing::ElementsAre("a warning"));
  const v1::ClockEstimate& clock = job.clock_estimate();
  EXPECT_EQ(clock.summary(),
            "the depth camera's clock is 4.00 ms ahead at the first colour frame (+-0.05 ms) and gains 300 ppm (+-20 "
            "ppm); from 70000 edge pixels of 66 depth frames");
  EXPECT_EQ(clock.reason(), "");
  EXPECT_EQ(clock.reference_ns(), 10);
  EXPECT_EQ(clock.offset_ns(), 4e6);
  EXPECT_EQ(clock.offset_sigma_ns(), 5e4);
  EXPECT_EQ(clock.drift_ppm(), 300);
  EXPECT_EQ(clock.drift_sigma_ppm(), 20);
  EXPECT_EQ(clock.stamp_sigma_ns(), 6e4);
  EXPECT_EQ(clock.row_time_ns(), 12000);
  EXPECT_FALSE(clock.has_row_time_sigma_ns()) << "unknown";
  EXPECT_EQ(clock.keys(), 66);
  EXPECT_EQ(clock.edges(), 70000);
  job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  EXPECT_EQ(job.options().clock(), "stamps");
  EXPECT_FALSE(job.has_clock_estimate());
}

TEST_F(JobServiceTest, AResumedWatchGoesOnWithoutGap) {
  const v1::Sequence sequence = ReadySequence("intervals 4\nwait_at 2");
  const v1::Job job = CreateJob(sequence);
  v1::JobEvent event;
  int ready = 0;
  {
    grpc::ClientContext context;
    const auto reader = Watch(&context, job.name());
    // The frames before the interval at which the child waits, whether as event or in the snapshot.
    while (ready < 4 && reader->Read(&event)) {
      if (event.has_snapshot()) ready = event.snapshot().progress().frames_done();
      if (event.has_frames_ready()) ready = event.frames_ready().progress().frames_done();
    }
    context.TryCancel();
  }
  Go(sequence);
  grpc::ClientContext context;
  const auto reader = Watch(&context, job.name(), event.resume_token());
  int64_t number = event.number();
  while (reader->Read(&event)) {
    ASSERT_FALSE(event.has_snapshot());
    EXPECT_EQ(event.number(), ++number);
    if (event.has_frames_ready()) ready += event.frames_ready().frame_count();
  }
  EXPECT_THAT(reader->Finish(), Succeeds());
  EXPECT_EQ(ready, 8);
}

TEST_F(JobServiceTest, AWatcherWithoutNewsGetsHeartbeats) {
  rpc_options.watch_heartbeat = absl::Milliseconds(20);
  const v1::Sequence sequence = ReadySequence("wait_at 0");
  const v1::Job job = CreateJob(sequence);
  grpc::ClientContext context;
  const auto reader = Watch(&context, job.name());
  v1::JobEvent event, before;
  int heartbeats = 0;
  while (heartbeats < 3 && reader->Read(&event)) {
    if (event.has_heartbeat()) {
      ++heartbeats;
      EXPECT_EQ(event.number(), before.number());
      EXPECT_EQ(event.resume_token(), before.resume_token());
    }
    before = event;
  }
  EXPECT_EQ(heartbeats, 3);
}

TEST_F(JobServiceTest, AWatchOfAnEndedJobIsItsSnapshot) {
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  grpc::ClientContext context;
  const auto reader = Watch(&context, job.name());
  v1::JobEvent event;
  ASSERT_TRUE(reader->Read(&event));
  EXPECT_EQ(event.snapshot().SerializeAsString(), job.SerializeAsString());
  EXPECT_FALSE(reader->Read(&event));
  EXPECT_THAT(reader->Finish(), Succeeds());
}

}  // namespace
}  // namespace depthtween::server
