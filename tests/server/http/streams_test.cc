// Bodies of streams, against the grammar of event streams in the HTML standard (9.2.5) and of NDJSON.
#include "server/http/streams.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace depthtween::server {
namespace {

TEST(Streams, Events) {
  EXPECT_EQ(SseMessage("7-1", R"({"a":1})"), "id: 7-1\ndata: {\"a\":1}\n\n");
  EXPECT_EQ(SseMessage("", "{}"), "data: {}\n\n");
  // Neither an id nor a text can end its event or begin a field.
  EXPECT_EQ(SseMessage("a\nevent: x", "{}"), "data: {}\n\n");
  EXPECT_EQ(SseMessage("", "a\nb\r\nc"), "data: a\ndata: b\ndata: \ndata: c\n\n");
  EXPECT_EQ(SseHeartbeat()[0], ':');
  EXPECT_EQ(SseEnd(), "event: end\ndata: {}\n\n");
  google::rpc::Status error;
  error.set_code(14);
  EXPECT_EQ(SseError(error), "event: error\ndata: {\"code\":14}\n\n");
}

TEST(Streams, Lines) {
  EXPECT_EQ(NdjsonMessage("{}"), "{}\n");
  google::rpc::Status error;
  error.set_code(10);
  error.set_message("a\nb");
  const std::string line = NdjsonError(error);
  EXPECT_EQ(line.find('\n'), line.size() - 1);
  EXPECT_EQ(nlohmann::json::parse(line)["error"]["code"], 10);
}

// RFC 9110, 12.5.1.
TEST(Streams, AcceptsByName) {
  EXPECT_TRUE(Accepts("text/event-stream", "text/event-stream"));
  EXPECT_TRUE(Accepts("application/json, Text/Event-Stream ;q=0.9", "text/event-stream"));
  EXPECT_FALSE(Accepts("*/*", "text/event-stream"));
  EXPECT_FALSE(Accepts("text/event-streams", "text/event-stream"));
  EXPECT_FALSE(Accepts("", "text/event-stream"));
}

}  // namespace
}  // namespace depthtween::server
