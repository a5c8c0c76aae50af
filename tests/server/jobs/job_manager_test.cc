// Jobs from end to end with fake_core, whose log says which intervals were computed, how often and by which process.
#include "server/jobs/job_manager.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <set>

#include "server/store/files.h"
#include "tests/server/jobs/jobs_fixture.h"

namespace depthtween::server {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class JobManagerTest : public JobsFixture {};

TEST_F(JobManagerTest, WholeLife) {
  Start();
  const std::string sequence = ReadySequence();
  const Recording recording = *Take(sequences_->Get(kTenant, sequence)).validation.recording;
  EXPECT_EQ(recording.color_frame_count, 2);
  EXPECT_EQ(recording.depth_frame_count, 1);
  EXPECT_EQ(recording.camera.cx, 1.5);
  EXPECT_EQ(recording.last_time_ns, 20);

  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"key_every":2})"}, "", false)).record.id;
  const JobView ended = Ended(job);
  EXPECT_EQ(ended.record.state, JobState::kSucceeded) << ended.record.error;
  EXPECT_EQ(ended.progress.stage, "succeeded");
  EXPECT_EQ(ended.progress.fraction, 1.0);
  EXPECT_EQ(ended.progress.frames_done, 6);
  EXPECT_EQ(ended.record.interval_seconds, 0.75);
  EXPECT_THAT(Logged(sequence, "interval"), ElementsAre(0, 1, 2));
  for (const FrameRecord& frame : Take(jobs_->Frames(kTenant, job, 0, 100))) {
    EXPECT_TRUE(frame.ready);
    EXPECT_EQ(frame.time_ns, 1000 * frame.index);
    EXPECT_EQ(Frame(job, "depth", frame.stem), "depth " + std::to_string(frame.index));
    EXPECT_EQ(Frame(job, "uncertainty", frame.stem), "uncertainty " + std::to_string(frame.index));
    EXPECT_EQ(Frame(job, "provenance", frame.stem), "provenance " + std::to_string(frame.index));
  }
  // fake_core reports the order it was given.
  EXPECT_EQ(ReadText(jobs_->OutputFile(job, Output(job, "report"))),
            "{\"upsample\":" + Take(CanonicalJobOptions(JobKind::kUpsample, R"({"key_every":2})", "options")) + "}");
  WaitUntil([&] { return std::filesystem::is_empty(directory_->TasksFolder()); });

  EXPECT_THAT(jobs_->Delete(kTenant, job), IsOk());
  EXPECT_FALSE(std::filesystem::exists(directory_->JobFolder(job)));
  EXPECT_THAT(jobs_->Get(kTenant, job), HasCode(absl::StatusCode::kNotFound));
}

TEST_F(JobManagerTest, ValidationNamesTheFile) {
  Start();
  const SequenceRecord sequence = Validated(CommittedSequence("invalid\n"));
  EXPECT_EQ(sequence.state, SequenceState::kInvalid);
  ASSERT_THAT(sequence.validation.violations, SizeIs(1));
  EXPECT_EQ(sequence.validation.violations[0].file, "depth/0.png");
  EXPECT_THAT(sequence.validation.violations[0].status, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(sequence.validation.warnings, ElementsAre("fake"));
}

TEST_F(JobManagerTest, ValidationThatCrashesLeavesAnInvalidSequenceAndAServerThatGoesOn) {
  Start();
  const SequenceRecord sequence = Validated(CommittedSequence("crash_validate\n"));
  EXPECT_EQ(sequence.state, SequenceState::kInvalid);
  EXPECT_THAT(std::string(sequence.validation.error.message()),
              AllOf(HasSubstr("SIGABRT"), HasSubstr("about to abort")));
  EXPECT_EQ(Ended(NewJobOn(ReadySequence())).record.state, JobState::kSucceeded);
}

// A deleted sequence needs no validation any more. What waits for its turn goes too.
TEST_F(JobManagerTest, DeletingASequenceEndsItsValidation) {
  Start(1, {.grace = absl::Milliseconds(300)});
  const std::string running = CommittedSequence("wait_validate\nignore_term\n");
  WaitUntil([&] { return Logged(running, "validate").size() == 1; });
  const int process = Logged(running, "validate").front();
  const std::string waiting = CommittedSequence("");
  EXPECT_THAT(sequences_->Delete(kTenant, waiting), IsOk());
  EXPECT_THAT(sequences_->Delete(kTenant, running), IsOk());
  EXPECT_THAT(sequences_->Get(kTenant, running), HasCode(absl::StatusCode::kNotFound));
  WaitUntil([&] { return !IsAlive(process); });
  EXPECT_EQ(Ended(NewJobOn(ReadySequence())).record.state, JobState::kSucceeded) << "the worker is free";
}

TEST_F(JobManagerTest, ValidationsLeaveWorkersToJobs) {
  Start(3);
  const std::string ready = ReadySequence();
  std::vector<std::string> validating;
  for (int i = 0; i < 4; ++i) validating.push_back(CommittedSequence("wait_validate\n"));
  const auto begun = [&] {
    return std::count_if(validating.begin(), validating.end(),
                         [&](const std::string& id) { return !Logged(id, "validate").empty(); });
  };
  WaitUntil([&] { return begun() == 1; });
  EXPECT_EQ(Ended(NewJobOn(ready)).record.state, JobState::kSucceeded);
  EXPECT_EQ(begun(), 1) << "of three workers one validates";
  for (const std::string& id : validating) Go(id);
  for (const std::string& id : validating) EXPECT_EQ(Validated(id).state, SequenceState::kReady);
}

// One worker: after each validation a task of a job, if there is one.
TEST_F(JobManagerTest, OneWorkerTakesTurns) {
  Start();
  const std::string ready = ReadySequence();
  const std::string first = CommittedSequence("wait_validate\n");
  WaitUntil([&] { return !Logged(first, "validate").empty(); });
  const std::string job = NewJobOn(ready), second = CommittedSequence("wait_validate\n");
  Go(first);
  WaitUntil([&] { return !Logged(second, "validate").empty(); });
  EXPECT_EQ(View(job).record.intervals_total, 3) << "its prepare came in between";
  EXPECT_EQ(View(job).record.intervals_done, 0);
  Go(second);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, ThreadsBeyondWhatTheOperatorGivesAreRefused) {
  Start(1, {.max_threads = 4});
  const std::string sequence = ReadySequence();
  for (const bool validate_only : {true, false}) {
    const auto refused = jobs_->Create(kTenant, {.sequence_id = sequence, .threads = 5}, "", validate_only);
    EXPECT_THAT(refused, HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr("job.threads = 5, must be at most 4"));
  }
  EXPECT_THAT(jobs_->Create(kTenant, {.sequence_id = sequence, .threads = 4}, "", false), IsOk());
}

TEST_F(JobManagerTest, CrashedChildIsTriedAgain) {
  Start();
  const std::string sequence = ReadySequence("crash_at 1 2\n");
  EXPECT_EQ(Ended(NewJobOn(sequence)).record.state, JobState::kSucceeded);
  // Three attempts; interval 0 was done before the first crash and stays done.
  EXPECT_THAT(SortedIntervals(sequence), ElementsAre(0, 1, 2));
}

TEST_F(JobManagerTest, ThirdCrashFailsTheJobWithItsReason) {
  Start();
  const std::string sequence = ReadySequence("crash_at 1 3\n");
  const std::string job = NewJobOn(sequence);
  const JobRecord failed = Ended(job).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kInternal));
  EXPECT_THAT(std::string(failed.error.message()), HasSubstr("SIGSEGV"));
  EXPECT_TRUE(Take(jobs_->Frames(kTenant, job, 0, 1))[0].ready) << "finished frames stay readable";

  // The script has no fourth crash.
  EXPECT_EQ(Take(jobs_->Retry(kTenant, job)).record.attempt, 2);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_THAT(SortedIntervals(sequence), ElementsAre(0, 1, 2));
}

