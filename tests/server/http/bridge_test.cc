// A whole server over HTTP: what comes back is what gRPC says, by protobuf's JSON and google.rpc.Code's HTTP mapping.
#include "server/http/bridge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/http/http_server.h"
#include "tests/server/http/raw_client.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using testing::StartsWith;
using Json = nlohmann::json;

class BridgeTest : public RpcTest {
 protected:
  HttpServerOptions http_options = {.listen = "127.0.0.1:0", .threads = 2, .gone_check = absl::Milliseconds(20)};

  HttpServer& http() {
    if (http_ == nullptr) {
      auto started = HttpServer::Start(http_options, channel());
      EXPECT_TRUE(started.ok()) << started.status();
      http_ = *std::move(started);
    }
    return *http_;
  }
  int port() { return http().port(); }
  RawAnswer Post(const std::string& target, const Json& body) {
    return PostOnce(port(), target, body.dump(), "Content-Type: application/json\r\n");
  }
  // The events of a stream until it ends: (event or "message", id, data).
  struct Event {
    std::string kind = "message", id, data;
  };
  static std::vector<Event> ReadEvents(const std::string& body) {
    std::vector<Event> events(1);
    for (const std::string& line : std::vector<std::string>(absl::StrSplit(body, '\n'))) {
      if (line.empty() && !events.back().data.empty()) events.emplace_back();
      if (line.rfind("event: ", 0) == 0) events.back().kind = line.substr(7);
      if (line.rfind("id: ", 0) == 0) events.back().id = line.substr(4);
      if (line.rfind("data: ", 0) == 0) events.back().data = line.substr(6);
    }
    events.pop_back();
    return events;
  }

 private:
  std::unique_ptr<HttpServer> http_;
};

TEST_F(BridgeTest, UnaryMethodsAsJson) {
  const RawAnswer created = Post("/v1/sequences?request_id=abc", {{"displayName", "a \"name\""}});
  ASSERT_EQ(created.status, 200) << created.body;
  const Json sequence = Json::parse(created.body);
  const std::string name = sequence["name"];
  EXPECT_THAT(name, StartsWith("sequences/"));
  EXPECT_EQ(sequence["state"], "STATE_UPLOADING");
  EXPECT_EQ(sequence["sizeBytes"], "0");  // 64-bit numbers are texts in protobuf's JSON

  EXPECT_EQ(Json::parse(Post("/v1/sequences?request_id=abc", {{"displayName", "a \"name\""}}).body), sequence);
  const RawAnswer again = Post("/v1/sequences?request_id=abc", {{"displayName", "another"}});
  EXPECT_EQ(again.status, 409);
  EXPECT_EQ(Json::parse(again.body)["details"][0]["reason"], "IDEMPOTENCY_MISMATCH");

  EXPECT_EQ(Json::parse(GetOnce(port(), "/v1/" + name).body), sequence);
  const Json list = Json::parse(GetOnce(port(), "/v1/sequences?page_size=5&filter=state%20=%20UPLOADING").body);
  EXPECT_EQ(list["sequences"].size(), 1U);

  RawClient client(port());
  client.Send("DELETE /v1/" + name + " HTTP/1.1\r\nHost: a\r\n\r\n");
  EXPECT_EQ(client.ReadAnswer().body, "{}\n");
  EXPECT_EQ(GetOnce(port(), "/v1/" + name).status, 404);
}

