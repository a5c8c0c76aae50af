// Uploads over HTTP, into a server in this process. The truth is what the server has then: its own answer to GetUpload,
// and the files in its folder; statuses and headers are those of the tus protocol and of RFC 9110.
#include "server/http/uploads.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "absl/strings/escaping.h"
#include "server/http/tus.h"
#include "tests/server/http/http_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

std::string InBase64(const std::string& text) { return absl::Base64Escape(text); }

// A client whose connection breaks after so many bytes of the body.
class BreakingExchange : public FakeExchange {
 public:
  BreakingExchange(boost::asio::io_context& context, HttpRequest request, std::string body, size_t breaks_after)
      : FakeExchange(context, std::move(request), std::move(body), 700), left_(breaks_after) {}

  boost::asio::awaitable<absl::StatusOr<size_t>> ReadSome(char* data, size_t size) override {
    if (left_ == 0) co_return absl::InvalidArgumentError("the body is malformed");
    const absl::StatusOr<size_t> count = co_await FakeExchange::ReadSome(data, std::min(size, left_));
    if (count.ok()) left_ -= *count;
    co_return count;
  }

 private:
  size_t left_;
};

class UploadsTest : public HttpHandlerTest {
 protected:
  std::unique_ptr<FakeExchange> Send(const std::string& method, const std::string& path, HttpHeaders headers,
                                     const std::string& body = "", bool in_chunks = false) {
    HttpRequest request = Request(method, path, std::move(headers));
    if (in_chunks) {
      request.content_length.reset();
    } else {
      request.content_length = body.size();
    }
    auto exchange = std::make_unique<FakeExchange>(context, std::move(request), body, 100'000);
    Handle(*exchange);
    return exchange;
  }
  void Handle(Exchange& exchange) {
    if (uploads_ == nullptr) uploads_ = std::make_unique<Uploads>(rpc_channel());
    const std::optional<FileRoute> route = MatchFileRoute(exchange.request().segments);
    ASSERT_TRUE(route);
    RunToEnd(context, route->kind == FileRoute::Kind::kUpload        ? uploads_->Put(exchange, *route)
                      : route->kind == FileRoute::Kind::kTusCreation ? uploads_->CreateTus(exchange, *route)
                                                                     : uploads_->HandleTus(exchange, *route));
  }

  // With what every request of tus has.
  std::unique_ptr<FakeExchange> Tus(const std::string& method, const std::string& path, HttpHeaders headers,
                                    const std::string& body = "", bool in_chunks = false) {
    headers.emplace_back("Tus-Resumable", "1.0.0");
    auto exchange = Send(method, path, std::move(headers), body, in_chunks);
    EXPECT_EQ(exchange->HeaderOf("tus-resumable"), "1.0.0");
    return exchange;
  }
  std::unique_ptr<FakeExchange> Patch(const std::string& path, size_t offset, const std::string& body,
                                      HttpHeaders headers = {}, bool in_chunks = false) {
    headers.emplace_back("Content-Type", kTusContentType);
    headers.emplace_back("Upload-Offset", std::to_string(offset));
    return Tus("PATCH", path, std::move(headers), body, in_chunks);
  }
  // The path of a new upload of one file.
  std::string Create(const v1::Sequence& sequence, const std::string& file, size_t size, const std::string& more = "") {
    const auto created =
        Tus("POST", "v1/" + sequence.name() + "/uploads:tus",
            {{"Upload-Length", std::to_string(size)}, {"Upload-Metadata", "path " + InBase64(file) + more}});
    EXPECT_EQ(created->status, 201) << created->body;
    return created->HeaderOf("location").substr(1);
  }

  v1::Upload GetUpload(const std::string& name) {
    grpc::ClientContext client;
    v1::GetUploadRequest request;
    request.set_name(name);
    v1::Upload upload;
    EXPECT_THAT(sequences_stub().GetUpload(&client, request, &upload), Succeeds());
    return upload;
  }
  // The upload behind a path of tus.
  v1::Upload UploadAt(const std::string& path) { return GetUpload(path.substr(3, path.size() - 3 - 4)); }
  std::string FileOf(const v1::Sequence& sequence, const std::string& path) {
    std::stringstream bytes;
    bytes << std::ifstream(directory().SequenceFolder(IdOf(sequence.name())) + "/" + path, std::ios::binary).rdbuf();
    return bytes.str();
  }

 private:
  std::unique_ptr<Uploads> uploads_;
};

// ---- PUT ----

TEST_F(UploadsTest, PutSendsAllAtOnce) {
  const v1::Sequence sequence = CreateSequence();
  const std::string bytes = RandomBytes(1'500'000, 1);
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", bytes.substr(0, 7)}, {"b", bytes.substr(7)}});
  const auto put = Send("PUT", "v1/" + upload.name(), {}, bytes);
  EXPECT_EQ(put->status, 200);
  EXPECT_THAT(put->body, HasSubstr("STATE_FINISHED"));
  EXPECT_THAT(put->body, HasSubstr("\"committedSize\":\"1500000\""));
  EXPECT_EQ(FileOf(sequence, "a") + FileOf(sequence, "b"), bytes);
  const auto again = Send("PUT", "v1/" + upload.name(), {}, bytes);
  EXPECT_EQ(again->status, 409);
  EXPECT_EQ(again->HeaderOf("upload-offset"), "1500000");
}

TEST_F(UploadsTest, PutGoesOnWithContentRange) {
  const v1::Sequence sequence = CreateSequence();
  const std::string bytes = "0123456789";
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", bytes}});
  const std::string path = "v1/" + upload.name();
  const auto first = Send("PUT", path, {{"Content-Range", "bytes 0-3/10"}}, "0123");
  EXPECT_EQ(first->status, 200);
  EXPECT_THAT(first->body, HasSubstr("\"committedSize\":\"4\""));
  const auto question = Send("PUT", path, {{"Content-Range", "bytes */10"}});
  EXPECT_EQ(question->status, 200);
  EXPECT_EQ(question->HeaderOf("upload-offset"), "4");

  const auto gap = Send("PUT", path, {{"Content-Range", "bytes 5-9/10"}}, "56789");
  EXPECT_EQ(gap->status, 409);
  EXPECT_EQ(gap->HeaderOf("upload-offset"), "4");
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-9/11"}}, "456789")->status, 400) << "another size";
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-9/10"}}, "4567")->status, 400) << "another length";
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-10/*"}}, "456789x")->status, 413);
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-"}}, "456789")->status, 400);
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes */10"}}, "456789")->status, 400) << "a question with a body";
  EXPECT_EQ(GetUpload(upload.name()).committed_size(), 4);

  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-9/10"}}, "456789")->status, 200);
  EXPECT_EQ(GetUpload(upload.name()).state(), v1::Upload::STATE_FINISHED);
  EXPECT_EQ(FileOf(sequence, "a"), bytes);
  EXPECT_THAT(Send("PUT", path, {{"Content-Range", "bytes */10"}})->body, HasSubstr("STATE_FINISHED"));
}

TEST_F(UploadsTest, PutKeepsWhatCame) {
  const v1::Sequence sequence = CreateSequence();
  const std::string bytes = RandomBytes(2'000'000, 2);
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", bytes}});
  HttpRequest request = Request("PUT", "v1/" + upload.name());
  request.content_length = bytes.size();
  BreakingExchange broken(context, std::move(request), bytes, 1'000'001);
  Handle(broken);
  EXPECT_EQ(broken.status, 400);
  EXPECT_EQ(GetUpload(upload.name()).committed_size(), 1'000'001) << "to the byte";
  const auto rest =
      Send("PUT", "v1/" + upload.name(), {{"Content-Range", "bytes 1000001-1999999/2000000"}}, bytes.substr(1'000'001));
  EXPECT_EQ(rest->status, 200);
  EXPECT_EQ(FileOf(sequence, "a"), bytes);
}

TEST_F(UploadsTest, PutInChunksMustFit) {
  const v1::Sequence sequence = CreateSequence();
  const std::string bytes = "0123456789";
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", bytes}});
  const std::string path = "v1/" + upload.name();
  EXPECT_EQ(Send("PUT", path, {}, bytes + "x", /*in_chunks=*/true)->status, 413);
  EXPECT_NE(GetUpload(upload.name()).state(), v1::Upload::STATE_FINISHED);
  const int64_t offset = GetUpload(upload.name()).committed_size();
  ASSERT_EQ(offset, 0);
  const auto shorter = Send("PUT", path, {}, "0123", true);
  EXPECT_EQ(shorter->status, 400);
  EXPECT_EQ(shorter->HeaderOf("upload-offset"), "4");
  EXPECT_EQ(Send("PUT", path, {{"Content-Range", "bytes 4-9/10"}}, "456789", true)->status, 200);
  EXPECT_EQ(FileOf(sequence, "a"), bytes);
}

TEST_F(UploadsTest, PutOfNothing) {
  const v1::Sequence sequence = CreateSequence();
  const v1::Upload upload = StartUpload(sequence.name(), {{"empty", ""}});
  EXPECT_EQ(Send("PUT", "v1/" + upload.name(), {})->status, 200);
  EXPECT_EQ(GetUpload(upload.name()).state(), v1::Upload::STATE_FINISHED);
  EXPECT_EQ(Send("PUT", "v1/" + sequence.name() + "/uploads/none", {}, "x")->status, 404);
}

// ---- tus ----

TEST_F(UploadsTest, TusTellsWhatItIs) {
  const auto options = Send("OPTIONS", "v1/sequences/s/uploads:tus", {});
  EXPECT_EQ(options->status, 204);
  EXPECT_EQ(options->HeaderOf("tus-version"), "1.0.0");
  EXPECT_EQ(options->HeaderOf("tus-extension"), "creation,creation-with-upload,checksum,expiration,termination");
  EXPECT_THAT(options->HeaderOf("tus-checksum-algorithm"), HasSubstr("sha1"));
  for (const HttpHeaders& headers : {HttpHeaders(), HttpHeaders{{"Tus-Resumable", "0.2.2"}}}) {
    const auto old = Send("HEAD", "v1/sequences/s/uploads/u:tus", headers);
    EXPECT_EQ(old->status, 412);
    EXPECT_EQ(old->HeaderOf("tus-version"), "1.0.0");
  }
}

TEST_F(UploadsTest, TusCreatesAndResumes) {
  const v1::Sequence sequence = CreateSequence();
  const std::string bytes = RandomBytes(700'000, 3);
  const std::string path = Create(sequence, "rgb/1.png", bytes.size());
  EXPECT_THAT(path, testing::MatchesRegex("v1/sequences/.*/uploads/.*:tus"));

  HttpHeaders headers = {{"Tus-Resumable", "1.0.0"}, {"Content-Type", kTusContentType}, {"Upload-Offset", "0"}};
  HttpRequest request = Request("PATCH", path, headers);
  request.content_length = bytes.size();
  BreakingExchange broken(context, std::move(request), bytes, 300'000);
  Handle(broken);
  EXPECT_EQ(broken.status, 400);

  const auto head = Tus("HEAD", path, {});
  EXPECT_EQ(head->status, 200);
  EXPECT_EQ(head->HeaderOf("upload-offset"), "300000");
  EXPECT_EQ(head->HeaderOf("upload-length"), "700000");
  EXPECT_EQ(head->HeaderOf("cache-control"), "no-store");
  const auto wrong = Patch(path, 299'999, bytes.substr(299'999));
  EXPECT_EQ(wrong->status, 409);
  const auto rest = Patch(path, 300'000, bytes.substr(300'000));
  EXPECT_EQ(rest->status, 204);
  EXPECT_EQ(rest->HeaderOf("upload-offset"), "700000");
  EXPECT_EQ(rest->body, "");
  EXPECT_EQ(UploadAt(path).state(), v1::Upload::STATE_FINISHED);
  EXPECT_EQ(FileOf(sequence, "rgb/1.png"), bytes);
  EXPECT_EQ(Tus("HEAD", path, {})->HeaderOf("upload-offset"), "700000");
  EXPECT_EQ(Patch(path, 700'000, "more")->status, 413);
}

TEST_F(UploadsTest, TusRefusesWhatTheProtocolDoes) {
  const v1::Sequence sequence = CreateSequence();
  const std::string uploads = "v1/" + sequence.name() + "/uploads:tus";
  const std::pair<std::string, std::string> path = {"Upload-Metadata", "path " + InBase64("a")};
  EXPECT_EQ(Tus("POST", uploads, {path})->status, 400) << "no length";
  EXPECT_EQ(Tus("POST", uploads, {path, {"Upload-Length", "-1"}})->status, 400);
  EXPECT_EQ(Tus("POST", uploads, {path, {"Upload-Defer-Length", "1"}})->status, 400);
  EXPECT_EQ(Tus("POST", uploads, {{"Upload-Length", "1"}})->status, 400) << "no path";
  EXPECT_EQ(Tus("POST", uploads, {{"Upload-Length", "1"}, {"Upload-Metadata", "path " + InBase64("../a")}})->status,
            400);
  EXPECT_EQ(Tus("POST", uploads, {path, {"Upload-Length", "99999999999999"}})->status, 413);
  EXPECT_EQ(Tus("POST", "v1/sequences/none/uploads:tus", {path, {"Upload-Length", "1"}})->status, 404);
  const std::string upload = Create(sequence, "a", 4);
  EXPECT_EQ(Tus("PATCH", upload, {{"Upload-Offset", "0"}}, "abcd")->status, 415);
  EXPECT_EQ(Tus("PATCH", upload, {{"Content-Type", kTusContentType}}, "abcd")->status, 400) << "no offset";
  EXPECT_EQ(Patch(upload, 0, "abcde")->status, 413);
  EXPECT_EQ(Tus("POST", upload, {})->status, 405);
  EXPECT_EQ(Tus("HEAD", "v1/" + sequence.name() + "/uploads/none:tus", {})->status, 404);
  EXPECT_EQ(Patch("v1/" + sequence.name() + "/uploads/none:tus", 0, "x")->status, 404);
  EXPECT_EQ(UploadAt(upload).committed_size(), 0);
}

TEST_F(UploadsTest, TusUploadsWithTheCreation) {
  const v1::Sequence sequence = CreateSequence();
  const HttpHeaders headers = {{"Upload-Length", "10"},
                               {"Upload-Metadata", "filename " + InBase64("a") + ",request_id " + InBase64("again")},
                               {"Content-Type", kTusContentType}};
  const std::string uploads = "v1/" + sequence.name() + "/uploads:tus";
  EXPECT_EQ(Tus("POST", uploads, {headers[0], headers[1]}, "0123")->status, 415);
  EXPECT_EQ(Tus("POST", uploads, headers, "0123456789x")->status, 413);
  const auto created = Tus("POST", uploads, headers, "0123");
  EXPECT_EQ(created->status, 201);
  EXPECT_EQ(created->HeaderOf("upload-offset"), "4");
  // The same creation again, as after a lost answer, finds what came.
  const auto again = Tus("POST", uploads, headers, "0123");
  EXPECT_EQ(again->HeaderOf("location"), created->HeaderOf("location"));
  EXPECT_EQ(again->HeaderOf("upload-offset"), "4");
  EXPECT_EQ(Patch(created->HeaderOf("location").substr(1), 4, "456789")->status, 204);
  EXPECT_EQ(FileOf(sequence, "a"), "0123456789");
}

TEST_F(UploadsTest, TusFinishesAnEmptyFileAtOnce) {
  const v1::Sequence sequence = CreateSequence();
  EXPECT_EQ(UploadAt(Create(sequence, "empty", 0)).state(), v1::Upload::STATE_FINISHED);
}

TEST_F(UploadsTest, TusDropsBytesWithoutTheirChecksum) {
  const v1::Sequence sequence = CreateSequence();
  const std::string path = Create(sequence, "a", 3);
  // sha1sum of "abc", RFC 3174.
  const std::string sha1 = InBase64(absl::HexStringToBytes("a9993e364706816aba3e25717850c26c9cd0d89d"));
  const auto wrong = Patch(path, 0, "abd", {{"Upload-Checksum", "sha1 " + sha1}});
  EXPECT_EQ(wrong->status, 460);
  EXPECT_THAT(wrong->body, HasSubstr("CHECKSUM_MISMATCH"));
  EXPECT_EQ(UploadAt(path).committed_size(), 0);
  EXPECT_EQ(Patch(path, 0, "abc", {{"Upload-Checksum", "md5 " + sha1}})->status, 400);
  EXPECT_EQ(Patch(path, 0, "abc", {{"Upload-Checksum", "sha1 " + sha1}})->status, 204);
  EXPECT_EQ(FileOf(sequence, "a"), "abc");
  // A body that must be held is bounded.
  const std::string big = Create(sequence, "b", 20'000'000);
  const std::string too_much(17 << 20, 'x');
  EXPECT_EQ(Patch(big, 0, too_much, {{"Upload-Checksum", "sha1 " + sha1}})->status, 413);
  EXPECT_EQ(UploadAt(big).committed_size(), 0);
}

TEST_F(UploadsTest, TusChecksTheFilesHash) {
  const v1::Sequence sequence = CreateSequence();
  const std::string hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";  // of "abc", RFC 6234
  const std::string path = Create(sequence, "a", 3, ",sha256 " + InBase64(hash));
  EXPECT_EQ(Patch(path, 0, "abd")->status, 460);
  EXPECT_EQ(Tus("HEAD", path, {})->HeaderOf("upload-offset"), "0") << "nothing of the file is kept";
  EXPECT_EQ(Patch(path, 0, "abc")->status, 204);
  EXPECT_EQ(UploadAt(path).state(), v1::Upload::STATE_FINISHED);
}

TEST_F(UploadsTest, TusGoesOnWithAnyUpload) {
  const v1::Sequence sequence = CreateSequence();
  const v1::Upload upload = StartUpload(sequence.name(), {{"a", "0123"}, {"b", "456789"}});
  v1::Upload written;
  EXPECT_THAT(WriteUpload(upload.name(), "0123456789", 0, 10, /*finish=*/false, &written), Succeeds());
  // All bytes are there, but no end: as after a kill between the two.
  const std::string path = "v1/" + upload.name() + ":tus";
  EXPECT_EQ(UploadAt(path).state(), v1::Upload::STATE_RECEIVING);
  EXPECT_EQ(Tus("HEAD", path, {})->HeaderOf("upload-offset"), "10");
  EXPECT_EQ(UploadAt(path).state(), v1::Upload::STATE_FINISHED);
}

// https://tus.io/protocols/resumable-upload, sections "Creation" and "Expiration".
TEST_F(UploadsTest, TusRemembersMetadataAndSaysWhenAnUploadExpires) {
  const v1::Sequence sequence = CreateSequence();
  const std::string metadata = "filename " + InBase64("clip.png") + ",filetype " + InBase64("image/png") + ",flag";
  const auto created =
      Tus("POST", "v1/" + sequence.name() + "/uploads:tus", {{"Upload-Length", "4"}, {"Upload-Metadata", metadata}});
  const std::string path = created->HeaderOf("location").substr(1);
  const auto is_date = testing::MatchesRegex(
      "[A-Z][a-z][a-z], [0-9][0-9] [A-Z][a-z][a-z] 20[0-9][0-9] "
      "[0-9][0-9]:[0-9][0-9]:[0-9][0-9] GMT");
  EXPECT_THAT(created->HeaderOf("upload-expires"), is_date);
  EXPECT_EQ(created->HeaderOf("upload-expires"),
            TusTime(absl::FromUnixSeconds(UploadAt(path).expire_time().seconds())));
  EXPECT_THAT(Patch(path, 0, "ab")->HeaderOf("upload-expires"), is_date);
  const auto head = Tus("HEAD", path, {});
  EXPECT_EQ(head->HeaderOf("upload-metadata"), metadata);
  EXPECT_THAT(head->HeaderOf("upload-expires"), is_date);
  EXPECT_EQ(Patch(path, 2, "cd")->HeaderOf("upload-expires"), "") << "finished";
  EXPECT_EQ(Tus("HEAD", path, {})->HeaderOf("upload-metadata"), metadata);
}

TEST_F(UploadsTest, TusTerminates) {
  const v1::Sequence sequence = CreateSequence();
  const std::string path = Create(sequence, "rgb/a", 4);
  EXPECT_EQ(Patch(path, 0, "ab")->status, 204);
  EXPECT_EQ(FileOf(sequence, "rgb/a"), "ab");
  const auto deleted = Tus("DELETE", path, {});
  EXPECT_EQ(deleted->status, 204);
  EXPECT_EQ(deleted->body, "");
  EXPECT_FALSE(std::filesystem::exists(directory().SequenceFolder(IdOf(sequence.name())) + "/rgb"));
  EXPECT_EQ(Tus("HEAD", path, {})->status, 404);
  EXPECT_EQ(Patch(path, 2, "cd")->status, 404);
  EXPECT_EQ(Tus("DELETE", path, {})->status, 404);
  const std::string again = Create(sequence, "rgb/a", 4);
  EXPECT_EQ(Patch(again, 0, "abcd")->status, 204);
  const auto late = Tus("POST", again, {{"X-HTTP-Method-Override", "DELETE"}});
  EXPECT_EQ(late->status, 409);
  EXPECT_THAT(late->body, HasSubstr("finished"));
  EXPECT_EQ(FileOf(sequence, "rgb/a"), "abcd");
}

TEST_F(UploadsTest, TusTakesPatchInDisguise) {
  const v1::Sequence sequence = CreateSequence();
  const std::string path = Create(sequence, "a", 3);
  const auto patched = Tus(
      "POST", path, {{"X-HTTP-Method-Override", "PATCH"}, {"Content-Type", kTusContentType}, {"Upload-Offset", "0"}},
      "abc", /*in_chunks=*/true);
  EXPECT_EQ(patched->status, 204);
  EXPECT_EQ(FileOf(sequence, "a"), "abc");
}

}  // namespace
}  // namespace depthtween::server