TEST_F(JobManagerTest, ErrorThatNamesItsCauseIsNotTriedAgain) {
  Start();
  const std::string sequence = ReadySequence("error_at 1 DATA_LOSS\n");
  const JobRecord failed = Ended(NewJobOn(sequence)).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kDataLoss));
  EXPECT_THAT(std::string(failed.error.message()),
              HasSubstr(absl::StrCat("as the script says in sequences/", sequence)))
      << "it begins at the data folder, whose place is nobody's business";
  // With so few intervals every batch has one: a process for interval 0, and one for interval 1.
  EXPECT_THAT(Logged(sequence, "start"), SizeIs(2));
}

TEST_F(JobManagerTest, ChildThatDoesNotKeepItsWordFailsTheJob) {
  Start();
  const JobRecord lied = Ended(NewJobOn(ReadySequence("lie_at 0\n"))).record;
  EXPECT_EQ(lied.state, JobState::kFailed);
  EXPECT_THAT(lied.error, HasCode(absl::StatusCode::kNotFound));
  const JobRecord quit = Ended(NewJobOn(ReadySequence("quit_at 1\n"))).record;
  EXPECT_EQ(quit.state, JobState::kFailed);
  EXPECT_THAT(std::string(quit.error.message()), HasSubstr("ended well with"));
}

TEST_F(JobManagerTest, ChildHitsItsLimitAndNobodyElseDoes) {
  Start(1, {.child_file_bytes = 100 << 10});
  const JobRecord failed = Ended(NewJobOn(ReadySequence("fill_at 1\n"))).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(Ended(NewJobOn(ReadySequence())).record.state, JobState::kSucceeded);
}

// A job whose frames no longer fit; the disk is really full.
TEST_F(JobManagerTest, FullDiskFailsTheTaskAndHarmsNothingElse) {
  const SmallDisk disk("3m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  OpenStores(disk.path());
  StartJobs();
  const std::string ready = ReadySequence();
  const std::string sequence = ReadySequence("wait_at 1\nfill_at 1\n");
  const std::string job = NewJobOn(sequence);
  // The next interval has begun: on a full disk none would.
  WaitUntil([&] { return View(job).record.intervals_done == 1 && Logged(sequence, "start").size() == 2; });
  // Half a megabyte is left: too little for the child's one, enough for the database.
  const int64_t filler = Take(blobs_->FreeBytes()) - (512 << 10);
  ASSERT_GT(filler, 0);
  WriteText(disk.path() + "/filler", std::string(static_cast<size_t>(filler), 'x'));
  Go(sequence);
  const JobRecord failed = Ended(job).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kResourceExhausted));
  EXPECT_EQ(Ended(NewJobOn(ready)).record.state, JobState::kSucceeded);
  std::filesystem::remove(disk.path() + "/filler");
  EXPECT_THAT(jobs_->Retry(kTenant, job), IsOk());
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  Close();
}

// With a limit on free space a full disk fails no job. The task that ran out of space is queued again, other jobs stay
// queued, and all succeed once there is space.
TEST_F(JobManagerTest, FullDiskMakesTheQueueWait) {
  const SmallDisk disk("4m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  OpenStores(disk.path());
  StartJobs(1, {.min_free_bytes = 700 << 10, .scarcity_pause = absl::Milliseconds(10)});
  const std::string ready = ReadySequence();
  const std::string sequence = ReadySequence("wait_at 1\nfill_at 1\n");
  const std::string job = NewJobOn(sequence);
  // The next interval has begun: on a full disk none would.
  WaitUntil([&] { return View(job).record.intervals_done == 1 && Logged(sequence, "start").size() == 2; });
  std::vector<std::string> waiting;
  for (int i = 0; i < 5; ++i) waiting.push_back(NewJobOn(ready));
  const int64_t filler = Take(blobs_->FreeBytes()) - (512 << 10);
  ASSERT_GT(filler, 0);
  WriteText(disk.path() + "/filler", std::string(static_cast<size_t>(filler), 'x'));
  Go(sequence);
  WaitUntil([&] { return NamesIn(disk.path() + "/tasks").empty(); });
  EXPECT_EQ(State(job), JobState::kRunning);
  for (const std::string& id : waiting) EXPECT_EQ(State(id), JobState::kQueued);
  EXPECT_EQ(Take(sequences_->Get(kTenant, ready)).id, ready) << "reads go on";
  std::filesystem::remove(disk.path() + "/filler");
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
  for (const std::string& id : waiting) EXPECT_EQ(Ended(id).record.state, JobState::kSucceeded);
  Close();
}

// A child that finds no file descriptor left says so as often as it takes: that is no attempt of its work.
TEST_F(JobManagerTest, WorkThatFindsNoDescriptorIsTriedUntilItDoes) {
  OpenStores(folder_ / "data");
  StartJobs(1, {.scarcity_pause = absl::Milliseconds(1)});
  const std::string sequence = ReadySequence("error_at 1 UNAVAILABLE\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] { return Logged(sequence, "start").size() > 4 * kMaxAttempts; });
  EXPECT_EQ(State(job), JobState::kRunning);
  WriteText(directory_->SequenceFolder(sequence) + "/script", "");
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
}

// The process itself has none left: nothing is begun, and everything goes on once there are some.
TEST_F(JobManagerTest, NothingIsBegunWithoutDescriptors) {
  Start();
  const std::string sequence = ReadySequence();
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &limit), 0);
  const int next = open("/dev/null", O_RDONLY | O_CLOEXEC);  // the lowest that is free
  close(next);
  const rlimit few{static_cast<rlim_t>(next) + 3, limit.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &few), 0);
  const std::string job = NewJobOn(sequence);
  usleep(100'000);
  EXPECT_EQ(State(job), JobState::kQueued);
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &limit), 0);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

// A server that starts again where nothing can be written: jobs are there to be read and deleted.
TEST_F(JobManagerTest, StartsOnAFullDisk) {
  const SmallDisk disk("3m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  OpenStores(disk.path());
  StartJobs();
  const std::string job = NewJobOn(ReadySequence());
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded);
  Close();
  WriteText(disk.path() + "/filler", std::string(4 << 20, 'x'));  // as much of it as there is room for
  OpenStores(disk.path());
  ASSERT_LT(Take(blobs_->FreeBytes()), 16 << 10);
  StartJobs(1, {.min_free_bytes = 700 << 10});
  EXPECT_EQ(State(job), JobState::kSucceeded);
  EXPECT_EQ(Frame(job, "depth", "000001"), "depth 1");
  EXPECT_THAT(jobs_->Delete(kTenant, job), IsOk());
  Close();
}

