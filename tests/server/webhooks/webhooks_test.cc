// Ends of jobs in a real store, told to a receiver that answers as each test says; what the store then holds is
// compared.
#include "server/webhooks/webhooks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/time/clock.h"
#include "server/store/sqlite_store.h"
#include "tests/server/server_fixtures.h"
#include "tests/server/webhooks/receiver.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

class WebhooksTest : public testing::Test {
 protected:
  WebhooksTest() {
    folder_.Write("key", "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n");
    options_ = {.key_file = folder_ / "key",
                .allow_private = true,
                .max_attempts = 3,
                .first_pause = absl::Milliseconds(10),
                .look_every = absl::Milliseconds(5)};
    const auto no_batch = [](const JobRecord&, TaskKind) { return 1; };
    sequence_ = Take(store_->CreateSequence(kTenant, "", "")).id;
    const std::string upload =
        Take(store_->CreateUpload(kTenant, sequence_, {{.path = "a"}}, /*room_bytes=*/1 << 30, "")).id;
    EXPECT_THAT(store_->FinishUpload(upload), IsOk());
    EXPECT_THAT(store_->CommitSequence(kTenant, sequence_), IsOk());
    const int64_t task = Take(store_->ClaimTask(no_batch))->number;
    EXPECT_THAT(store_->FinishValidation(task, {.recording = Recording()}), IsOk());
  }
  // A job that has ended, which is to be told.
  std::string EndedJob(const std::string& url) {
    const std::string id =
        Take(store_->CreateJob(kTenant, {.sequence_id = sequence_, .webhook_url = url}, "", false)).id;
    EXPECT_THAT(store_->CancelJob(kTenant, id), IsOk());
    return id;
  }
  WebhookRecord Record(const std::string& job) { return *Take(store_->GetJob(kTenant, job)).webhook; }
  WebhookRecord Settled(const std::string& job) {
    while (Record(job).state == WebhookState::kSending) absl::SleepFor(absl::Milliseconds(2));
    return Record(job);
  }
  std::unique_ptr<Webhooks> Start() {
    return Take(Webhooks::Start(
        *store_, [](std::string_view id) { return absl::StrCat("body of ", View(id)); }, options_));
  }
  static std::string IdOf(const std::string& request) {
    const size_t begin = request.find("webhook-id: ");
    return request.substr(begin, request.find("\r\n", begin) - begin);
  }

  TemporaryFolder folder_;
  std::unique_ptr<Store> store_ = Take(OpenSqliteStore(folder_ / "database", {}));
  WebhookOptions options_;
  std::string sequence_;
};

TEST_F(WebhooksTest, TriesUntilItIsTaken) {
  Receiver receiver({"500 No", "503 No", "200 OK"});
  const std::string job = EndedJob(receiver.url());
  const auto webhooks = Start();
  const WebhookRecord record = Settled(job);
  EXPECT_EQ(record.state, WebhookState::kDelivered);
  EXPECT_EQ(record.attempts, 3);
  EXPECT_EQ(record.last_error, "");
  const std::vector<std::string> requests = receiver.requests();
  ASSERT_THAT(requests, SizeIs(3));
  EXPECT_THAT(requests[0], HasSubstr("body of " + job));
  EXPECT_EQ(IdOf(requests[0]), IdOf(requests[2])) << "it is one event";
}

TEST_F(WebhooksTest, GivesUpInTheEnd) {
  Receiver failing({"500 No"}), gone({"410 Gone"});
  const std::string job = EndedJob(failing.url()), other = EndedJob(gone.url());
  const auto webhooks = Start();
  const WebhookRecord record = Settled(job), at_once = Settled(other);
  EXPECT_EQ(record.state, WebhookState::kGivenUp);
  EXPECT_EQ(record.attempts, 3);
  EXPECT_THAT(record.last_error, HasSubstr("answered 500"));
  EXPECT_EQ(at_once.state, WebhookState::kGivenUp);
  EXPECT_EQ(at_once.attempts, 1);
}

TEST_F(WebhooksTest, AReceiverThatHangsKeepsNoOtherWaiting) {
  Receiver hanging({""}), receiver({"200 OK"});
  options_.threads = 2;
  // Resolved, not compared: a host of its own.
  const std::string slow = "http://localhost:" + std::to_string(hanging.port()) + "/";
  const std::string first = EndedJob(slow), second = EndedJob(slow), third = EndedJob(slow);
  const std::string job = EndedJob(receiver.url());
  const auto webhooks = Start();
  EXPECT_EQ(Settled(job).state, WebhookState::kDelivered);
  EXPECT_EQ(Record(third).state, WebhookState::kSending);
  EXPECT_EQ(Record(third).attempts, 0);
}

TEST_F(WebhooksTest, WhatAStopCutsOffIsSentByTheNextStart) {
  Receiver receiver({"", "200 OK"});
  const std::string job = EndedJob(receiver.url());
  {
    const auto webhooks = Start();
    while (receiver.connections() == 0) absl::SleepFor(absl::Milliseconds(2));
  }
  EXPECT_EQ(Record(job).state, WebhookState::kSending);
  EXPECT_EQ(Record(job).attempts, 0);
  const auto webhooks = Start();
  EXPECT_EQ(Settled(job).state, WebhookState::kDelivered);
}

TEST_F(WebhooksTest, WhatIsNoLongerAllowedIsNotSent) {
  Receiver receiver({"200 OK"});
  const std::string job = EndedJob(receiver.url());
  options_.allow_private = false;
  options_.max_attempts = 1;
  const auto webhooks = Start();
  EXPECT_EQ(Settled(job).state, WebhookState::kGivenUp);
  EXPECT_EQ(receiver.connections(), 0);
}

TEST_F(WebhooksTest, AJobMayNameWhatTheOperatorAllows) {
  EXPECT_THAT(CheckWebhook(options_, "http://127.0.0.1/x"), IsOk());
  options_.allow_private = false;
  EXPECT_THAT(CheckWebhook(options_, "https://example.org/x"), IsOk());
  for (const char* bad :
       {"http://example.org/x", "https://127.0.0.1/x", "https://[::1]/x", "https://169.254.169.254/"}) {
    EXPECT_THAT(CheckWebhook(options_, bad), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << bad;
  }
  options_.key_file.clear();
  EXPECT_THAT(CheckWebhook(options_, "https://example.org/x"),
              HasReason(absl::StatusCode::kFailedPrecondition, "NO_WEBHOOKS"));
  EXPECT_EQ(Record(EndedJob("https://example.org/x")).state, WebhookState::kSending);
  options_.key_file = "/no/such/file";
  EXPECT_THAT(Webhooks::Start(*store_, nullptr, options_), HasCode(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace depthtween::server
