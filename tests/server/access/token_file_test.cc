// Token files are made, read and changed; what they hold is compared with what was asked for, and looked at as bytes.
#include "server/access/token_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <thread>

#include "absl/time/clock.h"
#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

TEST(TokenFile, HoldsHashesAndIsItsOwnersAlone) {
  const TemporaryFolder folder;
  const std::string file = folder / "tokens.json";
  const std::string secret =
      Take(AddToken(file, {.tenant = "studio", .scopes = {Scope::kRead, Scope::kWrite}, .lifetime = absl::Hours(1)}));
  EXPECT_THAT(ReadText(file), Not(HasSubstr(secret)));
  struct stat facts {};
  ASSERT_EQ(stat(file.c_str(), &facts), 0);
  EXPECT_EQ(facts.st_mode & 0777, 0600U);

  const std::vector<Token> tokens = Take(ReadTokenFile(file));
  ASSERT_THAT(tokens, SizeIs(1));
  EXPECT_EQ(tokens[0].sha256, HashOfSecret(secret));
  EXPECT_EQ(tokens[0].tenant, "studio");
  EXPECT_EQ(tokens[0].scopes, (std::set<Scope>{Scope::kRead, Scope::kWrite}));
  EXPECT_EQ(tokens[0].expire_time - tokens[0].create_time, absl::Hours(1));
}

TEST(TokenFile, TokensAreAddedAndRevokedOneByOne) {
  const TemporaryFolder folder;
  const std::string file = folder / "tokens.json";
  const std::string first = Take(AddToken(file, {.scopes = {Scope::kRead}}));
  const std::string second = Take(AddToken(file, {.scopes = {Scope::kAdmin}}));
  EXPECT_NE(first, second);
  std::vector<Token> tokens = Take(ReadTokenFile(file));
  ASSERT_THAT(tokens, SizeIs(2));
  EXPECT_EQ(tokens[1].expire_time, absl::InfiniteFuture());
  EXPECT_THAT(RevokeToken(file, tokens[0].id), IsOk());
  EXPECT_THAT(RevokeToken(file, tokens[0].id), HasCode(absl::StatusCode::kNotFound));
  tokens = Take(ReadTokenFile(file));
  ASSERT_THAT(tokens, SizeIs(1));
  EXPECT_EQ(tokens[0].sha256, HashOfSecret(second));
}

// Two operators at once: neither's token is lost.
TEST(TokenFile, WritersWaitForOneAnother) {
  const TemporaryFolder folder;
  const std::string file = folder / "tokens.json";
  constexpr int kWriters = 8;
  {
    std::vector<std::jthread> writers;
    for (int i = 0; i < kWriters; ++i) {
      writers.emplace_back([&] { EXPECT_THAT(AddToken(file, {.scopes = {Scope::kRead}}), IsOk()); });
    }
  }
  EXPECT_THAT(Take(ReadTokenFile(file)), SizeIs(kWriters));
}

TEST(TokenFile, RefusesWhatCannotBeMeant) {
  const TemporaryFolder folder;
  const std::string file = folder / "tokens.json";
  EXPECT_THAT(ReadTokenFile(file), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(RevokeToken(file, "x"), HasCode(absl::StatusCode::kNotFound));
  EXPECT_THAT(AddToken(file, {.scopes = {}}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(AddToken(file, {.tenant = "A B", .scopes = {Scope::kRead}}), HasCode(absl::StatusCode::kInvalidArgument));
  EXPECT_FALSE(std::filesystem::exists(file)) << "nothing was made";

  Take(AddToken(file, {.scopes = {Scope::kRead}}));
  ASSERT_EQ(chmod(file.c_str(), 0620), 0);
  EXPECT_THAT(std::string(ReadTokenFile(file).status().message()), HasSubstr("chmod 600"));
}

TEST(TokenFile, DamagedTextIsNamed) {
  for (const char* bad :
       {"", "{}", "[]", R"({"tokens": [{"id": "a"}]})", R"({"tokens": [{"id": 7}]})",
        R"({"tokens": [{"id": "a", "sha256": "00", "tenant": "t", "scopes": "read", "create_time": ""}]})"}) {
    EXPECT_THAT(ParseTokens(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
  EXPECT_THAT(Take(ParseTokens(R"({"tokens": []})")), SizeIs(0));
}

TEST(TokenFile, LifetimesHaveAUnit) {
  EXPECT_EQ(Take(ParseLifetime("30d")), absl::Hours(720));
  EXPECT_EQ(Take(ParseLifetime("12h")), absl::Hours(12));
  EXPECT_EQ(Take(ParseLifetime("45m")), absl::Minutes(45));
  for (const char* bad : {"", "d", "30", "-1d", "+1d", "0h", "1.5d", "9999999999d", "1 d"}) {
    EXPECT_THAT(ParseLifetime(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

}  // namespace
}  // namespace depthtween::server