// After kill -9 with a task running, on a disk that has no room to record that its work is to be done again: the server
// starts, serves and deletes, and does that work once there is room.
TEST_F(JobManagerTest, StartsOnAFullDiskWithWorkThatWasCutOff) {
  const SmallDisk disk("4m");
  ASSERT_TRUE(disk.mounted()) << kNeedsMount;
  OpenStores(disk.path());
  StartJobs();
  const std::string sequence = ReadySequence(), finished = NewJobOn(sequence);
  ASSERT_EQ(Ended(finished).record.state, JobState::kSucceeded);
  jobs_.reset();
  const std::string job = Take(store_->CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
  const Task task = Take(store_->ClaimTask([](const JobRecord&, TaskKind) { return 1; })).value();
  EXPECT_EQ(task.job_id, job);
  Close();
  // The database's log keeps its space, which would be enough; here it has lost it.
  std::filesystem::resize_file(disk.path() + "/depthtween.sqlite-wal", 0);
  WriteText(disk.path() + "/filler", std::string(5 << 20, 'x'));  // as much of it as there is room for
  OpenStores(disk.path());
  StartJobs(1, {.min_free_bytes = 700 << 10});
  EXPECT_THAT(store_->ReleaseTask(task.number), HasReason(absl::StatusCode::kResourceExhausted, "DISK_FULL"))
      << "it is still to be done";
  EXPECT_EQ(State(job), JobState::kRunning) << "as it was";
  EXPECT_EQ(Frame(finished, "depth", "000001"), "depth 1");
  EXPECT_THAT(jobs_->Delete(kTenant, finished), IsOk());
  std::filesystem::remove(disk.path() + "/filler");
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  Close();
}

TEST_F(JobManagerTest, CancelFreesTheProcessor) {
  Start(1, {.grace = absl::Milliseconds(300)});
  // The child ignores SIGTERM, and so does a process that it has started.
  const std::string sequence = ReadySequence("wait_at 1\nignore_term\n");
  const std::string job = NewJobOn(sequence);
  // Two processes for interval 0, and two for interval 1, which waits.
  WaitUntil([&] { return Logged(sequence, "start").size() == 4; });
  const std::vector<int> processes = Logged(sequence, "start");
  EXPECT_THAT(jobs_->Delete(kTenant, job), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_EQ(Take(jobs_->Cancel(kTenant, job)).record.state, JobState::kCancelling);
  EXPECT_EQ(Ended(job).record.state, JobState::kCancelled);
  for (const int process : processes) WaitUntil([&] { return !IsAlive(process); });
  EXPECT_THAT(jobs_->Cancel(kTenant, job), IsOk());
  // The worker is free for others, and the finished frames are there.
  EXPECT_EQ(Ended(NewJobOn(ReadySequence())).record.state, JobState::kSucceeded);
  EXPECT_EQ(Frame(job, "depth", "000001"), "depth 1");
  Go(sequence);
  EXPECT_THAT(jobs_->Retry(kTenant, job), IsOk());
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_THAT(Logged(sequence, "interval"), ElementsAre(0, 1, 2));
}

TEST_F(JobManagerTest, FailureStopsTheOtherWorkersOfTheJob) {
  Start(2);
  // With two workers, batches of one: interval 0 waits for ever, interval 1 fails.
  const std::string sequence = ReadySequence("wait_at 0\nerror_at 1 DATA_LOSS\n");
  const std::string job = NewJobOn(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kFailed);
  for (const int process : Logged(sequence, "start")) WaitUntil([&] { return !IsAlive(process); });
  EXPECT_THAT(Logged(sequence, "interval"), IsEmpty());
}

TEST_F(JobManagerTest, TwoWorkersShareAJob) {
  Start(2);
  // Interval 0 waits until another process has computed all the others.
  const std::string sequence = ReadySequence("intervals 12\nwait_at 0\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] { return View(job).record.intervals_done >= 10; });
  EXPECT_FALSE(Take(jobs_->Frames(kTenant, job, 0, 1))[0].ready);
  const JobView running = View(job);
  EXPECT_EQ(running.record.state, JobState::kRunning);
  ASSERT_TRUE(running.progress.eta.has_value());
  EXPECT_EQ(running.progress.eta->seconds_per_interval, 0.25);
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_THAT(SortedIntervals(sequence), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11));
  const std::vector<int> starts = Logged(sequence, "start");
  EXPECT_EQ(std::set<int>(starts.begin(), starts.end()).size(), starts.size());
}

TEST_F(JobManagerTest, QueueMovesUp) {
  Start();
  const std::string sequence = ReadySequence("wait_at 0\n");
  const std::string first = NewJobOn(sequence), second = NewJobOn(sequence), third = NewJobOn(sequence);
  WaitUntil([&] { return State(first) == JobState::kRunning; });
  EXPECT_EQ(View(second).progress.queue_position, 1);
  EXPECT_EQ(View(third).progress.queue_position, 2);
  EXPECT_EQ(View(third).progress.stage, "queued");
  EXPECT_FALSE(View(third).progress.eta.has_value());
  EXPECT_EQ(Take(jobs_->Cancel(kTenant, second)).record.state, JobState::kCancelled);
  EXPECT_EQ(View(third).progress.queue_position, 1);
  EXPECT_THAT(Take(jobs_->List(kTenant, {.state = JobState::kQueued}, {})).items, SizeIs(1));
  Go(sequence);
  EXPECT_EQ(Ended(third).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, StoppedServerGivesItsWorkBack) {
  Start();
  const std::string sequence = ReadySequence("wait_at 1\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] { return View(job).record.intervals_done == 1; });
  const int child = Logged(sequence, "start").back();
  Close();
  EXPECT_FALSE(IsAlive(child));
  OpenStores(folder_ / "data");
  Go(sequence);
  StartJobs();
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_EQ(View(job).record.attempt, 1);
  EXPECT_THAT(Logged(sequence, "interval"), ElementsAre(0, 1, 2));
}

// Drain waits for the task at work, and no other begins; the manager that starts next does the rest.
TEST_F(JobManagerTest, DrainLetsTheTaskAtWorkEndAndBeginsNoOther) {
  Start();
  const std::string sequence = ReadySequence("wait_at 0\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] { return View(job).record.intervals_total > 0 && Take(jobs_->Measure()).busy_workers == 1; });
  {
    std::jthread drain([&] { jobs_->Drain(absl::Minutes(4)); });
    Go(sequence);
  }
  EXPECT_EQ(Take(jobs_->Measure()).busy_workers, 0);
  EXPECT_GT(View(job).record.intervals_done, 0) << "what was at work came to its end";
  const std::string later = NewJobOn(sequence);
  jobs_->Drain(absl::Milliseconds(50));
  EXPECT_EQ(State(later), JobState::kQueued);
  Close();
  Start();
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_EQ(Ended(later).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, WorkBeginsAgainAfterADrainThatIsTakenBack) {
  Start();
  const std::string sequence = ReadySequence();
  jobs_->SetDraining(true);
  EXPECT_TRUE(jobs_->IsDraining());
  const std::string job = NewJobOn(sequence);
  usleep(50'000);  // a worker would have begun by now
  EXPECT_EQ(State(job), JobState::kQueued);
  EXPECT_THAT(jobs_->RunningTasks(), IsEmpty());
  jobs_->SetDraining(false);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, TellsWhichTasksRun) {
  Start();
  const std::string sequence = ReadySequence("wait_at 0\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] {
    const std::vector<RunningTask> tasks = jobs_->RunningTasks();
    return tasks.size() == 1 && tasks[0].task.kind == TaskKind::kIntervals;
  });
  const RunningTask running = jobs_->RunningTasks().at(0);
  EXPECT_EQ(running.task.job_id, job);
  EXPECT_EQ(running.tenant, kTenant.name());
  EXPECT_LE(running.start_time, absl::Now());
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

// One job runs for ever and one waits behind it: both are ended, the child with its job, and watchers hear of it.
TEST_F(JobManagerTest, JobsBeyondTheirTimeLimitsEnd) {
  Start();
  const std::string sequence = ReadySequence("wait_at 0\n");
  const std::string runs =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .limits = {.run = absl::Seconds(1)}}, "", false)).record.id;
  WaitUntil([&] { return State(runs) == JobState::kRunning; });
  const std::string waits =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .limits = {.queue = absl::Seconds(1)}}, "", false))
          .record.id;
  const auto watch = Take(jobs_->Watch(kTenant, runs, "", nullptr));
  const JobRecord ran = Ended(runs).record, waited = Ended(waits).record;
  EXPECT_EQ(ran.state, JobState::kFailed);
  EXPECT_THAT(ran.error, HasReason(absl::StatusCode::kDeadlineExceeded, "TIME_LIMIT"));
  EXPECT_GE(ran.end_time - ran.start_time, absl::Seconds(1));
  EXPECT_THAT(waited.error, HasReason(absl::StatusCode::kDeadlineExceeded, "TIME_LIMIT"));
  EXPECT_EQ(waited.start_time, absl::InfiniteFuture());
  WaitUntil([&] { return jobs_->RunningTasks().empty(); });
  JobState last = JobState::kQueued;
  while (std::optional<JobEvent> event = watch->Next()) last = event->job.record.state;
  EXPECT_EQ(last, JobState::kFailed);
  // The worker is free.
  Go(sequence);
  EXPECT_EQ(Ended(NewJobOn(sequence)).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, TheServersTimeLimitIsForAll) {
  Start(1, {.time_limits = {.run = absl::Seconds(1)}});
  const std::string job = NewJobOn(ReadySequence("wait_at 0\n"));
  EXPECT_THAT(Ended(job).record.error, HasReason(absl::StatusCode::kDeadlineExceeded, "TIME_LIMIT"));
}

TEST_F(JobManagerTest, AViewSaysWhenItsJobExpires) {
  Start(1, {.retention = {.keep_succeeded = absl::Hours(5)}});
  const std::string job = NewJobOn(ReadySequence());
  const JobView ended = Ended(job);
  EXPECT_EQ(ended.expire_time, ended.record.end_time + absl::Hours(5));
  EXPECT_EQ(Take(jobs_->Pin(kTenant, job, true)).expire_time, absl::InfiniteFuture());
}

// kill -9 in the middle of a batch: what was recorded is not computed again, what was not is; and the children are
// gone.
TEST_F(JobManagerTest, KilledServerResumesWithWhatIsUnfinished) {
  for (const int workers : {1, 2}) {
    Start();
    const std::string sequence = ReadySequence("intervals 20\nwait_at 13\n");
    Close();
    OpenStores(folder_ / "data");
    const std::string job = Take(store_->CreateJob(kTenant, {.sequence_id = sequence}, "", false)).id;
    Close();

    const std::string data = folder_ / "data", count = std::to_string(workers);
    const pid_t server = fork();
    ASSERT_GE(server, 0);
    if (server == 0) {
      execl(MANAGER_PROCESS, MANAGER_PROCESS, data.c_str(), FAKE_CORE, count.c_str(), nullptr);
      _exit(127);
    }
    const std::string log = data + "/sequences/" + sequence + "/log";
    // One worker stops before interval 13; of two, the other goes on to the end.
    const auto lines = [&] {
      const std::string text = ReadText(log);
      return std::count(text.begin(), text.end(), 'l');  // "interval" has one
    };
    WaitUntil([&] { return lines() >= 13; });
    ASSERT_EQ(kill(server, SIGKILL), 0);
    ASSERT_EQ(waitpid(server, nullptr, 0), server);

    OpenStores(folder_ / "data");
    const std::vector<int> before = Logged(sequence, "interval");
    const JobRecord left = Take(store_->GetJob(kTenant, job));
    EXPECT_EQ(left.state, JobState::kRunning);
    for (const int child : Logged(sequence, "start")) WaitUntil([&] { return !IsAlive(child); });
    std::set<int> recorded;
    for (const FrameRecord& frame : Take(store_->JobFrames(kTenant, job, 0, 40))) {
      if (frame.ready) recorded.insert(frame.index / 2);
    }
    EXPECT_EQ(static_cast<int>(recorded.size()), left.intervals_done);

    Go(sequence);
    StartJobs(workers);
    EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
    const std::vector<int> all = Logged(sequence, "interval");
    const std::multiset<int> computed(all.begin(), all.end());
    for (int interval = 0; interval < 20; ++interval) {
      EXPECT_GE(computed.count(interval), 1U) << interval;
      // Computed once if recorded. The kill may have come between the end of an interval and its record.
      EXPECT_LE(computed.count(interval), recorded.count(interval) > 0 ? 1U : 2U) << interval;
      EXPECT_EQ(Frame(job, "depth", std::string("0000") + (interval < 5 ? "0" : "") + std::to_string(2 * interval)),
                "depth " + std::to_string(2 * interval));
    }
    Close();
  }
}

TEST_F(JobManagerTest, OptionsAreChecked) {
  OpenStores(folder_ / "data");
  EXPECT_THAT(JobManager::Start(*directory_, *store_, {.core_program = "/no/such/program"}),
              HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(JobManager::Start(*directory_, *store_, {.core_program = FAKE_CORE, .workers = 0}),
              HasCode(absl::StatusCode::kInvalidArgument));
}

// ---- renders ----

const char kDof[] = R"({"name":"dof","container":"mp4"})", kStereo[] = R"({"name":"stereo"})";

TEST_F(JobManagerTest, SelfCheckIsMeasuredFirstAndIsPartOfTheReport) {
  Start(2);
  const std::string sequence = ReadySequence("wait_check\n");
  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"self_check":true})"}, "", false)).record.id;
  WaitUntil([&] { return View(job).progress.stage == "self-check, map 1 of 1"; });
  EXPECT_EQ(View(job).record.intervals_total, 0) << "nothing else is begun";
  Go(sequence);
  const JobView ended = Ended(job);
  EXPECT_EQ(ended.record.state, JobState::kSucceeded) << ended.record.error;
  ASSERT_TRUE(ended.record.self_check.has_value());
  EXPECT_EQ(ended.record.self_check->summary, "it errs by 7 mm");
  EXPECT_EQ(ended.record.self_check->methods[0].rmse_mm, 7);
  EXPECT_EQ(ended.record.self_check->worst_frames[0].stem, "000003");
  EXPECT_THAT(ReadText(jobs_->OutputFile(job, Output(job, "report"))),
              AllOf(HasSubstr(R"("self_check":true)"), HasSubstr(R"("summary":"it errs by 7 mm")")));
  EXPECT_THAT(Logged(sequence, "check"), SizeIs(1));
}

TEST_F(JobManagerTest, SelfCheckThatCannotBeMadeStopsNothing) {
  Start();
  const std::string sequence = ReadySequence("no_check\n");
  const JobView ended =
      Ended(Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"self_check":true})"}, "", false))
                .record.id);
  EXPECT_EQ(ended.record.state, JobState::kSucceeded) << ended.record.error;
  EXPECT_EQ(ended.record.self_check->reason, "too short");
}

