// Callers with tokens that were made for this purpose, of every kind that must be refused, and one that must not.
#include "server/access/guard.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

constexpr auto kUnauthenticated = absl::StatusCode::kUnauthenticated;

class GuardTest : public testing::Test {
 protected:
  std::string Make(std::set<Scope> scopes, const std::string& tenant = "studio") {
    return Take(AddToken(file_, {.tenant = tenant, .scopes = std::move(scopes)}));
  }
  std::unique_ptr<Guard> Open(double calls_per_second = 0) {
    return Take(Guard::Open({.token_file = file_, .max_calls_per_second = calls_per_second}));
  }
  static Credentials Bearer(const std::string& secret) { return {.authorization = "Bearer " + secret, .link = {}}; }

  const TemporaryFolder folder_;
  const std::string file_ = folder_ / "tokens.json";
};

TEST_F(GuardTest, WithoutTokensEverybodyIsTheDefaultTenant) {
  const auto guard = Take(Guard::Open({}));
  EXPECT_EQ(Take(guard->Admit({}, {.scope = Scope::kAdmin}, "")).tenant.name(), kDefaultTenant);
  EXPECT_EQ(Take(guard->Admit(Bearer("anything"), {.scope = Scope::kWrite}, "")).tenant.name(), kDefaultTenant);
}

TEST_F(GuardTest, AKnownTokenIsItsTenant) {
  const std::string secret = Make({Scope::kRead});
  const auto guard = Open();
  const Caller caller = Take(guard->Admit(Bearer(secret), {.scope = Scope::kRead}, "jobs/1"));
  EXPECT_EQ(caller.tenant.name(), "studio");
  EXPECT_EQ(caller.token_id, Take(ReadTokenFile(file_))[0].id);
  EXPECT_THAT(guard->Admit({.authorization = "bearer   " + secret, .link = {}}, {.scope = Scope::kRead}, ""), IsOk());
}

