// AdminService over a real channel: what it says against what the server was given and is doing.
#include "depthtween/v1/admin.grpc.pb.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::SizeIs;

class AdminServiceTest : public RpcTest {
 protected:
  // One call of AdminService.
  template <typename Request, typename Response>
  grpc::Status Ask(grpc::Status (v1::AdminService::Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                   const Request& request, Response* response) {
    grpc::ClientContext context;
    return (*v1::AdminService::NewStub(channel()).*method)(&context, request, response);
  }
  v1::DrainState Drain() {
    v1::DrainState state;
    EXPECT_THAT(Ask(&v1::AdminService::Stub::Drain, v1::DrainRequest(), &state), Succeeds());
    return state;
  }
};

TEST_F(AdminServiceTest, LimitsChangeAtOnceAndOnlyThoseThatAreNamed) {
  limits.max_queued_jobs = 7;
  v1::UpdateLimitsRequest request;
  request.mutable_limits()->set_max_chunk_bytes(3);
  request.mutable_limits()->set_max_calls_per_second(1000);
  v1::Limits now;
  ASSERT_THAT(Ask(&v1::AdminService::Stub::UpdateLimits, request, &now), Succeeds());
  EXPECT_EQ(now.max_chunk_bytes(), 3);
  EXPECT_EQ(now.max_queued_jobs(), 7);
  EXPECT_EQ(now.max_calls_per_second(), 1000);
  ASSERT_THAT(Ask(&v1::AdminService::Stub::GetLimits, v1::GetLimitsRequest(), &now), Succeeds());
  EXPECT_EQ(now.max_chunk_bytes(), 3);

  const v1::Upload upload = StartUpload(CreateSequence().name(), {{"a", "1234"}});
  v1::Upload response;
  EXPECT_THAT(WriteUpload(upload.name(), "1234", 0, 4, true, &response),
              Fails(grpc::RESOURCE_EXHAUSTED, "LIMIT_EXCEEDED"));
  EXPECT_THAT(WriteUpload(upload.name(), "1234", 0, 3, true, &response), Succeeds());

  request.mutable_limits()->set_max_chunk_bytes(5'000'000);
  EXPECT_THAT(Ask(&v1::AdminService::Stub::UpdateLimits, request, &now), FailsAtField("limits.max_chunk_bytes"));
  request.mutable_limits()->clear_max_chunk_bytes();
  request.mutable_limits()->set_max_calls_per_second(-1);
  EXPECT_THAT(Ask(&v1::AdminService::Stub::UpdateLimits, request, &now), FailsAtField("limits.max_calls_per_second"));
}

TEST_F(AdminServiceTest, DrainLetsTheTaskEndSaysNotServingAndCanBeTakenBack) {
  const v1::Sequence sequence = ReadySequence("wait_at 0\n");
  const v1::Job job = CreateJob(sequence);
  v1::ListWorkersResponse workers;
  do {
    workers.Clear();
    ASSERT_THAT(Ask(&v1::AdminService::Stub::ListWorkers, v1::ListWorkersRequest(), &workers), Succeeds());
  } while (workers.workers_size() == 0 || workers.workers(0).kind() != "intervals");
  EXPECT_EQ(workers.workers(0).resource(), job.name());
  EXPECT_EQ(workers.workers(0).tenant(), kDefaultTenant);
  EXPECT_EQ(workers.workers(0).first_interval(), 0);
  EXPECT_GT(workers.workers(0).interval_count(), 0);
  EXPECT_EQ(workers.idle_workers(), 0);
  EXPECT_EQ(health().IsServing(""), true);

  const v1::DrainState draining = Drain();
  EXPECT_TRUE(draining.draining());
  EXPECT_EQ(draining.running_tasks(), 1);
  EXPECT_EQ(health().IsServing(""), false);
  Go(sequence);
  while (Drain().running_tasks() > 0) {
  }
  EXPECT_EQ(GetJob(job.name()).state(), v1::Job::STATE_RUNNING) << "calls are answered, and the rest waits";

  v1::DrainState resumed;
  ASSERT_THAT(Ask(&v1::AdminService::Stub::Resume, v1::ResumeRequest(), &resumed), Succeeds());
  EXPECT_FALSE(resumed.draining());
  EXPECT_EQ(health().IsServing(""), true);
  EXPECT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);
}

