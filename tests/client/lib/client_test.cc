// The client against a server that fails as networks do: whatever is cut or damaged on the way, what arrives is whole.

#include <gmock/gmock.h>
#include <google/protobuf/message.h>
#include <gtest/gtest.h>

#include <set>

#include "client/lib/fetch.h"
#include "client/lib/jobs.h"
#include "client/lib/upload.h"
#include "tests/client/lib/fake_server.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::client {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class ClientTest : public testing::Test {
 protected:
  void SetUp() override {
    auto connection = Connection::Open({.address = server_.address(), .patience = std::chrono::seconds(10)});
    ASSERT_TRUE(connection.ok()) << connection.status();
    connection_ = *std::move(connection);
  }

  // Six files, the largest of which spans several chunks of 100 bytes.
  LocalSequence WriteRecording() {
    folder_.Write("rgb.txt", "0 rgb/0.png\n1 rgb/1.png\n");
    folder_.Write("depth.txt", "0 depth/0.png\n");
    folder_.Write("camera.json", "{}");
    folder_.Write("rgb/0.png", std::string(250, 'r'));
    folder_.Write("rgb/1.png", "");
    folder_.Write("depth/0.png", std::string(333, 'd'));
    auto sequence = FindSequence(folder_.path());
    EXPECT_TRUE(HashFiles(*sequence, nullptr).ok());
    return *sequence;
  }
  void ExpectArrived(const LocalSequence& sequence) {
    const auto files = server_.sequences.Files();
    EXPECT_EQ(files.size(), sequence.files.size());
    for (const LocalFile& file : sequence.files) EXPECT_EQ(files.at(file.path), folder_.Read(file.path)) << file.path;
  }

  FakeServer server_;
  TemporaryFolder folder_;
  std::unique_ptr<Connection> connection_;
};

// Port 1 of loopback is refused on any machine of ours.
TEST(Connection, SaysWhichServerDoesNotAnswerAndHowToStartOne) {
  int told = 0;
  const auto connection = Connection::Open(
      {.address = "127.0.0.1:1", .patience = std::chrono::seconds(1), .on_away = [&](const absl::Status& why) {
         EXPECT_TRUE(absl::IsUnavailable(why));
         ++told;
       }});
  EXPECT_EQ(told, 1) << "of the one absence, however many tries";
  EXPECT_TRUE(absl::IsUnavailable(connection.status()));
  EXPECT_THAT(std::string(connection.status().message()), HasSubstr("127.0.0.1:1"));
  EXPECT_THAT(std::string(connection.status().message()), HasSubstr("depthtween-server serve"));
  EXPECT_THAT(std::string(connection.status().message()), HasSubstr("(Connection refused)"));
}

// The top level domain "invalid" is one that nobody has (RFC 6761).
TEST(Connection, AnUnknownHostIsSaidInPlainWords) {
  const auto connection = Connection::Open({.address = "no-such-host.invalid", .patience = std::chrono::seconds(0)});
  EXPECT_TRUE(absl::IsUnavailable(connection.status())) << connection.status();
  EXPECT_THAT(std::string(connection.status().message()), testing::Not(HasSubstr("C-ares")));
}

// What no server can listen on is said at once: gRPC would wrap port 99999 around and ask a stranger.
TEST(Connection, AnAddressThatIsNoneIsRefused) {
  for (const char* address : {"host", "127.0.0.1:50051", "[::1]", "[::1]:7", "unix:/tmp/socket", "localhost:1"}) {
    EXPECT_EQ(AddressProblem(address), "") << address;
  }
  for (const char* address : {"", ":50051", "http://host:50051", "host:", "host:0", "host:99999", "host:port"}) {
    EXPECT_NE(AddressProblem(address), "") << address;
    EXPECT_TRUE(absl::IsInvalidArgument(Connection::Open({.address = address}).status())) << address;
  }
}

TEST(Connection, WithoutPatienceTriesOnce) {
  const auto connection = Connection::Open(
      {.address = "127.0.0.1:1", .patience = std::chrono::seconds(0), .on_away = [](const absl::Status& why) {
         ADD_FAILURE() << "waits: " << why;
       }});
  EXPECT_TRUE(absl::IsUnavailable(connection.status()));
}

// The server comes up only once the client has said that it waits.
TEST(Connection, FirstContactIsAsPatientAsEveryCall) {
  const std::string address = FakeServer().address();
  std::unique_ptr<FakeServer> server;
  const auto connection =
      Connection::Open({.address = address, .patience = std::chrono::minutes(2), .on_away = [&](const absl::Status&) {
                          server = std::make_unique<FakeServer>(address);
                        }});
  ASSERT_TRUE(connection.ok()) << connection.status();
  EXPECT_EQ((*connection)->server().version(), "fake");
}

