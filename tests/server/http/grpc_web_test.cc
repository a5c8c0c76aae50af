// Frames against PROTOCOL-WEB.md of gRPC, byte for byte; and calls as a generated client of a page makes them.
#include "server/http/grpc_web.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "absl/strings/escaping.h"
#include "tests/server/http/raw_client.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::Optional;

const GrpcWebForm binary_form{.text = false, .content_type = "application/grpc-web+proto"};
const GrpcWebForm text_form{.text = true, .content_type = "application/grpc-web-text+proto"};

TEST(GrpcWeb, ContentTypes) {
  EXPECT_FALSE(ParseGrpcWebType("application/grpc-web")->text);
  EXPECT_FALSE(ParseGrpcWebType("application/grpc-web+proto; charset=x")->text);
  EXPECT_TRUE(ParseGrpcWebType("Application/gRPC-web-text")->text);
  EXPECT_EQ(ParseGrpcWebType("application/grpc-web-text+proto")->content_type, "application/grpc-web-text+proto");
  for (const char* other : {"", "application/grpc", "application/grpc-web+json", "application/grpc-website"}) {
    EXPECT_EQ(ParseGrpcWebType(other).has_value(), false) << other;
  }
}

TEST(GrpcWeb, Frames) {
  const std::string frame("\0\0\0\1\2", 5);
  EXPECT_EQ(GrpcWebMessage(binary_form, std::string(258, 'x')), frame + std::string(258, 'x'));
  EXPECT_EQ(GrpcWebMessage(text_form, "a"), "AAAAAAFh");
  const grpc::Status status(grpc::NOT_FOUND, "no %\n", "\xff");
  EXPECT_EQ(GrpcWebTrailers(binary_form, status).substr(5),
            "grpc-status:5\r\ngrpc-message:no %25%0a\r\ngrpc-status-details-bin:/w\r\n");
  EXPECT_EQ(GrpcWebTrailers(binary_form, grpc::Status::OK), std::string("\x80\0\0\0\x0fgrpc-status:0\r\n", 20));
}

