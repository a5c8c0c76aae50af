// Results as files, from a server in this process whose jobs write known bytes ("depth 3" is frame 3 of the depth).
// Parts are checked against the whole, and archives by Python's zipfile.
#include "server/http/downloads.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <sstream>

#include "tests/server/http/http_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class DownloadsTest : public HttpHandlerTest {
 protected:
  // Answers GET (or HEAD) of that path.
  std::unique_ptr<FakeExchange> Get(const std::string& path, HttpHeaders headers = {},
                                    const std::string& method = "GET", int gone_after_writes = 0) {
    if (downloads_ == nullptr) downloads_ = std::make_unique<Downloads>(rpc_channel());
    auto exchange = std::make_unique<FakeExchange>(context, Request(method, path, std::move(headers)));
    exchange->gone_after_writes = gone_after_writes;
    const std::optional<FileRoute> route = MatchFileRoute(exchange->request().segments);
    EXPECT_TRUE(route) << path;
    RunToEnd(context, route->kind == FileRoute::Kind::kFrame     ? downloads_->SendFrame(*exchange, *route)
                      : route->kind == FileRoute::Kind::kArchive ? downloads_->SendArchive(*exchange, *route)
                                                                 : downloads_->SendFile(*exchange, *route));
    return exchange;
  }
  // The path of a job's output.
  static std::string Path(const v1::Job& job, const std::string& rest) {
    return "v1/" + job.name() + "/outputs/" + rest;
  }
  // One that SUCCEEDED, with six frames.
  v1::Job FinishedJob() { return WaitUntilEnded(CreateJob(ReadySequence()).name()); }
  std::string StoredFile(const v1::Job& job, const std::string& file) {
    return directory().JobFolder(IdOf(job.name())) + "/out/" + file;
  }

 private:
  std::unique_ptr<Downloads> downloads_;
};

// What Python finds in an archive: its names, the content of each, and whether a member is damaged.
std::string ListZip(const std::string& bytes) {
  const TemporaryFolder folder;
  std::ofstream(folder / "a.zip", std::ios::binary) << bytes;
  FILE* pipe = popen(("python3 -c 'import sys, zipfile; z = zipfile.ZipFile(sys.argv[1]); print(z.testzip(), {n: "
                      "z.read(n).decode() for n in z.namelist()})' " +
                      (folder / "a.zip") + " 2>&1")
                         .c_str(),
                     "r");
  std::string text;
  char buffer[4096];
  for (size_t count = 0; (count = fread(buffer, 1, sizeof(buffer), pipe)) > 0;) text.append(buffer, count);
  pclose(pipe);
  return text;
}

TEST_F(DownloadsTest, SendAFrameWholeAndInParts) {
  const v1::Job job = FinishedJob();
  const auto whole = Get(Path(job, "depth/frames/3.png"));
  EXPECT_EQ(whole->status, 200);
  EXPECT_EQ(whole->body, "depth 3");
  EXPECT_EQ(whole->content_length, 7U);
  EXPECT_TRUE(whole->ended);
  EXPECT_EQ(whole->HeaderOf("content-type"), "image/png");
  EXPECT_EQ(whole->HeaderOf("cache-control"), "private, max-age=31536000, immutable");
  EXPECT_EQ(whole->HeaderOf("content-disposition"), "inline; filename=\"000003.png\"");
  const std::string etag = whole->HeaderOf("etag");
  EXPECT_THAT(etag, StartsWith("\""));

  const auto part = Get(Path(job, "depth/frames/3.png"), {{"Range", "bytes=2-4"}, {"If-Range", etag}});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, "pth");
  EXPECT_EQ(part->HeaderOf("content-range"), "bytes 2-4/7");
  EXPECT_EQ(Get(Path(job, "depth/frames/3.png"), {{"Range", "bytes=7-"}})->status, 416);
  const auto same = Get(Path(job, "depth/frames/3.png"), {{"If-None-Match", etag}});
  EXPECT_EQ(same->status, 304);
  EXPECT_EQ(same->body, "");
  // Another frame is another thing.
  EXPECT_EQ(Get(Path(job, "depth/frames/4.png"), {{"If-None-Match", etag}})->body, "depth 4");

  const auto head = Get(Path(job, "depth/frames/3.png"), {}, "HEAD");
  EXPECT_EQ(head->status, 200);
  EXPECT_EQ(head->content_length, 7U);
  EXPECT_EQ(head->body, "");
  EXPECT_EQ(head->HeaderOf("etag"), etag);
}

