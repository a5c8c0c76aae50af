// The routes of files in the router. The truth is the table of file_route.h.
#include "server/http/file_service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/http/http_fixture.h"

namespace depthtween::server {
namespace {

using testing::ElementsAre;

class FileServiceTest : public HttpHandlerTest {
 protected:
  void SetUp() override { AddFileRoutes(router_, rpc_channel()); }
  std::vector<std::string> Methods(const std::string& path) { return router_.Methods(absl::StrSplit(path, '/')); }
  std::unique_ptr<FakeExchange> Answer(const std::string& method, const std::string& path) {
    auto exchange = std::make_unique<FakeExchange>(context, Request(method, path));
    const auto found = router_.Find(method, exchange->request().segments);
    EXPECT_TRUE(found) << method << " " << path;
    if (found) RunToEnd(context, (*found->handler)(*exchange));
    return exchange;
  }
  Router router_;
};

TEST_F(FileServiceTest, EveryRouteIsThere) {
  EXPECT_THAT(Methods("v1/jobs/j/outputs/depth/frames/1.png"), ElementsAre("GET", "HEAD", "OPTIONS"));
  EXPECT_THAT(Methods("v1/jobs/j/outputs/depth.zip"), ElementsAre("GET", "HEAD", "OPTIONS"));
  EXPECT_THAT(Methods("v1/jobs/j/outputs/report:download"), ElementsAre("GET", "HEAD", "OPTIONS"));
  EXPECT_THAT(Methods("v1/sequences/s/uploads:tus"), ElementsAre("OPTIONS", "POST"));
  EXPECT_THAT(Methods("v1/sequences/s/uploads/u:tus"), ElementsAre("DELETE", "HEAD", "OPTIONS", "PATCH", "POST"));
  EXPECT_THAT(Methods("v1/sequences/s/uploads/u"), ElementsAre("OPTIONS", "PUT"));
  EXPECT_THAT(Methods("v1/sequences/s/uploads"), ElementsAre());
}

TEST_F(FileServiceTest, RoutesLeadToTheirHandlers) {
  EXPECT_EQ(Answer("GET", "v1/jobs/none/outputs/depth/frames/1.png")->status, 404);
  EXPECT_EQ(Answer("HEAD", "v1/jobs/none/outputs/depth.zip")->status, 404);
  EXPECT_EQ(Answer("GET", "v1/jobs/none/outputs/report:download")->status, 404);
  EXPECT_EQ(Answer("POST", "v1/sequences/none/uploads:tus")->status, 412);
  EXPECT_EQ(Answer("OPTIONS", "v1/sequences/none/uploads/u:tus")->status, 204);
  EXPECT_EQ(Answer("HEAD", "v1/sequences/none/uploads/u:tus")->status, 412) << "a HEAD without a GET";
  EXPECT_EQ(Answer("PUT", "v1/sequences/none/uploads/u")->status, 404);
  // What the router's stars take and no route is.
  const auto nothing = Answer("GET", "v1/jobs/none/outputs/depth");
  EXPECT_EQ(nothing->status, 404);
  EXPECT_THAT(nothing->body, testing::HasSubstr("OUTPUT.zip"));
}

}  // namespace
}  // namespace depthtween::server
