// Posts to a receiver of this test: what arrives is what was to be sent, and each answer means what RFC 9110 says.
#include "server/webhooks/post.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/server/server_fixtures.h"
#include "tests/server/webhooks/receiver.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

absl::Status Post(const std::string& url, const PostOptions& options = {.allow_private = true},
                  const std::stop_token& stop = {}) {
  return PostWebhook(Take(ParseWebhookUrl(url, true)),
                     {.event_id = "job-1", .timestamp_s = 1234567890, .signature = "v1,abc=", .body = R"({"a":1})"},
                     options, stop);
}
std::string Message(const absl::Status& status) { return std::string(status.message()); }

TEST(PostWebhook, SendsWhatIsToBeSent) {
  Receiver receiver({"204 No Content"});
  EXPECT_THAT(Post(receiver.url()), IsOk());
  ASSERT_EQ(receiver.requests().size(), 1U);
  const std::string request = receiver.requests()[0];
  EXPECT_EQ(request.find("POST /hook?a=b HTTP/1.1\r\n"), 0U) << request;
  for (const std::string& line :
       {"Host: 127.0.0.1:" + std::to_string(receiver.port()), std::string("Content-Type: application/json"),
        std::string("webhook-id: job-1"), std::string("webhook-timestamp: 1234567890"),
        std::string("webhook-signature: v1,abc="), std::string("Content-Length: 7")}) {
    EXPECT_THAT(request, HasSubstr("\r\n" + line + "\r\n"));
  }
  EXPECT_EQ(request.substr(request.find("\r\n\r\n") + 4), R"({"a":1})");
}

TEST(PostWebhook, JudgesTheAnswer) {
  Receiver receiver({"500 Oh", "302 Found\r\nLocation: /other", "410 Gone", "200 OK"});
  const absl::Status failed = Post(receiver.url());
  EXPECT_THAT(failed, HasCode(absl::StatusCode::kUnavailable));
  EXPECT_THAT(Message(failed), HasSubstr("answered 500"));
  EXPECT_THAT(Message(Post(receiver.url())), HasSubstr("answered 302; redirects are not followed"));
  EXPECT_THAT(Post(receiver.url()), HasCode(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(Post(receiver.url()), IsOk());
  EXPECT_EQ(receiver.connections(), 4);
}

TEST(PostWebhook, ConnectsToNoAddressThatIsNotPublic) {
  Receiver receiver({"200 OK"});
  for (const std::string host : {"127.0.0.1", "localhost"}) {
    const absl::Status refused =
        Post("http://" + host + ":" + std::to_string(receiver.port()) + "/", {.allow_private = false});
    EXPECT_THAT(refused, HasCode(absl::StatusCode::kPermissionDenied));
    EXPECT_THAT(Message(refused), HasSubstr("is no address of the public internet"));
  }
  EXPECT_EQ(receiver.connections(), 0);
}

TEST(PostWebhook, WaitsForNobodyForEver) {
  Receiver receiver({""});
  const absl::Status late = Post(receiver.url(), {.allow_private = true, .time_limit = absl::Milliseconds(200)});
  EXPECT_THAT(late, HasCode(absl::StatusCode::kUnavailable));
  EXPECT_THAT(Message(late), HasSubstr("no answer within 200ms"));

  std::stop_source stop;
  std::thread stopper([&] {
    while (receiver.connections() < 2) std::this_thread::yield();
    stop.request_stop();
  });
  EXPECT_THAT(Post(receiver.url(), {.allow_private = true}, stop.get_token()), HasCode(absl::StatusCode::kCancelled));
  stopper.join();
}

TEST(PostWebhook, SaysWhyThereIsNoConnection) {
  int port = 0;
  {
    const Receiver gone({"200 OK"});
    port = gone.port();
  }
  EXPECT_THAT(Message(Post("http://127.0.0.1:" + std::to_string(port) + "/")), HasSubstr("cannot connect"));
  EXPECT_THAT(Message(Post("http://no-such-host.invalid/")), HasSubstr("its name leads nowhere"));
  // What answers is no TLS.
  Receiver receiver({"200 OK"});
  EXPECT_THAT(Message(Post("https://127.0.0.1:" + std::to_string(receiver.port()) + "/",
                           {.allow_private = true, .time_limit = absl::Milliseconds(500)})),
              HasSubstr("127.0.0.1"));
}

}  // namespace
}  // namespace depthtween::server