TEST_F(JobManagerTest, StoppedServerMeasuresTheSelfCheckAgainAndAFinishedOneNever) {
  Start();
  const std::string sequence = ReadySequence("wait_check\n");
  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"self_check":true})"}, "", false)).record.id;
  WaitUntil([&] { return Logged(sequence, "check").size() == 1; });
  Close();
  Start();
  WaitUntil([&] { return Logged(sequence, "check").size() == 2; });
  WriteText(directory_->SequenceFolder(sequence) + "/script", "error_at 1 DATA_LOSS\n");
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kFailed);
  Close();
  Start();
  EXPECT_EQ(View(job).record.self_check->summary, "it errs by 7 mm");
  WriteText(directory_->SequenceFolder(sequence) + "/script", "");
  EXPECT_THAT(jobs_->Retry(kTenant, job), IsOk());
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
  EXPECT_THAT(Logged(sequence, "check"), SizeIs(2));
}

TEST_F(JobManagerTest, PicturesAreRenderedBesideDepthAndAssembledAtTheEnd) {
  for (const int workers : {1, 2}) {
    OpenStores(folder_ / ("data" + std::to_string(workers)));
    StartJobs(workers);
    const std::string sequence = ReadySequence("intervals 4\n");
    const std::string job =
        Take(jobs_->Create(kTenant, {.sequence_id = sequence, .renders = {{.options = kDof}, {.options = kStereo}}}, "",
                           false))
            .record.id;
    const JobView ended = Ended(job);
    EXPECT_EQ(ended.record.state, JobState::kSucceeded) << ended.record.error;
    EXPECT_EQ(ended.progress.rendered_frames_done, 16);
    EXPECT_EQ(Frame(job, "dof", "000007"), "dof 7");
    EXPECT_EQ(Frame(job, "stereo", "000000"), "stereo 0");
    EXPECT_EQ(ReadText(jobs_->OutputFile(job, Output(job, "dof-video"))), "video of dof");
    EXPECT_EQ(Logged(sequence, "render").size(), 8U);
    Close();
  }
}

