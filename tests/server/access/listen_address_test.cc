// Where a server may listen, by addresses that this machine alone can reach and addresses that others can.
#include "server/access/listen_address.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

TEST(ListenAddress, IsReadWithAndWithoutBrackets) {
  EXPECT_EQ(Take(ParseListenAddress("127.0.0.1:50051")).port, 50051);
  EXPECT_EQ(Take(ParseListenAddress("[::1]:0")).host, "::1");
  for (const char* bad : {"", "127.0.0.1", ":80", "a:65536", "a:-1", "a:x"}) {
    EXPECT_THAT(ParseListenAddress(bad), HasCode(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

TEST(ListenAddress, ThisMachineMayAlwaysCall) {
  for (const char* own : {"127.0.0.1:1", "127.8.8.8:1", "[::1]:1", "localhost:1", "unix:/run/x.sock"}) {
    EXPECT_THAT(CheckListenAddress(own, {}), IsOk()) << own;
  }
}

TEST(ListenAddress, OthersMayCallWithTlsAndTokensOrByOrder) {
  for (const char* open : {"0.0.0.0:1", "[::]:1", "192.168.1.7:1", "depth.example.org:1"}) {
    EXPECT_THAT(CheckListenAddress(open, {.tls = true, .tokens = true}), IsOk()) << open;
    EXPECT_THAT(CheckListenAddress(open, {.insecure_anywhere = true}), IsOk()) << open;
    EXPECT_THAT(std::string(CheckListenAddress(open, {}).message()), HasSubstr("--tls-cert, --tls-key and --tokens"));
    EXPECT_THAT(std::string(CheckListenAddress(open, {.tls = true}).message()), HasSubstr("without --tokens"));
    EXPECT_THAT(std::string(CheckListenAddress(open, {.tokens = true}).message()), HasSubstr("in the clear"));
  }
}

}  // namespace
}  // namespace depthtween::server