TEST_F(DownloadsTest, SayWhichFrameIsNotThere) {
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  const v1::Job job = CreateJob(sequence);
  while (GetJob(job.name()).progress().frames_done() < 2) {
  }
  const auto early = Get(Path(job, "depth/frames/1.png"));
  EXPECT_EQ(early->body, "depth 1");
  EXPECT_EQ(early->HeaderOf("cache-control"), "private, no-cache") << "the job may still fail and be deleted";
  const auto missing = Get(Path(job, "depth/frames/4.png"));
  EXPECT_EQ(missing->status, 404);
  EXPECT_THAT(missing->body, HasSubstr("FRAME_NOT_READY"));
  EXPECT_THAT(missing->HeaderOf("cache-control"), testing::Not(HasSubstr("immutable")));
  const auto archive = Get(Path(job, "depth.zip"));
  EXPECT_EQ(archive->status, 400);
  EXPECT_THAT(archive->body, HasSubstr("WRONG_STATE"));
  EXPECT_EQ(Get(Path(job, "report:download"))->status, 400);
  Go(sequence);
  WaitUntilEnded(job.name());
  for (const char* frame : {"depth/frames/6.png", "depth/frames/1000.png"}) {
    const auto beyond = Get(Path(job, frame));
    EXPECT_EQ(beyond->status, 404) << frame;
    EXPECT_THAT(beyond->body, HasSubstr("NO_SUCH_FRAME")) << frame;
  }
  EXPECT_EQ(Get(Path(job, "depth/frames/1.npz"))->status, 404) << "depth is not offered so";
  EXPECT_EQ(Get(Path(job, "nothing/frames/1.png"))->status, 404);
  EXPECT_EQ(Get("v1/jobs/nobody/outputs/depth/frames/1.png")->status, 404);
  EXPECT_EQ(Get(Path(job, "report/frames/1.png"))->status, 400);
}

TEST_F(DownloadsTest, SayWhatIsLost) {
  const v1::Job job = FinishedJob();
  std::filesystem::remove(StoredFile(job, "depth/000003.png"));
  const auto frame = Get(Path(job, "depth/frames/3.png"));
  EXPECT_EQ(frame->status, 500);
  EXPECT_THAT(frame->body, HasSubstr("FILE_LOST"));
  // The archive had begun: it breaks off, and has no end that a reader could take for one.
  const auto archive = Get(Path(job, "depth.zip"));
  EXPECT_EQ(archive->status, 200);
  EXPECT_FALSE(archive->ended);
  EXPECT_THAT(archive->body, HasSubstr("depth 2"));
  EXPECT_THAT(ListZip(archive->body), HasSubstr("not a zip file"));
  // A part of it cannot be had at all, and that can be said.
  const auto part = Get(Path(job, "depth.zip"), {{"Range", "bytes=0-9"}});
  EXPECT_EQ(part->status, 500);
  EXPECT_THAT(part->body, HasSubstr("FILE_LOST"));
  std::filesystem::remove(StoredFile(job, "report.json"));
  const auto file = Get(Path(job, "report:download"));
  EXPECT_EQ(file->status, 500);
  EXPECT_THAT(file->body, HasSubstr("FILE_LOST"));
}

TEST_F(DownloadsTest, SendAFileWholeAndInParts) {
  const v1::Job job = FinishedJob();
  const auto whole = Get(Path(job, "camera:download"));
  EXPECT_EQ(whole->status, 200);
  std::stringstream stored;
  stored << std::ifstream(StoredFile(job, "camera.json")).rdbuf();
  EXPECT_EQ(whole->body, stored.str());
  EXPECT_EQ(whole->content_length, stored.str().size());
  EXPECT_TRUE(whole->ended);
  EXPECT_EQ(whole->HeaderOf("content-type"), "application/json");
  EXPECT_EQ(whole->HeaderOf("content-disposition"), "attachment; filename=\"camera.json\"");
  const std::string etag = whole->HeaderOf("etag");
  const auto tail = Get(Path(job, "camera:download"), {{"Range", "bytes=1-"}});
  EXPECT_EQ(tail->status, 206);
  EXPECT_EQ(tail->body, whole->body.substr(1));
  EXPECT_EQ(Get(Path(job, "camera:download"), {{"Range", "bytes=99999-"}})->status, 416);
  EXPECT_EQ(Get(Path(job, "camera:download"), {{"If-None-Match", etag}})->status, 304);
  EXPECT_EQ(Get(Path(job, "camera:download"), {}, "HEAD")->content_length, whole->body.size());
  EXPECT_EQ(Get(Path(job, "depth:download"))->status, 400) << "made of frames";
  EXPECT_EQ(Get(Path(job, "nothing:download"))->status, 404);
}