// Interval 2 is not computed before its gate opens, but the pictures of interval 0 can be read.
TEST_F(JobManagerTest, PicturesAreReadyWhileTheJobRuns) {
  Start();
  const std::string sequence = ReadySequence("intervals 4\nwait_at 2\n");
  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .renders = {{.options = kDof}}}, "", false)).record.id;
  // With one worker the batch of intervals that waits holds it: pictures come from the next one on.
  WaitUntil([&] { return View(job).record.intervals_done == 2; });
  EXPECT_EQ(State(job), JobState::kRunning);
  WaitUntil([&] { return Take(jobs_->Frames(kTenant, job, 0, 1, 0))[0].ready; });
  EXPECT_EQ(Frame(job, "dof", "000001"), "dof 1");
  EXPECT_FALSE(Take(jobs_->Frames(kTenant, job, 2, 1, 0))[0].ready);
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

TEST_F(JobManagerTest, RendersThatCoreRefusesMakeNoJob) {
  Start();
  const std::string sequence = ReadySequence();
  const auto created =
      jobs_->Create(kTenant, {.sequence_id = sequence, .renders = {{.options = R"({"name":"bad"})"}}}, "", false);
  EXPECT_THAT(created, HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(std::string(created.status().message()), HasSubstr("job.renders[0].name = bad"));
  EXPECT_THAT(Take(jobs_->List(kTenant, {}, {})).items, IsEmpty());
}

TEST_F(JobManagerTest, RendersOfFinishedDepthComputeNothingAgain) {
  Start();
  const std::string sequence = ReadySequence();
  const std::string from = NewJobOn(sequence);
  EXPECT_EQ(Ended(from).record.state, JobState::kSucceeded);
  const NewJob order = {.sequence_id = sequence, .renders = {{.options = kDof}}, .depth_from = from};
  const std::string job = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
  EXPECT_EQ(Logged(sequence, "interval").size(), 3U);
  EXPECT_THAT(jobs_->Delete(kTenant, from), IsOk());
  EXPECT_EQ(Frame(job, "depth", "000003"), "depth 3") << "what was taken over stays";
  EXPECT_EQ(Frame(job, "dof", "000003"), "dof 3");
}

// Made by `assemble` for all frames but the last, which has none; whoever takes the depth over may have it too.
TEST_F(JobManagerTest, SceneFlowIsThereWhenTheJobHasSucceeded) {
  Start();
  const std::string sequence = ReadySequence();
  const NewJob order = {.sequence_id = sequence, .options = R"({"scene_flow":true})"};
  const std::string from = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  ASSERT_EQ(Ended(from).record.state, JobState::kSucceeded) << View(from).record.error;
  const OutputSpec output = Output(from, "sceneflow");
  EXPECT_TRUE(output.assembled);
  EXPECT_EQ(Frame(from, "sceneflow", "000004"), "scene flow 4");
  EXPECT_FALSE(std::filesystem::exists(jobs_->FrameFile(from, output, "000005")));
  NewJob again = order;
  again.renders = {{.options = kDof}};
  again.depth_from = from;
  const std::string job = Take(jobs_->Create(kTenant, again, "", false)).record.id;
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
  EXPECT_EQ(Frame(job, "sceneflow", "000004"), "scene flow 4");
}

// All frames are there, and yet something takes time: what it is and how far is told, anew by a server that was killed;
// how long it will take nobody has measured.
TEST_F(JobManagerTest, SceneFlowIsMadeWithProgress) {
  Start();
  const std::string sequence = ReadySequence("wait_flow 3\n");
  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"scene_flow":true})"}, "", false)).record.id;
  for (const bool killed : {false, true}) {
    if (killed) {
      Close();
      OpenStores(folder_ / "data");
      StartJobs();
    }
    WaitUntil([&] { return View(job).progress.stage == "scene flow, frame 3 of 5"; });
    const Progress progress = View(job).progress;
    EXPECT_EQ(progress.frames_done, 6);
    EXPECT_LT(progress.fraction, 1.0);
    EXPECT_FALSE(progress.eta.has_value());
  }
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
}

// As core writes: under a name that ends in .tmp until a file is whole. Planted after the child and, as a server that
// was killed leaves them, while none runs.
TEST_F(JobManagerTest, WhatAnAssembleLeftHalfWrittenGoes) {
  Start();
  const std::string sequence = ReadySequence("wait_flow 3\n");
  const std::string job =
      Take(jobs_->Create(kTenant, {.sequence_id = sequence, .options = R"({"scene_flow":true})"}, "", false)).record.id;
  const std::string out = directory_->OutFolder(job);
  const auto plant = [&] {
    for (const char* name : {"/report.json.77-1.tmp", "/sceneflow/000001.npz.77-2.tmp"}) WriteText(out + name, "half");
  };
  const auto planted = [&] {
    return std::filesystem::exists(out + "/report.json.77-1.tmp") ||
           std::filesystem::exists(out + "/sceneflow/000001.npz.77-2.tmp");
  };
  WaitUntil([&] { return View(job).progress.stage == "scene flow, frame 3 of 5"; });
  plant();
  Close();
  EXPECT_FALSE(planted());
  plant();
  OpenStores(folder_ / "data");
  Go(sequence);
  StartJobs();
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
  EXPECT_FALSE(planted());
  EXPECT_EQ(Frame(job, "sceneflow", "000004"), "scene flow 4");
}