// A server that takes connections and says nothing is away too; what it says of its own work is not for us to retry.
TEST(Connection, OurDeadlineIsAnAbsenceAndTheServersAnAnswer) {
  FakeServer server;
  const auto connection = Connection::Open({.address = server.address()});
  ASSERT_TRUE(connection.ok());
  const grpc::Status ours(grpc::StatusCode::DEADLINE_EXCEEDED, "Deadline Exceeded");
  EXPECT_TRUE(IsTransient((*connection)->Answer(ours)));
  EXPECT_THAT(std::string((*connection)->Answer(ours).message()), HasSubstr("no answer in time"));
  const grpc::Status theirs(grpc::StatusCode::DEADLINE_EXCEEDED, "it took longer than 30s", "details");
  EXPECT_TRUE(absl::IsDeadlineExceeded((*connection)->Answer(theirs)));
}

TEST_F(ClientTest, UploadsEveryByte) {
  const LocalSequence sequence = WriteRecording();
  UploadProgress last;
  const auto remote = UploadSequence(*connection_, sequence, [&](const UploadProgress& now) { last = now; });
  ASSERT_TRUE(remote.ok()) << remote.status();
  ExpectArrived(sequence);
  EXPECT_EQ(last.bytes_done, sequence.size_bytes);
  EXPECT_EQ(last.bytes_found, 0);
  const auto ready = AwaitValidation(*connection_, remote->name(), nullptr);
  ASSERT_TRUE(ready.ok());
  EXPECT_EQ(ready->state(), v1::Sequence::STATE_READY);
}

// The fault is injected at every message in turn, so no place where a line can be cut is left out.
TEST_F(ClientTest, UploadSurvivesACutAtAnyMessage) {
  const LocalSequence sequence = WriteRecording();
  for (int message = 1; message <= 7; ++message) {
    FakeServer server;
    server.sequences.away_at_message = message;
    const auto connection = Connection::Open({.address = server.address()});
    ASSERT_TRUE(connection.ok());
    const auto remote = UploadSequence(**connection, sequence, nullptr);
    ASSERT_TRUE(remote.ok()) << remote.status();
    const auto files = server.sequences.Files();
    for (const LocalFile& file : sequence.files) EXPECT_EQ(files.at(file.path), folder_.Read(file.path)) << message;
  }
}

TEST_F(ClientTest, UploadSendsDamagedBytesAgain) {
  const LocalSequence sequence = WriteRecording();
  server_.sequences.damage_at_message = 3;
  ASSERT_TRUE(UploadSequence(*connection_, sequence, nullptr).ok());
  ExpectArrived(sequence);
}

// The fake counts messages: the second call may send none.
TEST_F(ClientTest, UploadingAgainSendsNothing) {
  const LocalSequence sequence = WriteRecording();
  ASSERT_TRUE(UploadSequence(*connection_, sequence, nullptr).ok());
  const int messages = server_.sequences.messages;
  UploadProgress last;
  ASSERT_TRUE(UploadSequence(*connection_, sequence, [&](const UploadProgress& now) { last = now; }).ok());
  EXPECT_EQ(server_.sequences.messages, messages);
  EXPECT_EQ(last.bytes_found, sequence.size_bytes);
  EXPECT_THAT(server_.sequences.request_ids, ElementsAre(sequence.fingerprint, sequence.fingerprint));
}

TEST_F(ClientTest, SubmittingAgainIsTheSameRequestAndOtherOptionsAnother) {
  v1::Job job;
  job.set_sequence("sequences/1");
  ASSERT_TRUE(SubmitJob(*connection_, job).ok());
  ASSERT_TRUE(SubmitJob(*connection_, job).ok());
  const auto with = [&](const auto& change) {
    v1::Job other = job;
    change(*other.mutable_options());
    ASSERT_TRUE(SubmitJob(*connection_, other).ok());
  };
  with([](v1::UpsampleOptions& options) { options.set_method("hold"); });
  with([](v1::UpsampleOptions& options) { options.set_key_every(2); });
  with([](v1::UpsampleOptions& options) { options.set_preset("fast"); });
  with([](v1::UpsampleOptions& options) { options.add_without("draw"); });
  with([](v1::UpsampleOptions& options) { options.set_self_check(true); });
  with([](v1::UpsampleOptions& options) { options.set_causal(true); });
  with([](v1::UpsampleOptions& options) { options.set_clock("4,300"); });
  const auto& ids = server_.jobs.request_ids;
  ASSERT_EQ(ids.size(), 9U);
  EXPECT_EQ(ids[0], ids[1]);
  EXPECT_EQ(std::set<std::string>(ids.begin(), ids.end()).size(), 8U);
  EXPECT_EQ(server_.jobs.retries, 0);
}