TEST_F(DownloadsTest, SendAllFramesAsAnArchive) {
  const v1::Job job = FinishedJob();
  const auto whole = Get(Path(job, "depth.zip"));
  EXPECT_EQ(whole->status, 200);
  EXPECT_TRUE(whole->ended);
  EXPECT_EQ(whole->content_length, std::nullopt) << "not known before it is made";
  EXPECT_EQ(whole->HeaderOf("content-type"), "application/zip");
  EXPECT_EQ(ListZip(whole->body),
            "None {'depth/000000.png': 'depth 0', 'depth/000001.png': 'depth 1', 'depth/000002.png': 'depth 2', "
            "'depth/000003.png': 'depth 3', 'depth/000004.png': 'depth 4', 'depth/000005.png': 'depth 5'}\n");
  EXPECT_EQ(Get(Path(job, "report.zip"))->status, 400) << "one file";
  EXPECT_EQ(Get(Path(job, "nothing.zip"))->status, 404);
}

TEST_F(DownloadsTest, SendAnyPartOfAnArchive) {
  const v1::Job job = FinishedJob();
  // Before the whole was read, so that the layout is measured; then from memory.
  const auto first = Get(Path(job, "depth.zip"), {{"Range", "bytes=0-99"}});
  EXPECT_EQ(first->status, 206);
  EXPECT_EQ(first->body.size(), 100U);
  const auto whole = Get(Path(job, "depth.zip"));
  const std::string& all = whole->body;
  EXPECT_EQ(whole->content_length, all.size()) << "known by now";
  EXPECT_EQ(first->body, all.substr(0, 100));
  EXPECT_EQ(first->HeaderOf("etag"), whole->HeaderOf("etag"));
  for (size_t at = 0; at < all.size(); at += 37) {
    const auto part = Get(Path(job, "depth.zip"),
                          {{"Range", absl::StrCat("bytes=", at, "-", at + 49)}, {"If-Range", whole->HeaderOf("etag")}});
    EXPECT_EQ(part->status, 206);
    EXPECT_TRUE(part->ended);
    EXPECT_EQ(part->body, all.substr(at, 50)) << at;
  }
  const auto tail = Get(Path(job, "depth.zip"), {{"Range", "bytes=-22"}});
  EXPECT_EQ(tail->body, all.substr(all.size() - 22));
  EXPECT_EQ(Get(Path(job, "depth.zip"), {{"Range", absl::StrCat("bytes=", all.size(), "-")}})->status, 416);
  EXPECT_EQ(Get(Path(job, "depth.zip"), {{"If-None-Match", whole->HeaderOf("etag")}})->status, 304);
  EXPECT_EQ(Get(Path(job, "depth.zip"), {}, "HEAD")->content_length, all.size());
  EXPECT_NE(Get(Path(job, "uncertainty.zip"))->HeaderOf("etag"), whole->HeaderOf("etag"));
}

TEST_F(DownloadsTest, EndWithTheirClient) {
  const v1::Job job = FinishedJob();
  const auto archive = Get(Path(job, "depth.zip"), {}, "GET", /*gone_after_writes=*/4);
  EXPECT_FALSE(archive->ended);
  EXPECT_EQ(archive->writes, 4);
  const auto frame = Get(Path(job, "depth/frames/0.png"), {}, "GET", 1);
  EXPECT_TRUE(frame->gone());
  // The server has forgotten their calls: it stops at once.
  EXPECT_EQ(Get(Path(job, "depth/frames/0.png"))->body, "depth 0");
}

}  // namespace
}  // namespace depthtween::server