// Frames and intervals as of an upsampling, under other names, some in a folder of folders; no depth, so no pictures.
TEST_F(JobManagerTest, SceneFlowJobResumesAndHasNoDepth) {
  Start();
  const std::string sequence = ReadySequence("wait_at 1");
  const NewJob order = {
      .sequence_id = sequence, .kind = JobKind::kSceneFlow, .options = R"({"formats":["kitti"],"every":2})"};
  const std::string job = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  WaitUntil([&] { return View(job).record.frames_done == 2; });
  EXPECT_THAT(jobs_->RenderFrame(kTenant, job, {.options = kDof}, nullptr),
              HasReason(absl::StatusCode::kFailedPrecondition, "NO_DEPTH"));
  Close();
  OpenStores(folder_ / "data");
  Go(sequence);
  StartJobs();
  ASSERT_EQ(Ended(job).record.state, JobState::kSucceeded) << View(job).record.error;
  EXPECT_THAT(SortedIntervals(sequence), ElementsAre(0, 1, 2)) << "what was finished is not computed again";
  EXPECT_EQ(Frame(job, "sceneflow", "000005"), "sceneflow 5");
  EXPECT_EQ(Frame(job, "kitti-disp_1", "000000"), "kitti/disp_1 0");
  EXPECT_EQ(ReadText(jobs_->OutputFile(job, Output(job, "preview"))), "preview");
  EXPECT_EQ(ReadText(jobs_->OutputFile(job, Output(job, "report"))),
            R"({"scene_flow":{"baseline_m":0.1,"every":2,"formats":["npz","kitti"],"method":"ours"}})");
}