TEST_F(AdminServiceTest, GarbageIsShownBeforeItIsDeleted) {
  job_options.retention.keep_succeeded = absl::Hours(1);
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  EXPECT_EQ(job.expire_time().seconds(), job.end_time().seconds() + 3600);
  v1::CollectGarbageRequest request;
  v1::CollectGarbageResponse response;
  ASSERT_THAT(Ask(&v1::AdminService::Stub::CollectGarbage, request, &response), Succeeds());
  EXPECT_THAT(response.collected(), SizeIs(0));
}

TEST_F(AdminServiceTest, GarbageIsDeletedAndPinnedJobsAreNot) {
  job_options.retention.keep_succeeded = absl::Microseconds(1);
  const v1::Sequence sequence = ReadySequence();
  grpc::ClientContext create, pin;
  v1::CreateJobRequest order;
  order.mutable_job()->set_sequence(sequence.name());
  order.mutable_job()->set_pinned(true);
  v1::Job pinned, unpinned;
  ASSERT_THAT(jobs_stub().CreateJob(&create, order, &pinned), Succeeds());
  EXPECT_TRUE(pinned.pinned());
  EXPECT_FALSE(WaitUntilEnded(pinned.name()).has_expire_time());
  v1::CollectGarbageRequest request;
  request.set_dry_run(true);
  v1::CollectGarbageResponse response;
  ASSERT_THAT(Ask(&v1::AdminService::Stub::CollectGarbage, request, &response), Succeeds());
  EXPECT_THAT(response.collected(), SizeIs(0));

  v1::UnpinJobRequest unpin;
  unpin.set_name(pinned.name());
  ASSERT_THAT(jobs_stub().UnpinJob(&pin, unpin, &unpinned), Succeeds());
  EXPECT_FALSE(unpinned.pinned());
  ASSERT_THAT(Ask(&v1::AdminService::Stub::CollectGarbage, request, &response), Succeeds());
  ASSERT_THAT(response.collected(), SizeIs(1));
  EXPECT_EQ(GetJob(pinned.name()).name(), pinned.name()) << "a dry run deletes nothing";
  request.set_dry_run(false);
  ASSERT_THAT(Ask(&v1::AdminService::Stub::CollectGarbage, request, &response), Succeeds());
  ASSERT_THAT(response.collected(), SizeIs(1));
  EXPECT_EQ(response.collected(0).resource(), pinned.name());
  EXPECT_EQ(response.collected(0).reason(), v1::Collected::REASON_EXPIRED);
  EXPECT_GT(response.size_bytes(), 0);
  grpc::ClientContext get;
  v1::GetJobRequest get_request;
  get_request.set_name(pinned.name());
  EXPECT_THAT(jobs_stub().GetJob(&get, get_request, &unpinned), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

TEST_F(AdminServiceTest, AScrubRunsWhenItIsAskedFor) {
  WaitUntilEnded(CreateJob(ReadySequence()).name());
  v1::Scrub scrub;
  ASSERT_THAT(Ask(&v1::AdminService::Stub::GetScrub, v1::GetScrubRequest(), &scrub), Succeeds());
  EXPECT_FALSE(scrub.running() || scrub.has_start_time());
  ASSERT_THAT(Ask(&v1::AdminService::Stub::StartScrub, v1::StartScrubRequest(), &scrub), Succeeds());
  do {
    scrub.Clear();
    ASSERT_THAT(Ask(&v1::AdminService::Stub::GetScrub, v1::GetScrubRequest(), &scrub), Succeeds());
  } while (scrub.running());
  EXPECT_GT(scrub.files_checked(), 0);
  EXPECT_TRUE(scrub.has_start_time());
  EXPECT_EQ(scrub.damaged_files(), 0);
}

}  // namespace
}  // namespace depthtween::server