// Whatever field of its options an order sets, it is another request: a new one cannot be forgotten here.
TEST_F(ClientTest, EveryOptionIsPartOfTheRequest) {
  const auto set = [](google::protobuf::Message& options, const google::protobuf::FieldDescriptor* field) {
    const auto* const reflection = options.GetReflection();
    switch (field->cpp_type()) {
      case google::protobuf::FieldDescriptor::CPPTYPE_BOOL:
        return reflection->SetBool(&options, field, true);
      case google::protobuf::FieldDescriptor::CPPTYPE_INT32:
        return reflection->SetInt32(&options, field, 2);
      case google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE:
        return reflection->SetDouble(&options, field, 2);
      default:
        return field->is_repeated() ? reflection->AddString(&options, field, "x")
                                    : reflection->SetString(&options, field, "x");
    }
  };
  ASSERT_TRUE(SubmitJob(*connection_, v1::Job()).ok());
  for (int i = 0; i < v1::UpsampleOptions::descriptor()->field_count(); ++i) {
    v1::Job job;
    set(*job.mutable_options(), v1::UpsampleOptions::descriptor()->field(i));
    ASSERT_TRUE(SubmitJob(*connection_, job).ok());
  }
  v1::Job scene_flow;
  scene_flow.mutable_scene_flow_options();
  ASSERT_TRUE(SubmitJob(*connection_, scene_flow).ok());
  for (int i = 0; i < v1::SceneFlowOptions::descriptor()->field_count(); ++i) {
    v1::Job job;
    set(*job.mutable_scene_flow_options(), v1::SceneFlowOptions::descriptor()->field(i));
    ASSERT_TRUE(SubmitJob(*connection_, job).ok());
  }
  const auto& ids = server_.jobs.request_ids;
  EXPECT_EQ(std::set<std::string>(ids.begin(), ids.end()).size(), ids.size());
}

TEST_F(ClientTest, SubmittingACancelledJobQueuesItAgain) {
  server_.jobs.state_of_created = v1::Job::STATE_CANCELLED;
  const auto job = SubmitJob(*connection_, v1::Job());
  ASSERT_TRUE(job.ok());
  EXPECT_EQ(job->state(), v1::Job::STATE_QUEUED);
  EXPECT_EQ(server_.jobs.retries, 1);
}

// The first try gets through and its answer is lost: the second is refused, and yet the job is queued.
TEST_F(ClientTest, ARetryWhoseAnswerWasLostIsNoFailure) {
  server_.jobs.state_of_created = v1::Job::STATE_FAILED;
  server_.jobs.away_at_retry = 1;
  server_.jobs.state_of_asked = v1::Job::STATE_QUEUED;
  const auto job = SubmitJob(*connection_, v1::Job());
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(job->state(), v1::Job::STATE_QUEUED);
  EXPECT_EQ(server_.jobs.retries, 2);

  server_.jobs.away_at_retry = 100;
  server_.jobs.state_of_asked = v1::Job::STATE_FAILED;
  EXPECT_TRUE(absl::IsFailedPrecondition(SubmitJob(*connection_, v1::Job()).status()));
}

// The first try deletes the job and its answer is lost: the second finds none. A name that never was is still an error.
TEST_F(ClientTest, ADeleteWhoseAnswerWasLostIsNoFailure) {
  const auto remove = [&] {
    return connection_->Remove(connection_->jobs(), &v1::JobService::StubInterface::DeleteJob, v1::DeleteJobRequest());
  };
  server_.jobs.unanswered_deletes = 1;
  const absl::Status removed = remove();
  EXPECT_TRUE(removed.ok()) << removed;
  EXPECT_EQ(server_.jobs.deletes, 2);
  EXPECT_TRUE(absl::IsNotFound(remove()));
  EXPECT_EQ(server_.jobs.deletes, 3);
}