// Refused when it is asked for, not when its turn has come.
TEST_F(JobManagerTest, SceneFlowThatASequenceCannotGiveIsRefused) {
  Start();
  const std::string sequence = ReadySequence("no_pairs\n");
  for (const bool validate_only : {true, false}) {
    const auto refused =
        jobs_->Create(kTenant, {.sequence_id = sequence, .kind = JobKind::kSceneFlow}, "", validate_only);
    EXPECT_THAT(refused, HasReason(absl::StatusCode::kFailedPrecondition, "NO_SCENE_FLOW"));
    EXPECT_EQ(refused.status().message(), absl::StrCat("sequences/", sequence, ": rates differ"));
  }
  EXPECT_THAT(Take(jobs_->List(kTenant, {}, {})).items, SizeIs(0));
  const NewJob wrong = {.sequence_id = sequence, .kind = JobKind::kSceneFlow, .options = R"({"every":0})"};
  EXPECT_THAT(jobs_->Create(kTenant, wrong, "", false), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  EXPECT_THAT(jobs_->Create(kTenant, {.sequence_id = sequence}, "", false), IsOk()) << "it can be upsampled";
}

// The answer of an errand, once it is there.
absl::StatusOr<std::string> Answer(Errand& errand) {
  std::optional<absl::StatusOr<std::string>> answer;
  WaitUntil([&] { return (answer = errand.TakeAnswer()).has_value(); });
  return *answer;
}

TEST_F(JobManagerTest, OneFrameIsRenderedWhileTheJobRuns) {
  Start();
  const std::string sequence = ReadySequence("wait_at 1\n");
  const std::string job = NewJobOn(sequence);
  WaitUntil([&] { return View(job).record.intervals_done == 1; });
  const auto errand = Take(jobs_->RenderFrame(kTenant, job, {.frame = 1, .options = kDof, .jpeg = true}, nullptr));
  const std::string picture = Take(Answer(*errand));
  EXPECT_THAT(picture, AllOf(HasSubstr("picture 1"), HasSubstr(R"("name":"dof")"), HasSubstr("jpeg")));
  EXPECT_THAT(jobs_->RenderFrame(kTenant, job, {.frame = 2, .options = kDof}, nullptr),
              HasReason(absl::StatusCode::kFailedPrecondition, "FRAME_NOT_READY"));
  EXPECT_THAT(jobs_->RenderFrame(kTenant, job, {.frame = 6, .options = kDof}, nullptr),
              HasReason(absl::StatusCode::kOutOfRange, "NO_SUCH_FRAME"));
  const auto bad = Take(jobs_->RenderFrame(kTenant, job, {.frame = 1, .options = R"({"name":"bad"})"}, nullptr));
  EXPECT_THAT(Answer(*bad), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
  Go(sequence);
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
}

// What a picture needs and is gone is neither "there is none" nor "not yet": clients hear of it as of a frame.
TEST_F(JobManagerTest, AFrameWhoseInputIsLostSaysSo) {
  Start();
  for (const auto& [what, resource] :
       {std::pair("motion", "jobs/"), {"depth", "/outputs/depth"}, {"color", "sequences/"}}) {
    const std::string sequence = ReadySequence(absl::StrCat("lost 4 ", what, "\n"));
    const std::string job = NewJobOn(sequence);
    EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded);
    const auto errand = Take(jobs_->RenderFrame(kTenant, job, {.frame = 1, .options = kDof}, nullptr));
    const absl::Status lost = Answer(*errand).status();
    EXPECT_THAT(lost, HasReason(absl::StatusCode::kDataLoss, "FILE_LOST"));
    EXPECT_EQ(GetErrorInfo(lost)->metadata.at("frame"), "4");
    EXPECT_THAT(GetErrorInfo(lost)->metadata.at("resource"), HasSubstr(resource));
    EXPECT_THAT(std::string(lost.message()), HasSubstr("lost from the server's disk"));
  }
}

// Pictures need motion where the frames have it: none is taken for lost, and what is lost is named with its job.
TEST_F(JobManagerTest, DepthThatIsTakenOverIsWhole) {
  Start();
  const std::string sequence = ReadySequence("moves\n");
  const NewJob rendered = {.sequence_id = sequence, .renders = {{.options = kDof}}};
  const std::string from = Take(jobs_->Create(kTenant, rendered, "", false)).record.id;
  ASSERT_EQ(Ended(from).record.state, JobState::kSucceeded) << View(from).record.error;
  NewJob order = rendered;
  order.depth_from = from;
  const std::string whole = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  ASSERT_EQ(Ended(whole).record.state, JobState::kSucceeded) << View(whole).record.error;
  const auto file = [&](const std::string& job, const std::string& name) {
    return jobs_->OutputFile(job, {.file_name = name});
  };
  EXPECT_EQ(ReadText(file(whole, "motion/000003.npz")), "motion 3");

  std::filesystem::remove(file(from, "motion/000003.npz"));
  const std::string moving = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  EXPECT_THAT(Ended(moving).record.error, HasReason(absl::StatusCode::kDataLoss, "FILE_LOST"));
  EXPECT_THAT(std::string(View(moving).record.error.message()),
              HasSubstr("the motion of frame 3 of jobs/" + from + " was made, but its file is lost"));
  WriteText(file(from, "motion/000003.npz"), "motion 3");
  std::filesystem::remove(file(from, "depth/000004.png"));
  const std::string still = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  EXPECT_THAT(Ended(still).record.error, HasReason(absl::StatusCode::kDataLoss, "FILE_LOST"));
  EXPECT_THAT(std::string(View(still).record.error.message()),
              HasSubstr("frame 4 of jobs/" + from + "/outputs/depth was made, but its file is lost"));

  // A job that kept no motion has none to lose.
  const std::string without = NewJobOn(sequence);
  ASSERT_EQ(Ended(without).record.state, JobState::kSucceeded);
  ForgetChecksums(without);
  for (const char* const report : {"interval_000000.json", "interval_000001.json", "interval_000002.json"}) {
    WriteText(file(without, report), R"({"motion_frames":0})");
  }
  order.depth_from = without;
  const std::string poor = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  EXPECT_EQ(Ended(poor).record.state, JobState::kSucceeded) << View(poor).record.error;
}

TEST_F(JobManagerTest, AFrameThatTakesTooLongOrThatNobodyWaitsForIsStopped) {
  Start(1, {.frame_renderers = 1, .frame_render_time = absl::Milliseconds(300)});
  const std::string sequence = ReadySequence("slow_frame\n");
  const std::string job = NewJobOn(sequence);
  Ended(job);
  const size_t started = Logged(sequence, "start").size();
  auto errand = Take(jobs_->RenderFrame(kTenant, job, {.frame = 0, .options = kDof}, nullptr));
  EXPECT_THAT(Answer(*errand), HasCode(absl::StatusCode::kDeadlineExceeded));
  EXPECT_FALSE(IsAlive(Logged(sequence, "start").back()));

  errand = Take(jobs_->RenderFrame(kTenant, job, {.frame = 0, .options = kDof}, nullptr));
  WaitUntil([&] { return Logged(sequence, "start").size() == started + 2; });
  errand.reset();
  WaitUntil([&] { return !IsAlive(Logged(sequence, "start").back()); });

  // One runs, and as many wait as may.
  std::vector<std::unique_ptr<Errand>> waiting;
  absl::Status refused;
  for (int i = 0; i < 100 && refused.ok(); ++i) {
    auto more = jobs_->RenderFrame(kTenant, job, {.frame = 0, .options = kDof}, nullptr);
    refused = more.status();
    if (more.ok()) waiting.push_back(*std::move(more));
  }
  EXPECT_THAT(refused, HasReason(absl::StatusCode::kResourceExhausted, "SERVER_BUSY"));
}

// Every place for single frames is taken, running and waiting: an order with renders needs none of them.
TEST_F(JobManagerTest, OrdersDoNotWaitForPictures) {
  Start(1, {.frame_renderers = 1});
  const std::string sequence = ReadySequence("slow_frame\n");
  const std::string job = NewJobOn(sequence);
  Ended(job);
  std::vector<std::unique_ptr<Errand>> waiting;
  for (bool room = true; room;) {
    auto more = jobs_->RenderFrame(kTenant, job, {.frame = 0, .options = kDof}, nullptr);
    room = more.ok();
    if (room) waiting.push_back(*std::move(more));
  }
  EXPECT_THAT(jobs_->Create(kTenant, {.sequence_id = sequence, .renders = {{.options = kDof}}}, "", false), IsOk());
}

// A server that stops does not wait for what its calls wait for: one that runs, one that waits, one that comes later.
TEST_F(JobManagerTest, StoppingEndsWhatCallsWaitFor) {
  Start();
  const std::string sequence = ReadySequence("slow_plan\n");
  const NewJob order = {.sequence_id = sequence, .renders = {{.options = kDof}}};
  absl::Status planned[2];
  {
    std::vector<std::jthread> calls;
    for (absl::Status& status : planned) {
      calls.emplace_back([&] { status = jobs_->Create(kTenant, order, "", false).status(); });
    }
    WaitUntil([&] { return Logged(sequence, "start").size() == 1; });
    jobs_->StopErrands();
  }
  for (const absl::Status& status : planned) {
    EXPECT_THAT(status, HasReason(absl::StatusCode::kUnavailable, "SERVER_STOPPING"));
  }
  EXPECT_THAT(jobs_->Create(kTenant, order, "", false), HasReason(absl::StatusCode::kUnavailable, "SERVER_STOPPING"));
}

// ---- tasks that hang, are ended from outside, or have no end ----

// Long enough for a busy machine to start a process in.
const JobManagerOptions kImpatient = {.task_stall = absl::Seconds(2), .grace = absl::Milliseconds(100)};

TEST_F(JobManagerTest, TaskThatHangsIsTriedAgainWhateverItsKind) {
  Start(6, kImpatient);
  // As fake_core numbers the kinds: validate, prepare, intervals, assemble, self-check, render.
  std::map<int, std::string> sequences, jobs;
  for (int kind = 1; kind <= 6; ++kind) sequences[kind] = CommittedSequence(absl::StrCat("hang ", kind, " 1\n"));
  for (const auto& [kind, sequence] : sequences) {
    EXPECT_EQ(Validated(sequence).state, SequenceState::kReady) << kind;
    const NewJob order = {.sequence_id = sequence, .options = R"({"self_check":true})", .renders = {{.options = kDof}}};
    jobs[kind] = Take(jobs_->Create(kTenant, order, "", false)).record.id;
  }
  for (const auto& [kind, job] : jobs) {
    EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << kind << ": " << View(job).record.error;
    const std::vector<int> hung = Logged(sequences[kind], "hang");
    ASSERT_THAT(hung, SizeIs(1)) << kind;
    EXPECT_FALSE(IsAlive(hung[0]));
  }
}

TEST_F(JobManagerTest, ThirdHangFailsTheJobAndSaysWhatHung) {
  Start(2, kImpatient);
  const std::string invalid = CommittedSequence("hang 1 3\n");
  const std::string job = NewJobOn(ReadySequence("intervals 1\nhang 3 3\n"));
  const JobRecord failed = Ended(job).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kDeadlineExceeded));
  EXPECT_THAT(std::string(failed.error.message()), AllOf(HasSubstr("task intervals"), HasSubstr("no progress for 2 s"),
                                                         HasSubstr("it was at: hanging about")));
  EXPECT_THAT(jobs_->Retry(kTenant, job), IsOk());
  EXPECT_EQ(Ended(job).record.state, JobState::kSucceeded) << "the script has no fourth";
  EXPECT_EQ(Validated(invalid).state, SequenceState::kInvalid);
  EXPECT_THAT(std::string(Validated(invalid).validation.error.message()), HasSubstr("no progress for 2 s"));
}

TEST_F(JobManagerTest, SuspendedTaskIsTriedAgain) {
  Start(1, kImpatient);
  const std::string sequence = ReadySequence("suspend 3 1\n");
  EXPECT_EQ(Ended(NewJobOn(sequence)).record.state, JobState::kSucceeded);
  EXPECT_FALSE(IsAlive(Logged(sequence, "suspend").at(0)));
}

