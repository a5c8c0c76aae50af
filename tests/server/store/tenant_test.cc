// Names of tenants, against the rule in server/store/tenant.h, by examples on either side of it.
#include "server/store/tenant.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {

TEST(Tenant, NamesFollowTheRule) {
  for (const char* good : {"default", "a", "7", "studio-7", "a-"}) EXPECT_THAT(CheckTenantName(good), IsOk()) << good;
  EXPECT_THAT(CheckTenantName(std::string(63, 'x')), IsOk());
  for (const char* bad : {"", "-a", "A", "a b", "a/b", "ü", "a.b"}) {
    EXPECT_THAT(CheckTenantName(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
  EXPECT_THAT(CheckTenantName(std::string(64, 'x')), HasCode(absl::StatusCode::kInvalidArgument));
}

TEST(Tenant, EveryoneIsNobodysName) {
  EXPECT_EQ(Tenant::Everyone().name(), "");
  EXPECT_THAT(CheckTenantName(Tenant::Everyone().name()), HasCode(absl::StatusCode::kInvalidArgument));
}

}  // namespace depthtween::server