TEST_F(BridgeTest, ErrorsAreStatusesWithDetails) {
  const RawAnswer missing = GetOnce(port(), "/v1/jobs/nothing", "x-request-id: my-request\r\n");
  EXPECT_EQ(missing.status, 404);
  EXPECT_EQ(missing.Header("x-request-id"), "my-request");
  const Json error = Json::parse(missing.body);
  EXPECT_EQ(error["code"], 5);
  EXPECT_EQ(error["details"][1]["@type"], "type.googleapis.com/google.rpc.ResourceInfo");
  EXPECT_THAT(missing.body, HasSubstr("my-request"));  // the call carried it

  const RawAnswer field = Post("/v1/jobs", {{"sequense", "x"}});
  EXPECT_EQ(field.status, 400);
  EXPECT_EQ(Json::parse(field.body)["details"][1]["fieldViolations"][0]["field"], "job.sequense");
  EXPECT_EQ(PostOnce(port(), "/v1/jobs", "{}", "Content-Type: text/plain\r\n").status, 415);
  EXPECT_EQ(
      PostOnce(port(), "/v1/jobs", "{}", "Content-Type: application/json\r\nOrigin: https://evil.example\r\n").status,
      403);
  EXPECT_EQ(PostOnce(port(), "/v1/jobs", std::string((4 << 20) + 1, ' '), "Content-Type: application/json\r\n").status,
            413);
  const RawAnswer deep = PostOnce(port(), "/v1/jobs", std::string(100'000, '['), "Content-Type: application/json\r\n");
  EXPECT_EQ(deep.status, 400);
  EXPECT_THAT(deep.body, HasSubstr("100 levels"));
  const RawAnswer upload = Post("/v1/sequences/1/uploads/2:write", Json::object());
  EXPECT_EQ(upload.status, 405);
  EXPECT_THAT(upload.body, HasSubstr("tus"));
  EXPECT_EQ(GetOnce(port(), "/v1/jobs/1:cancel").Header("Allow"), "OPTIONS, POST");
  EXPECT_EQ(GetOnce(port(), "/v1/jobs/1:cancle").status, 404);
}

TEST_F(BridgeTest, WatchAsEvents) {
  const v1::Sequence sequence = ReadySequence();
  const RawAnswer created = Post("/v1/jobs", {{"sequence", sequence.name()}});
  ASSERT_EQ(created.status, 200) << created.body;
  const std::string job = Json::parse(created.body)["name"];

  const RawAnswer stream = GetOnce(port(), "/v1/" + job + ":watch", "Accept: text/event-stream\r\n");
  EXPECT_EQ(stream.status, 200);
  EXPECT_EQ(stream.Header("Content-Type"), "text/event-stream");
  const std::vector<Event> events = ReadEvents(stream.body);
  ASSERT_GE(events.size(), 2U) << stream.body;
  EXPECT_EQ(Json::parse(events.front().data)["snapshot"]["name"], job);
  EXPECT_EQ(events.back().kind, "end");
  EXPECT_EQ(GetJob(job).state(), v1::Job::STATE_SUCCEEDED);
  // Each event can be gone on from: after the last there is nothing, and a browser is told to stop.
  const std::string last = events[events.size() - 2].id;
  EXPECT_EQ(last, Json::parse(events[events.size() - 2].data)["resumeToken"]);
  const RawAnswer resumed =
      GetOnce(port(), "/v1/" + job + ":watch", "Accept: text/event-stream\r\nLast-Event-ID: " + last + "\r\n");
  EXPECT_THAT(resumed.status, testing::AnyOf(200, 204));
  for (const Event& event : ReadEvents(resumed.body)) EXPECT_NE(event.data, events.front().data);

  const RawAnswer lines = GetOnce(port(), "/v1/" + job + ":watch");
  EXPECT_EQ(lines.Header("Content-Type"), "application/x-ndjson");
  EXPECT_EQ(Json::parse(lines.body.substr(0, lines.body.find('\n')))["snapshot"]["state"], "STATE_SUCCEEDED");
  // What fails before its first message is an answer like any other.
  EXPECT_EQ(GetOnce(port(), "/v1/jobs/nothing:watch", "Accept: text/event-stream\r\n").status, 404);
}

TEST_F(BridgeTest, StreamsFrames) {
  const v1::Sequence sequence = ReadySequence();
  const v1::Job job = WaitUntilEnded(CreateJob(sequence).name());
  const RawAnswer frames =
      GetOnce(port(), "/v1/" + job.name() + "/outputs/depth:streamFrames?start_frame=0&end_frame=1");
  ASSERT_EQ(frames.status, 200) << frames.body;
  const Json chunk = Json::parse(frames.body.substr(0, frames.body.find('\n')));
  EXPECT_TRUE(chunk.contains("header"));
  EXPECT_FALSE(std::string(chunk["data"]).empty());
}

// The server stops: events say why, so that a client knows that it may come again.
TEST_F(BridgeTest, StreamsSayWhyTheyEnd) {
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  const std::string job = CreateJob(sequence).name();
  RawClient client(port());
  client.Get("/v1/" + job + ":watch", "Accept: text/event-stream\r\n");
  while (client.ReadLine().value_or("data: ").rfind("data: ", 0) != 0) {
  }
  http().Drain();
  server().Drain(absl::Seconds(60));
  const std::string rest = client.ReadToEnd();
  EXPECT_THAT(rest, HasSubstr("event: error\ndata: {\"code\":14"));
  EXPECT_THAT(rest, HasSubstr("SERVER_STOPPING"));
  http().Stop(absl::Seconds(60));
}

// A watcher that goes away leaves its place among the streams.
TEST_F(BridgeTest, CallsEndWithTheirClients) {
  rpc_options.room.streams = 1;
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  const std::string job = CreateJob(sequence).name();
  for (int i = 0; i < 3; ++i) {
    RawClient client(port());
    std::string line;
    do {
      RawClient next(port());
      next.Get("/v1/" + job + ":watch");
      line = next.ReadLine().value_or("");
    } while (line.find("429") != std::string::npos);
    EXPECT_THAT(line, HasSubstr("200"));
  }
}

class BridgeAccessTest : public BridgeTest {
 protected:
  BridgeAccessTest() { guard_options.token_file = file_; }
  std::string Make(std::set<Scope> scopes) {
    return Take(AddToken(file_, {.tenant = kDefaultTenant, .scopes = std::move(scopes)}));
  }
  const TemporaryFolder token_folder_;
  const std::string file_ = token_folder_ / "tokens.json";
};

// What all tenants do is the operator's to see.
TEST_F(BridgeAccessTest, MetricsAreForTheOperator) {
  Make({Scope::kAdmin});
  EXPECT_EQ(GetOnce(port(), "/metrics").status, 401);
  EXPECT_EQ(GetOnce(port(), "/readyz").status, 200);
}

// The guard of gRPC sees what came over HTTP.
TEST_F(BridgeAccessTest, TokensAndScopes) {
  const std::string reader = Make({Scope::kRead});
  const RawAnswer none = GetOnce(port(), "/v1/jobs");
  EXPECT_EQ(none.status, 401);
  EXPECT_EQ(none.Header("WWW-Authenticate"), "Bearer");
  EXPECT_EQ(GetOnce(port(), "/v1/jobs", "Authorization: Bearer wrong\r\n").status, 401);
  EXPECT_EQ(GetOnce(port(), "/v1/jobs", "Authorization: Bearer " + reader + "\r\n").status, 200);
  EXPECT_EQ(PostOnce(port(), "/v1/sequences", "{}",
                     "Content-Type: application/json\r\nAuthorization: Bearer " + reader + "\r\n")
                .status,
            403);
  EXPECT_EQ(GetOnce(port(), "/readyz").status, 200);
}

}  // namespace
}  // namespace depthtween::server