// As the kernel does when memory runs out, or anybody by hand.
TEST_F(JobManagerTest, KilledTaskIsTriedAgainAndNotForEver) {
  Start();
  const std::string sequence = ReadySequence("intervals 1\nhang 3 100\n");
  const std::string job = NewJobOn(sequence);
  for (size_t i = 0; i < kMaxAttempts; ++i) {
    WaitUntil([&] { return Logged(sequence, "hang").size() == i + 1; });
    EXPECT_EQ(State(job), JobState::kRunning);
    kill(Logged(sequence, "hang").back(), SIGKILL);
  }
  const JobRecord failed = Ended(job).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(std::string(failed.error.message()), AllOf(HasSubstr("SIGKILL"), HasSubstr("memory runs out")));
  EXPECT_THAT(Logged(sequence, "hang"), SizeIs(kMaxAttempts));
}

TEST_F(JobManagerTest, TaskWithoutEndUsesUpItsProcessorTime) {
  Start(1, {.task_cpu_seconds = 1});
  const JobRecord failed = Ended(NewJobOn(ReadySequence("burn 3\n"))).record;
  EXPECT_EQ(failed.state, JobState::kFailed);
  EXPECT_THAT(failed.error, HasCode(absl::StatusCode::kResourceExhausted)) << "the next attempt would use it up too";
  EXPECT_THAT(std::string(failed.error.message()), HasSubstr("the 1 s of processor time that a task may"));
}

// While the next attempt is an hour away, the worker serves others; neither cancelling nor the end of the server waits
// for it, and after that end the failure counts.
TEST_F(JobManagerTest, WaitingForTheNextAttemptHoldsNobodyUp) {
  Start();
  const std::string crashing = ReadySequence("crash_at 0 3\n"), once = ReadySequence("crash_at 0 1\n");
  const std::string sound = ReadySequence();
  Close();
  const auto restart = [&] {
    OpenStores(folder_ / "data");
    StartJobs(1, {.retry_backoff = absl::Hours(1)}, /*hasty=*/false);
  };
  const auto crashes = [&](const std::string& sequence) {
    return ReadText(directory_->SequenceFolder(sequence) + "/crashes").size();
  };
  restart();
  const std::string failing = NewJobOn(crashing);
  for (size_t i = 1; i < kMaxAttempts; ++i) {
    WaitUntil([&] { return crashes(crashing) == i; });
    EXPECT_EQ(Ended(NewJobOn(sound)).record.state, JobState::kSucceeded);
    EXPECT_EQ(State(failing), JobState::kRunning);
    Close();
    restart();
  }
  EXPECT_EQ(Ended(failing).record.state, JobState::kFailed) << "no crash was forgotten";

  const std::string cancelled = NewJobOn(once);
  WaitUntil([&] { return crashes(once) == 1; });
  EXPECT_EQ(Ended(NewJobOn(sound)).record.state, JobState::kSucceeded);
  EXPECT_EQ(Take(jobs_->Cancel(kTenant, cancelled)).record.state, JobState::kCancelled);
  EXPECT_THAT(jobs_->Retry(kTenant, cancelled), IsOk());
  EXPECT_EQ(Ended(cancelled).record.state, JobState::kSucceeded);
}

// ---- watching ----

// A watcher as the RPC layer is one: it waits to be told, then takes what there is.
class Watcher {
 public:
  Watcher(JobManager& jobs, const std::string& job, const std::string& token = "") {
    watch_ = Take(jobs.Watch(kTenant, job, token, [this] { news_.store(true); }));
  }
  JobEvent Next() {
    while (true) {
      if (std::optional<JobEvent> event = watch_->Next()) return *event;
      WaitUntil([this] { return news_.exchange(false); });
    }
  }
  std::optional<JobEvent> Poll() { return watch_->Next(); }
  bool Deleted() { return watch_->Deleted(); }

 private:
  std::atomic<bool> news_{false};
  std::unique_ptr<JobWatch> watch_;  // last: its end waits for a call that is under way
};

TEST_F(JobManagerTest, WatcherHearsOfEverythingInOrder) {
  Start();
  const std::string sequence = ReadySequence("intervals 4\nwait_at 0\n");
  const std::string job = NewJobOn(sequence);
  Watcher watcher(*jobs_, job);
  JobEvent event = watcher.Next();
  EXPECT_EQ(event.kind, JobEvent::Kind::kSnapshot);
  Go(sequence);
  std::vector<int> frames;
  int64_t number = event.number;
  int done = event.job.record.intervals_done;
  while (!HasEnded(event.job.record.state)) {
    event = watcher.Next();
    EXPECT_EQ(event.number, ++number);
    EXPECT_GE(event.job.record.intervals_done, done) << "progress never goes back";
    done = event.job.record.intervals_done;
    if (event.kind != JobEvent::Kind::kFramesReady) continue;
    for (int i = 0; i < event.frame_count; ++i) {
      frames.push_back(event.first_frame + i);
      // Announced means stored: it can be read now.
      EXPECT_TRUE(Take(jobs_->Frames(kTenant, job, event.first_frame + i, 1))[0].ready);
    }
  }
  EXPECT_THAT(frames, ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  EXPECT_EQ(event.job.record.state, JobState::kSucceeded);
  EXPECT_EQ(watcher.Poll(), std::nullopt);

  // Who comes late gets the end.
  const JobEvent late = Watcher(*jobs_, job).Next();
  EXPECT_EQ(late.kind, JobEvent::Kind::kSnapshot);
  EXPECT_EQ(late.job.record.state, JobState::kSucceeded);
  EXPECT_THAT(jobs_->Delete(kTenant, job), IsOk());
  EXPECT_TRUE(watcher.Deleted());
}

TEST_F(JobManagerTest, WatcherThatReconnectsGetsWhatItMissed) {
  Start();
  const std::string sequence = ReadySequence("wait_at 2\n");
  const std::string job = NewJobOn(sequence);
  std::vector<JobEvent> seen;
  {
    Watcher watcher(*jobs_, job);
    do seen.push_back(watcher.Next());
    while (seen.back().job.record.intervals_done < 1);
  }
  WaitUntil([&] { return View(job).record.intervals_done == 2; });
  Watcher again(*jobs_, job, seen.back().resume_token);
  const JobEvent next = again.Next();
  EXPECT_NE(next.kind, JobEvent::Kind::kSnapshot);
  EXPECT_EQ(next.number, seen.back().number + 1);
  // A token of another server, or of another job, is not known: the snapshot supersedes everything.
  EXPECT_EQ(Watcher(*jobs_, job, "deadbeef-1-1").Next().kind, JobEvent::Kind::kSnapshot);
  const std::string other = NewJobOn(sequence);
  EXPECT_EQ(Watcher(*jobs_, other, seen.back().resume_token).Next().kind, JobEvent::Kind::kSnapshot);
  EXPECT_THAT(jobs_->Watch(kTenant, "0000000000000000", "", [] {}), HasCode(absl::StatusCode::kNotFound));
  Go(sequence);
  Ended(job);
}

TEST_F(JobManagerTest, WatcherInTheQueueHearsThatItMovesUp) {
  Start();
  const std::string sequence = ReadySequence("wait_at 0\n");
  const std::string first = NewJobOn(sequence), second = NewJobOn(sequence), third = NewJobOn(sequence);
  WaitUntil([&] { return State(first) == JobState::kRunning; });
  Watcher watcher(*jobs_, third);
  EXPECT_EQ(watcher.Next().job.progress.queue_position, 2);
  EXPECT_THAT(jobs_->Cancel(kTenant, second), IsOk());
  EXPECT_EQ(watcher.Next().job.progress.queue_position, 1);
  Go(sequence);
  Ended(third);
}

}  // namespace
}  // namespace depthtween::server
