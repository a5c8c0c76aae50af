// The probes on a server that serves, and on one that has stopped: alive is not ready.
#include "server/http/probes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/http/http_server.h"
#include "tests/server/http/raw_client.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

class ProbesTest : public RpcTest {};

TEST_F(ProbesTest, AliveIsNotReady) {
  const auto http = HttpServer::Start({.listen = "127.0.0.1:0", .threads = 1}, channel());
  ASSERT_TRUE(http.ok()) << http.status();
  const int port = (*http)->port();
  EXPECT_EQ(GetOnce(port, "/readyz").status, 200);
  EXPECT_EQ(GetOnce(port, "/readyz").body, "{\"status\":\"SERVING\"}\n");
  const RawAnswer metrics = GetOnce(port, "/metrics");
  EXPECT_EQ(metrics.status, 200);
  EXPECT_THAT(metrics.body, testing::HasSubstr("depthtween_http_requests_total{method=\"GET\",status=\"200\"}"));
  server().Drain(absl::Seconds(60));
  EXPECT_EQ(GetOnce(port, "/readyz").status, 503);
  EXPECT_EQ(GetOnce(port, "/healthz").status, 200);
  EXPECT_EQ(GetOnce(port, "/v1/jobs").status, 503);
}

}  // namespace
}  // namespace depthtween::server