TEST_F(GuardTest, RefusesEveryOtherToken) {
  const std::string secret = Make({Scope::kRead});
  const auto guard = Open();
  EXPECT_THAT(guard->Admit({}, {.scope = Scope::kRead}, ""), HasReason(kUnauthenticated, "NO_TOKEN"));
  const std::vector<std::string> bad_ones = {"Basic YTpi", "Bearer", "Bearer " + secret + "x",
                                             "Bearer " + secret.substr(1), "Bearer " + std::string(100'000, 'a')};
  for (const std::string& bad : bad_ones) {
    EXPECT_THAT(guard->Admit({.authorization = bad, .link = {}}, {.scope = Scope::kRead}, ""),
                HasReason(kUnauthenticated, "BAD_TOKEN"))
        << bad.substr(0, 60);
  }
  EXPECT_THAT(guard->Admit(Bearer(secret), {.scope = Scope::kWrite}, ""),
              HasReason(absl::StatusCode::kPermissionDenied, "WRONG_SCOPE"));
  EXPECT_THAT(guard->Admit(Bearer(secret), {.scope = Scope::kAdmin}, ""),
              HasReason(absl::StatusCode::kPermissionDenied, "WRONG_SCOPE"));
}

TEST_F(GuardTest, AnExpiredTokenSaysSo) {
  const std::string secret = Make({Scope::kRead});
  std::string text = ReadText(file_);
  const size_t at = text.find("\"create_time\"");
  ASSERT_NE(at, std::string::npos);
  text.insert(at, "\"expire_time\": \"2020-01-01T00:00:00Z\",\n      ");
  WriteText(file_, text);
  EXPECT_THAT(Open()->Admit(Bearer(secret), {.scope = Scope::kRead}, ""), HasReason(kUnauthenticated, "EXPIRED_TOKEN"));
}

// The file is looked at once a second; the test waits for the answer to change, at most as long as it is given.
TEST_F(GuardTest, NewAndRevokedTokensCountWithoutARestart) {
  Make({Scope::kRead});
  const auto guard = Open();
  const std::string late = Make({Scope::kRead}, "late");
  const auto becomes = [&](bool ok) {
    for (int i = 0; i < 300; ++i) {
      if (guard->Admit(Bearer(late), {.scope = Scope::kRead}, "").ok() == ok) return true;
      absl::SleepFor(absl::Milliseconds(20));
    }
    return false;
  };
  EXPECT_TRUE(becomes(true));
  EXPECT_THAT(RevokeToken(file_, Take(ReadTokenFile(file_))[1].id), IsOk());
  EXPECT_TRUE(becomes(false));
}

TEST_F(GuardTest, ABrokenFileLeavesTheTokensValid) {
  const std::string secret = Make({Scope::kRead});
  const auto guard = Open();
  WriteText(file_, "{");
  absl::SleepFor(absl::Milliseconds(1100));  // until it is looked at again
  EXPECT_THAT(guard->Admit(Bearer(secret), {.scope = Scope::kRead}, ""), IsOk());
}

TEST_F(GuardTest, AFileWithoutTokensIsRefusedAtTheStart) {
  EXPECT_THAT(Guard::Open({.token_file = file_}), HasCode(absl::StatusCode::kNotFound));
  WriteText(file_, R"({"tokens": []})");
  EXPECT_THAT(std::string(Guard::Open({.token_file = file_}).status().message()), HasSubstr("token new"));
}

TEST_F(GuardTest, ALinkReadsTheOneResourceOfItsTenant) {
  Make({Scope::kRead});
  const auto guard = Open();
  const std::string link = guard->SignLink(Tenant("studio"), "jobs/1/outputs/dof", absl::Minutes(5));
  const auto admit = [&](const std::string& text, bool opens, std::string_view resource) {
    return guard->Admit({.authorization = {}, .link = text}, {.scope = Scope::kRead, .link_opens = opens}, resource);
  };
  EXPECT_EQ(Take(admit(link, true, "jobs/1/outputs/dof")).tenant.name(), "studio");
  EXPECT_THAT(admit(link, false, "jobs/1/outputs/dof"), HasReason(absl::StatusCode::kPermissionDenied, "WRONG_SCOPE"));
  EXPECT_THAT(admit(link, true, "jobs/1"), IsOk()) << "what there is to say of its job";
  EXPECT_THAT(admit(link, true, "jobs/2"), HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit(link, true, "jobs"), HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit(link, true, ""), HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit(link, true, "jobs/1/outputs/depth"), HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit("other" + link.substr(6), true, "jobs/1/outputs/dof"), HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit(link.substr(0, link.size() - 1), true, "jobs/1/outputs/dof"),
              HasReason(kUnauthenticated, "BAD_LINK"));
  EXPECT_THAT(admit("a.b.c.d", true, "jobs/1/outputs/dof"), HasReason(kUnauthenticated, "BAD_LINK"));
  // Another guard has another key.
  EXPECT_THAT(Open()->Admit({.authorization = {}, .link = link}, {.scope = Scope::kRead, .link_opens = true},
                            "jobs/1/outputs/dof"),
              HasReason(kUnauthenticated, "BAD_LINK"));
}

TEST_F(GuardTest, ALinkExpires) {
  Make({Scope::kRead});
  const auto guard = Open();
  const std::string link = guard->SignLink(Tenant("studio"), "jobs/1", -absl::Seconds(2));
  EXPECT_THAT(guard->Admit({.authorization = {}, .link = link}, {.scope = Scope::kRead, .link_opens = true}, "jobs/1"),
              HasReason(kUnauthenticated, "BAD_LINK"));
}

// 5 seconds' worth may come at once: of 1000 calls, made faster than that, at least some are refused, and none of the
// other tenant's.
TEST_F(GuardTest, ATenantThatCallsTooOftenIsSlowedAlone) {
  const std::string busy = Make({Scope::kRead}, "busy"), calm = Make({Scope::kRead}, "calm");
  const auto guard = Open(/*calls_per_second=*/2);
  int refused = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto caller = guard->Admit(Bearer(busy), {.scope = Scope::kRead}, "");
    if (caller.ok()) continue;
    EXPECT_THAT(caller, HasReason(absl::StatusCode::kResourceExhausted, "LIMIT_EXCEEDED"));
    ++refused;
  }
  EXPECT_GT(refused, 0);
  EXPECT_LE(refused, 990) << "10 may come at once";
  EXPECT_THAT(guard->Admit(Bearer(calm), {.scope = Scope::kRead}, ""), IsOk());
}

}  // namespace
}  // namespace depthtween::server
