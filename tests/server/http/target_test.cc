// Request targets against RFC 3986 and RFC 9112, and against the tricks by which paths are smuggled past a check.
#include "server/http/target.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace depthtween::server {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

TEST(ParseTarget, TakesPathAndQueryApart) {
  const auto target = ParseTarget("/v1/jobs/a%20b:cancel?page_size=5&filter=state+%3D%20READY&x&y=%2F%25&z=a=b");
  ASSERT_TRUE(target.ok()) << target.status();
  EXPECT_EQ(target->path, "/v1/jobs/a b:cancel");
  EXPECT_THAT(target->segments, ElementsAre("v1", "jobs", "a b:cancel"));
  EXPECT_THAT(target->query, ElementsAre(Pair("page_size", "5"), Pair("filter", "state = READY"), Pair("x", ""),
                                         Pair("y", "/%"), Pair("z", "a=b")));
}

TEST(ParseTarget, OtherForms) {
  EXPECT_THAT(ParseTarget("/")->segments, IsEmpty());
  EXPECT_EQ(ParseTarget("*")->path, "*");
  EXPECT_THAT(ParseTarget("http://host:80/v1/jobs?a=b")->segments, ElementsAre("v1", "jobs"));
  EXPECT_EQ(ParseTarget("https://host")->path, "/");
  EXPECT_THAT(ParseTarget("/caf%C3%A9")->segments, ElementsAre("caf\xC3\xA9"));
}

// Each is read differently by some proxy, file system or second decoder.
TEST(ParseTarget, RefusesWhatIsReadDifferently) {
  for (const char* target :
       {"",        "v1",          "/..",          "/../etc/passwd", "/v1/../admin",  "/v1/./jobs", "/v1//jobs",
        "//",      "/v1/jobs/",   "/%2e%2e/x",    "/v1/%2E%2E",     "/a%2fb",        "/a%2Fb",     "/a%5cb",
        "/a\\b",   "/a%00",       "/a%0d%0aX: y", "/a%252e",        "/%252e%252e/x", "/a%",        "/a%4",
        "/a%zz",   "/a%c0%af",    "/a%ff",        "/a#b",           "/a\x7f",        "/a?b=%00",   "/a?b=\n",
        "/a?b=%f", "ftp://host/a"}) {
    EXPECT_EQ(ParseTarget(target).status().code(), absl::StatusCode::kInvalidArgument) << target;
  }
}

TEST(ParseTarget, BoundsTheQuery) {
  std::string target = "/v1?";
  for (int i = 0; i < 100; ++i) target += "a=b&";
  EXPECT_TRUE(ParseTarget(target).ok());
  EXPECT_FALSE(ParseTarget(target + "a=b").ok());
}

}  // namespace
}  // namespace depthtween::server
