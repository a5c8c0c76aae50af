// Answers to downloads. The truth is RFC 9110, sections 13.2.2 (the order of conditions), 14.2 (Range) and 15.
#include "server/http/download_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace depthtween::server {
namespace {

using testing::Contains;
using testing::Pair;

const Representation kPicture = {.content_type = "image/png",
                                 .etag = "\"v1\"",
                                 .cache_control = "private",
                                 .disposition = "inline; filename=\"a.png\"",
                                 .size_bytes = 10};

DownloadPlan Plan(HttpHeaders headers, const std::string& method = "GET", const Representation& what = kPicture) {
  HttpRequest request;
  request.method = method;
  request.headers = std::move(headers);
  return PlanDownload(request, what);
}

TEST(DownloadPlan, SendsTheWhole) {
  const DownloadPlan plan = Plan({});
  EXPECT_EQ(plan.status, 200);
  EXPECT_EQ(plan.span, (ByteSpan{0, 10}));
  EXPECT_EQ(plan.content_length, 10);
  EXPECT_TRUE(plan.sends_body);
  EXPECT_THAT(plan.headers, Contains(Pair("ETag", "\"v1\"")));
  EXPECT_THAT(plan.headers, Contains(Pair("Accept-Ranges", "bytes")));
  EXPECT_THAT(plan.headers, Contains(Pair("Content-Type", "image/png")));
  EXPECT_THAT(plan.headers, Contains(Pair("Cache-Control", "private")));
}

TEST(DownloadPlan, SendsAPart) {
  const DownloadPlan plan = Plan({{"Range", "bytes=4-"}, {"If-Range", "\"v1\""}});
  EXPECT_EQ(plan.status, 206);
  EXPECT_EQ(plan.span, (ByteSpan{4, 6}));
  EXPECT_EQ(plan.content_length, 6);
  EXPECT_THAT(plan.headers, Contains(Pair("Content-Range", "bytes 4-9/10")));
}

TEST(DownloadPlan, SendsTheWholeWhereThePartIsOfSomethingElse) {
  EXPECT_EQ(Plan({{"Range", "bytes=4-"}, {"If-Range", "\"v0\""}}).status, 200);
  EXPECT_EQ(Plan({{"Range", "bytes=0-1,4-5"}}).status, 200);
  EXPECT_EQ(Plan({{"Range", "nonsense"}}).span, (ByteSpan{0, 10}));
}

TEST(DownloadPlan, SaysWhatCannotBeHad) {
  const DownloadPlan plan = Plan({{"Range", "bytes=10-"}});
  EXPECT_EQ(plan.status, 416);
  EXPECT_FALSE(plan.sends_body);
  EXPECT_THAT(plan.headers, Contains(Pair("Content-Range", "bytes */10")));
}

TEST(DownloadPlan, ConditionsComeBeforeRange) {
  const DownloadPlan same = Plan({{"If-None-Match", "\"v1\""}, {"Range", "bytes=10-"}});
  EXPECT_EQ(same.status, 304);
  EXPECT_FALSE(same.sends_body);
  EXPECT_THAT(same.headers, Contains(Pair("ETag", "\"v1\"")));
  EXPECT_EQ(Plan({{"If-Match", "\"v0\""}, {"If-None-Match", "\"v1\""}}).status, 412);
  EXPECT_EQ(Plan({{"If-Match", "\"v1\""}, {"Range", "bytes=0-0"}}).status, 206);
}

TEST(DownloadPlan, HeadHasTheHeadersOfTheWhole) {
  const DownloadPlan plan = Plan({{"Range", "bytes=4-"}}, "HEAD");
  EXPECT_EQ(plan.status, 200);
  EXPECT_EQ(plan.content_length, 10);
  EXPECT_FALSE(plan.sends_body);
}

TEST(DownloadPlan, WithoutASizeThereIsNoPart) {
  Representation stream = kPicture;
  stream.size_bytes = std::nullopt;
  const DownloadPlan plan = Plan({{"Range", "bytes=4-"}}, "GET", stream);
  EXPECT_EQ(plan.status, 200);
  EXPECT_EQ(plan.content_length, std::nullopt);
  EXPECT_TRUE(plan.sends_body);
}

TEST(DownloadPlan, KnowsWhenASizeIsNeeded) {
  HttpRequest request;
  request.method = "GET";
  EXPECT_FALSE(WantsRange(request, "\"v1\""));
  request.headers = {{"range", "bytes=1-"}};
  EXPECT_TRUE(WantsRange(request, "\"v1\""));
  request.headers.emplace_back("if-range", "\"v0\"");
  EXPECT_FALSE(WantsRange(request, "\"v1\""));
  request.headers = {{"range", "bytes=1-"}, {"if-none-match", "*"}};
  EXPECT_FALSE(WantsRange(request, "\"v1\""));
  request = {.method = "HEAD"};
  request.headers = {{"range", "bytes=1-"}};
  EXPECT_FALSE(WantsRange(request, "\"v1\""));
}

TEST(Names, MakeTypesAndDispositions) {
  EXPECT_EQ(ContentTypeOf("a/b.png"), "image/png");
  EXPECT_EQ(ContentTypeOf("report.json"), "application/json");
  EXPECT_EQ(ContentTypeOf("dof.mp4"), "video/mp4");
  EXPECT_EQ(ContentTypeOf("1.npz"), "application/octet-stream");
  EXPECT_EQ(ContentTypeOf("none"), "application/octet-stream");
  EXPECT_EQ(Disposition("attachment", "kitti/flow \"x\".zip"), "attachment; filename=\"kitti_flow__x_.zip\"");
}

}  // namespace
}  // namespace depthtween::server
