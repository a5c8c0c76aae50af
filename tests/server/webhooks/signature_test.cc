// The example that the libraries of Standard Webhooks test themselves with; Python's hmac module gives the same.
#include "server/webhooks/signature.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::SizeIs;

constexpr char kKey[] = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

TEST(SignWebhook, IsThatOfTheSpecification) {
  const std::vector<std::string> keys = Take(ParseWebhookKeys(kKey));
  EXPECT_EQ(SignWebhook(keys, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, R"({"test": 2432232314})"),
            "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
  EXPECT_NE(SignWebhook(keys, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265331, R"({"test": 2432232314})"),
            "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
}

TEST(SignWebhook, WithEachKeyWhileOneIsReplaced) {
  const std::vector<std::string> keys =
      Take(ParseWebhookKeys(std::string("# since May\nwhsec_QUFBQUFBQUFBQUFBQUFBQUFBQUFBQUFB\n\n") + kKey + "\r\n"));
  ASSERT_THAT(keys, SizeIs(2));
  EXPECT_EQ(keys[0], std::string(24, 'A'));
  EXPECT_THAT(SignWebhook(keys, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, R"({"test": 2432232314})"),
              HasSubstr(" v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="));
}

TEST(ParseWebhookKeys, SaysWhatIsWrong) {
  for (const char* bad : {"", "# nothing", "MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "whsec_c2hvcnQ=", "whsec_&&&"}) {
    EXPECT_THAT(ParseWebhookKeys(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
  EXPECT_THAT(std::string(ParseWebhookKeys(std::string(kKey) + "\nwhsec_c2hvcnQ=").status().message()),
              HasSubstr("line 2 must be"));
  EXPECT_THAT(ReadWebhookKeys("/no/such/file"), HasCode(absl::StatusCode::kNotFound));
  TemporaryFolder folder;
  folder.Write("key", "nonsense");
  EXPECT_THAT(std::string(ReadWebhookKeys(folder / "key").status().message()), HasSubstr(folder / "key"));
}

}  // namespace
}  // namespace depthtween::server
