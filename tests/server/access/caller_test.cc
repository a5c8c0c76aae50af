// Scopes as words, there and back.
#include "server/access/caller.h"

#include <gtest/gtest.h>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

TEST(Caller, ScopesAreWordsJoinedByCommas) {
  EXPECT_EQ(Take(ParseScopes("read, admin")), (std::set<Scope>{Scope::kRead, Scope::kAdmin}));
  EXPECT_EQ(JoinScopes({Scope::kAdmin, Scope::kWrite, Scope::kRead}), "read,write,admin");
  for (const char* bad : {"", "read,", "Read", "all"}) {
    EXPECT_THAT(ParseScopes(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

}  // namespace
}  // namespace depthtween::server
