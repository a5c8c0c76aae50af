// Addresses as RFC 3986 writes them, and IANA's registries of special-purpose addresses.
#include "server/webhooks/webhook_url.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

TEST(ParseWebhookUrl, TakesItApart) {
  const WebhookUrl url = Take(ParseWebhookUrl("https://hooks.example.org/a/b?c=d", false));
  EXPECT_TRUE(url.tls);
  EXPECT_EQ(url.host, "hooks.example.org");
  EXPECT_EQ(url.port, "443");
  EXPECT_EQ(url.authority, "hooks.example.org");
  EXPECT_EQ(url.target, "/a/b?c=d");
  EXPECT_EQ(Take(ParseWebhookUrl("https://example.org", false)).target, "/");
  EXPECT_EQ(Take(ParseWebhookUrl("https://example.org?x", false)).target, "/?x");
  EXPECT_EQ(Take(ParseWebhookUrl("https://example.org:8443/", false)).port, "8443");
  const WebhookUrl six = Take(ParseWebhookUrl("https://[2606:4700::1111]:444/x", false));
  EXPECT_EQ(six.host, "2606:4700::1111");
  EXPECT_EQ(six.port, "444");
  EXPECT_EQ(six.authority, "[2606:4700::1111]:444");
  const WebhookUrl plain = Take(ParseWebhookUrl("http://localhost/x", true));
  EXPECT_FALSE(plain.tls);
  EXPECT_EQ(plain.port, "80");
}

TEST(ParseWebhookUrl, RefusesWhatItShouldNotSendTo) {
  for (const std::string& bad :
       {std::string("http://example.org/"), std::string("ftp://example.org/"), std::string("example.org"),
        std::string("https://"), std::string("https:///x"), std::string("https://user@example.org/"),
        std::string("https://example.org/#part"), std::string("https://example.org:0/"),
        std::string("https://example.org:65536/"), std::string("https://example.org:/"),
        std::string("https://example.org:12x/"), std::string("https://[::1/"),
        std::string("https://[2606:4700::1111]x/"), std::string("https://example.org/a b"),
        std::string("https://example.org/\r\nX: y"), std::string("https://ex\xC3\xA4mple.org/"),
        std::string("https://example.org\\@evil/"), "https://example.org/" + std::string(2000, 'a')}) {
    EXPECT_THAT(ParseWebhookUrl(bad, false), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD")) << bad;
  }
  EXPECT_THAT(ParseWebhookUrl("ftp://example.org/", true), HasReason(absl::StatusCode::kInvalidArgument, "BAD_FIELD"));
}

TEST(IsPublicAddress, OnlyOfTheInternet) {
  for (const char* text : {"1.1.1.1", "8.8.8.8", "172.15.255.255", "172.32.0.1", "100.63.0.1", "100.128.0.1",
                           "169.253.1.1", "192.169.0.1", "223.255.255.255", "2606:4700::1111", "2a00:1450::1"}) {
    EXPECT_TRUE(IsPublicAddress(boost::asio::ip::make_address(text))) << text;
  }
  for (const char* text : {"0.0.0.0",          "10.1.2.3",       "100.64.0.1",      "127.0.0.1",    "127.255.255.255",
                           "169.254.169.254",  "172.16.0.1",     "172.31.255.255",  "192.0.0.8",    "192.0.2.1",
                           "192.168.1.1",      "198.18.0.1",     "198.19.255.255",  "198.51.100.1", "203.0.113.1",
                           "224.0.0.1",        "240.0.0.1",      "255.255.255.255", "::",           "::1",
                           "::ffff:127.0.0.1", "::ffff:8.8.8.8", "64:ff9b::7f00:1", "fe80::1",      "fc00::1",
                           "fd12::1",          "ff02::1",        "2001:db8::1",     "2001::1",      "2002:7f00:1::1",
                           "3fff::1"}) {
    EXPECT_FALSE(IsPublicAddress(boost::asio::ip::make_address(text))) << text;
  }
}

}  // namespace
}  // namespace depthtween::server