// The line is cut after the first event; the watcher must name that event's token, see each event once, and end with
// the job's own record.
TEST_F(ClientTest, WatchGoesOnAfterTheEventItSawLast) {
  v1::JobEvent event;
  event.set_resume_token("one");
  event.mutable_snapshot()->set_state(v1::Job::STATE_QUEUED);
  server_.jobs.events.push_back(event);
  event.set_resume_token("two");
  event.mutable_frames_ready()->mutable_progress()->set_frames_done(4);
  server_.jobs.events.push_back(event);
  event.set_resume_token("measured");
  event.mutable_state_change()->set_state(v1::Job::STATE_RUNNING);
  event.mutable_state_change()->mutable_self_check()->set_summary("good");
  event.mutable_state_change()->mutable_clock_estimate()->set_summary(", ahead");
  event.mutable_state_change()->add_warnings(", a warning");
  server_.jobs.events.push_back(event);
  event.mutable_state_change()->Clear();
  event.set_resume_token("three");
  event.mutable_state_change()->set_state(v1::Job::STATE_SUCCEEDED);
  event.mutable_state_change()->add_warnings(", a warning");
  server_.jobs.events.push_back(event);

  std::vector<std::string> seen;
  int frames_done = -1;
  std::string measured;
  const auto job = WatchJob(*connection_, "jobs/1", [&](const v1::JobEvent& event, const v1::Job& job) {
    seen.push_back(event.resume_token());
    if (event.has_frames_ready()) frames_done = job.progress().frames_done();
    measured = job.self_check().summary() + job.clock_estimate().summary() + absl::StrJoin(job.warnings(), "");
  });
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_THAT(seen, ElementsAre("one", "two", "measured", "three"));
  EXPECT_EQ(frames_done, 4);
  EXPECT_EQ(measured, "good, ahead, a warning") << "what was measured stays";
  EXPECT_THAT(server_.jobs.resume_tokens, ElementsAre("", "one"));
  EXPECT_EQ(job->state(), v1::Job::STATE_SUCCEEDED);
  EXPECT_EQ(job->end_time().seconds(), 1);
}

class FetchTest : public ClientTest {
 protected:
  void SetUp() override {
    ClientTest::SetUp();
    server_.outputs.frames = {std::string(40, 'a'), std::string(16, 'b'), std::string(1, 'c')};
    server_.outputs.frames_ready = 3;
  }
  absl::StatusOr<FetchSummary> Fetch(const FetchOptions& options = {}) {
    return FetchResult(*connection_, "jobs/1", folder_ / "out", options, nullptr);
  }
  void ExpectWhole() {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(folder_.Read(absl::StrCat("out/depth/frame", i, ".png")), server_.outputs.frames[i]);
    }
    EXPECT_EQ(folder_.Read("out/report.json"), server_.outputs.report);
    EXPECT_FALSE(folder_.Has("out/.fetch.json"));
  }
};

// Five chunks carry the three frames: the line is cut before each in turn, then each in turn is damaged.
TEST_F(FetchTest, FramesArriveWholeWhateverIsCutOrDamaged) {
  for (int chunk = 1; chunk <= 5; ++chunk) {
    for (int* fault : {&server_.outputs.away_at_chunk, &server_.outputs.damage_at_chunk}) {
      server_.outputs.chunks = 0;
      *fault = chunk;
      const auto summary = Fetch({.replace = true});
      ASSERT_TRUE(summary.ok()) << summary.status();
      EXPECT_TRUE(summary->complete);
      ExpectWhole();
      *fault = 0;
    }
  }
}

// Two of three frames are ready at first: the second call must ask for the third only.
TEST_F(FetchTest, GoesOnWhereItStopped) {
  server_.outputs.frames_ready = 2;
  auto summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_FALSE(summary->complete);
  EXPECT_EQ(summary->progress.frames_done, 2);
  EXPECT_FALSE(folder_.Has("out/report.json"));

  server_.outputs.frames_ready = 3;
  summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_TRUE(summary->complete);
  EXPECT_EQ(server_.outputs.start_frames.back(), 2);
  ExpectWhole();
}

// One without bytes says that an output has nothing for it: no file, and yet nothing is missing.
TEST_F(FetchTest, AFrameWithoutBytesLeavesNoFile) {
  server_.outputs.frames[1].clear();
  server_.outputs.frames[2].clear();
  const auto summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_TRUE(summary->complete);
  EXPECT_TRUE(folder_.Has("out/depth/frame0.png"));
  EXPECT_FALSE(folder_.Has("out/depth/frame1.png"));
  EXPECT_FALSE(folder_.Has("out/depth/frame2.png"));
}

