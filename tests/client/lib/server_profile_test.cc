// Files of named servers, written here: what is in them, and what cannot be meant.
#include "client/lib/server_profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::client {
namespace {

using testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class ServerProfileTest : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }
  const TemporaryFolder folder_;
};

TEST_F(ServerProfileTest, ANameStandsForEverythingThatReachesTheServer) {
  const std::string file = Write("servers.json", R"({"servers": {"studio": {"address": "depth.example.org:443",
      "tls": true, "tls_ca": "ca.pem", "tls_cert": "me.pem", "tls_key": "me.key", "token_file": "/secrets/t"}}})");
  const auto found = FindServer(file, "studio");
  ASSERT_THAT(found, IsOk());
  ASSERT_TRUE(found->has_value());
  EXPECT_EQ((*found)->address, "depth.example.org:443");
  EXPECT_TRUE((*found)->tls);
  EXPECT_EQ((*found)->tls_ca, folder_ / "ca.pem") << "relative to the file";
  EXPECT_EQ((*found)->token_file, "/secrets/t");
  EXPECT_FALSE(FindServer(file, "elsewhere")->has_value());
  EXPECT_FALSE(FindServer(folder_ / "none.json", "studio")->has_value());
}

TEST_F(ServerProfileTest, AFileThatCannotBeMeantIsNamed) {
  for (const char* bad : {"", "[]", "{}", R"({"servers": {"s": {}}})", R"({"servers": {"s": {"address": 7}}})",
                          R"({"servers": {"s": {"address": "a", "tsl": true}}})"}) {
    const auto found = FindServer(Write("servers.json", bad), "s");
    if (std::string(bad).empty()) continue;  // an empty file is as none
    EXPECT_THAT(found, HasCode(kInvalid)) << bad;
    EXPECT_THAT(std::string(found.status().message()), HasSubstr("servers.json")) << bad;
  }
}

TEST_F(ServerProfileTest, FilesAreReadIntoTheConnection) {
  ConnectionOptions options;
  EXPECT_THAT(Apply({.address = "a:1",
                     .tls_ca = Write("ca.pem", "CA"),
                     .tls_cert = Write("cert.pem", "CERT"),
                     .tls_key = Write("key.pem", "KEY"),
                     .token_file = Write("token", "dt_secret\n")},
                    options),
              IsOk());
  EXPECT_EQ(options.address, "a:1");
  EXPECT_TRUE(options.tls) << "a CA means TLS";
  EXPECT_EQ(options.tls_roots + options.tls_cert + options.tls_key, "CACERTKEY");
  EXPECT_EQ(options.token, "dt_secret") << "without the end of line";
}

TEST_F(ServerProfileTest, WhatIsMissingIsNamed) {
  ConnectionOptions options;
  EXPECT_THAT(std::string(Apply({.address = "a", .token_file = folder_ / "none"}, options).message()),
              HasSubstr("--token-file"));
  EXPECT_THAT(Apply({.address = "a", .tls_cert = Write("cert.pem", "C")}, options), HasCode(kInvalid));
  EXPECT_THAT(Apply({.address = "a", .token_file = Write("token", "two words")}, options), HasCode(kInvalid));
}

TEST(IsLocalAddress, KnowsThisMachine) {
  for (const char* own : {"127.0.0.1:1", "localhost", "[::1]:5", "unix:/x"}) EXPECT_TRUE(IsLocalAddress(own)) << own;
  for (const char* other : {"10.0.0.1:1", "depth.example.org", "[::]:1"}) EXPECT_FALSE(IsLocalAddress(other)) << other;
}

}  // namespace
}  // namespace depthtween::client