TEST(GrpcWeb, ReadsOneWholeMessage) {
  EXPECT_EQ(*ParseGrpcWebRequest(binary_form, GrpcWebMessage(binary_form, "abc")), "abc");
  EXPECT_EQ(*ParseGrpcWebRequest(binary_form, GrpcWebMessage(binary_form, "")), "");
  EXPECT_EQ(*ParseGrpcWebRequest(text_form, GrpcWebMessage(text_form, "abcd")), "abcd");
  EXPECT_THAT(DecodeBase64Pieces("YQ==YWI=YWJj"), Optional(std::string("aababc")));
  for (const char* text : {"Y", "YQ", "YQ=", "===", "Y=Q=", "****"}) {
    EXPECT_EQ(DecodeBase64Pieces(text), std::nullopt) << text;
  }
  const std::string whole = GrpcWebMessage(binary_form, "abc");
  for (const std::string& body : {std::string(), whole.substr(0, 4), whole.substr(0, 7), whole + "x", whole + whole,
                                  std::string("\x80\0\0\0\0", 5), std::string("\0\xff\xff\xff\xff", 5)}) {
    EXPECT_EQ(ParseGrpcWebRequest(binary_form, body).status().code(), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_EQ(ParseGrpcWebRequest(binary_form, std::string("\1\0\0\0\0", 5)).status().code(),
            absl::StatusCode::kUnimplemented);
}

class GrpcWebTest : public RpcTest {
 protected:
  // The frames of an answer: flags and bytes.
  std::vector<std::pair<int, std::string>> Call(const std::string& path, const google::protobuf::Message& request,
                                                const GrpcWebForm& form, const std::string& more_headers = "") {
    return Call(path, request.SerializeAsString(), form, more_headers);
  }
  std::vector<std::pair<int, std::string>> Call(const std::string& path, const std::string& request,
                                                const GrpcWebForm& form, const std::string& more_headers = "") {
    if (http_ == nullptr) http_ = *HttpServer::Start({.listen = "127.0.0.1:0", .threads = 2}, channel());
    const RawAnswer answer = PostOnce(http_->port(), path, GrpcWebMessage(form, request),
                                      "Content-Type: " + form.content_type + "\r\nX-Grpc-Web: 1\r\n" + more_headers);
    EXPECT_EQ(answer.status, 200);
    EXPECT_EQ(answer.Header("Content-Type"), form.content_type);
    std::string bytes = form.text ? DecodeBase64Pieces(answer.body).value_or("") : answer.body;
    std::vector<std::pair<int, std::string>> frames;
    while (bytes.size() >= 5) {
      size_t size = 0;
      for (int i = 1; i < 5; ++i) size = size << 8 | static_cast<unsigned char>(bytes[i]);
      frames.emplace_back(static_cast<unsigned char>(bytes[0]), bytes.substr(5, size));
      bytes.erase(0, 5 + size);
    }
    return frames;
  }
  std::unique_ptr<HttpServer> http_;
};

TEST_F(GrpcWebTest, UnaryAndServerStreaming) {
  const v1::Sequence sequence = ReadySequence();
  for (const GrpcWebForm& form : {binary_form, text_form}) {
    v1::GetSequenceRequest get;
    get.set_name(sequence.name());
    const auto frames = Call("/depthtween.v1.SequenceService/GetSequence", get, form);
    ASSERT_EQ(frames.size(), 2U);
    v1::Sequence answer;
    EXPECT_TRUE(answer.ParseFromString(frames[0].second));
    EXPECT_EQ(answer.name(), sequence.name());
    EXPECT_EQ(frames[1].first, 0x80);
    EXPECT_EQ(frames[1].second, "grpc-status:0\r\n");

    get.set_name("sequences/nothing");
    const auto missing = Call("/depthtween.v1.SequenceService/GetSequence", get, form);
    ASSERT_EQ(missing.size(), 1U);
    EXPECT_THAT(missing[0].second, HasSubstr("grpc-status:5\r\n"));
    EXPECT_THAT(missing[0].second, HasSubstr("grpc-status-details-bin:"));

    v1::WatchJobRequest watch;
    watch.set_name(CreateJob(sequence).name());
    const auto events = Call("/depthtween.v1.JobService/WatchJob", watch, form);
    ASSERT_GE(events.size(), 2U);
    v1::JobEvent first;
    EXPECT_TRUE(first.ParseFromString(events[0].second));
    EXPECT_EQ(first.snapshot().name(), watch.name());
    EXPECT_EQ(events.back().second, "grpc-status:0\r\n");
  }
  EXPECT_EQ(PostOnce(http_->port(), "/depthtween.v1.JobService/GetJob", "x").status, 415);
  EXPECT_EQ(PostOnce(http_->port(), "/depthtween.v1.SequenceService/WriteUpload", "x").status, 405);
}

TEST_F(GrpcWebTest, UndecodableMessages) {
  for (const char* method : {"/depthtween.v1.SequenceService/GetSequence", "/depthtween.v1.JobService/WatchJob"}) {
    const auto frames = Call(method, std::string("\xff\xff\xff"), binary_form);
    ASSERT_EQ(frames.size(), 1U);
    EXPECT_THAT(frames[0].second, HasSubstr("grpc-status:3\r\ngrpc-message:the request cannot be decoded"));
  }
}

// The status of a call whose time was over is in the trailers, as gRPC's is.
TEST_F(GrpcWebTest, TimeoutsAreKept) {
  v1::WatchJobRequest watch;
  watch.set_name(CreateJob(ReadySequence("wait_at 1")).name());
  const auto ended = Call("/depthtween.v1.JobService/WatchJob", watch, binary_form, "grpc-timeout: 300m\r\n");
  ASSERT_FALSE(ended.empty());
  EXPECT_THAT(ended.back().second, HasSubstr("grpc-status:4\r\n"));
  const auto malformed = Call("/depthtween.v1.JobService/WatchJob", watch, binary_form, "grpc-timeout: soon\r\n");
  ASSERT_EQ(malformed.size(), 1U);
  EXPECT_THAT(malformed[0].second, HasSubstr("grpc-status:3\r\n"));
}

}  // namespace
}  // namespace depthtween::server