// All else is fetched, and what is lost is named: neither done nor not ready yet, which would make one fetch for ever.
TEST_F(FetchTest, WhatTheServerHasLostIsLeftOutAndNamed) {
  server_.outputs.lost_frames = {0, 2};
  server_.outputs.report_is_lost = true;
  auto summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_FALSE(summary->complete);
  EXPECT_EQ(summary->progress.frames_done, 1);
  ASSERT_EQ(summary->lost.size(), 2U);
  EXPECT_EQ(summary->lost[0].output, "jobs/1/outputs/depth");
  EXPECT_EQ(summary->lost[0].place, "depth");
  EXPECT_THAT(summary->lost[0].frames, ElementsAre(0, 2));
  EXPECT_EQ(summary->lost[1].place, "report.json");
  EXPECT_THAT(summary->lost[1].frames, ElementsAre());
  EXPECT_EQ(folder_.Read("out/depth/frame1.png"), server_.outputs.frames[1]);
  EXPECT_FALSE(folder_.Has("out/depth/frame0.png"));
  EXPECT_FALSE(folder_.Has("out/report.json"));
  EXPECT_THAT(server_.outputs.start_frames, ElementsAre(0, 1, 3)) << "each is asked for once";

  // Asked again, it says the same; what was put back comes, and what there is already does not.
  server_.outputs.lost_frames = {2};
  server_.outputs.start_frames.clear();
  summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_FALSE(summary->complete);
  EXPECT_THAT(summary->lost[0].frames, ElementsAre(2));
  EXPECT_EQ(summary->progress.frames_done, 2);
  EXPECT_THAT(server_.outputs.start_frames, ElementsAre(0, 2, 3));
  server_.outputs.lost_frames.clear();
  server_.outputs.report_is_lost = false;
  summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_TRUE(summary->complete);
  EXPECT_THAT(summary->lost, testing::IsEmpty());
  ExpectWhole();
}

// Who does not ask for what is lost to be left out gets an error, once.
TEST_F(FetchTest, ALostFrameEndsAStreamThatNeedsIt) {
  server_.outputs.lost_frames = {1};
  v1::StreamFramesRequest request;
  request.set_name("jobs/1/outputs/depth");
  std::vector<int> seen;
  const absl::Status status = StreamFrames(*connection_, request, [&](const Frame& frame) {
    seen.push_back(frame.index);
    return absl::OkStatus();
  });
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(seen, ElementsAre(0));
  EXPECT_THAT(server_.outputs.start_frames, ElementsAre(0));
}

TEST_F(FetchTest, DoesNotMixResults) {
  folder_.Write("out/depth/other.png", "of another result");
  EXPECT_TRUE(absl::IsAlreadyExists(Fetch().status()));
  const auto summary = Fetch({.replace = true});
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_FALSE(folder_.Has("out/depth/other.png"));
  ExpectWhole();

  folder_.Write("other/.fetch.json", R"({"job": "jobs/2", "next_frame": {"depth": 2}})");
  EXPECT_TRUE(absl::IsFailedPrecondition(
      FetchResult(*connection_, "jobs/1", folder_ / "other", FetchOptions(), nullptr).status()));

  folder_.Write("recording/rgb.txt", "");
  EXPECT_TRUE(absl::IsInvalidArgument(CheckFolder(folder_ / "recording", /*replace=*/true)));
  EXPECT_TRUE(folder_.Has("recording/rgb.txt"));
}

// A server is not trusted with the names of files on this machine.
TEST_F(FetchTest, RefusesNamesThatLeadOutOfTheFolder) {
  server_.outputs.stems = {"../../escaped", "b", "c"};
  EXPECT_TRUE(absl::IsDataLoss(Fetch().status()));
  EXPECT_FALSE(folder_.Has("escaped.png"));
  server_.outputs.stems.clear();
  for (const std::string escaped : {"", "../escaped", "/escaped", "a//b", "a/.."}) {
    server_.outputs.frame_folder = escaped;
    EXPECT_TRUE(absl::IsDataLoss(Fetch({.replace = true}).status())) << escaped;
  }
}

TEST_F(FetchTest, FramesGoIntoTheFolderThatTheServerNames) {
  server_.outputs.frame_folder = "kitti/flow";
  const auto summary = Fetch();
  ASSERT_TRUE(summary.ok()) << summary.status();
  EXPECT_TRUE(summary->complete);
  EXPECT_EQ(folder_.Read("out/kitti/flow/frame2.png"), server_.outputs.frames[2]);
}

}  // namespace
}  // namespace depthtween::client
