// The CORS protocol of the Fetch standard: nothing for origins that are not allowed, nothing at all by default.
#include "server/http/cors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace depthtween::server {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

HttpRequest From(const std::string& origin, const std::string& method = "GET") {
  HttpRequest request{.method = method, .headers = {{"Host", "server:8080"}}};
  if (!origin.empty()) request.headers.emplace_back("Origin", origin);
  return request;
}

TEST(Cors, OnlyForAllowedOrigins) {
  const std::vector<std::string> allowed = {"https://a.example"};
  EXPECT_THAT(CorsHeaders({}, From("https://a.example")), IsEmpty());
  EXPECT_THAT(CorsHeaders(allowed, From("https://a.example")),
              Contains(Pair("Access-Control-Allow-Origin", "https://a.example")));
  for (const char* other : {"", "https://a.example.evil", "http://a.example", "https://a.example:81", "null", "*"}) {
    EXPECT_THAT(CorsHeaders(allowed, From(other)), ElementsAre(Pair("Vary", "Origin"))) << other;
  }
  EXPECT_THAT(CorsHeaders({"*"}, From("https://any.example")),
              Contains(Pair("Access-Control-Allow-Origin", "https://any.example")));
}

TEST(Cors, Preflights) {
  HttpRequest request = From("https://a.example", "OPTIONS");
  EXPECT_FALSE(PreflightResponse({"*"}, request, {"POST"}).has_value());  // a plain OPTIONS
  request.headers.emplace_back("Access-Control-Request-Method", "POST");
  request.headers.emplace_back("Access-Control-Request-Headers", "authorization, x-a");
  const auto allowed = PreflightResponse({"https://a.example"}, request, {"OPTIONS", "POST"});
  ASSERT_TRUE(allowed.has_value());
  EXPECT_EQ(allowed->status, 204);
  EXPECT_THAT(allowed->headers, Contains(Pair("Access-Control-Allow-Methods", "OPTIONS, POST")));
  EXPECT_THAT(allowed->headers, Contains(Pair("Access-Control-Allow-Headers", "authorization, x-a")));
  EXPECT_EQ(PreflightResponse({"https://b.example"}, request, {"POST"})->status, 403);
  EXPECT_EQ(PreflightResponse({}, request, {"POST"})->status, 403);
}

// A page anywhere can make a browser send a POST to a server on this machine.
TEST(Cors, CrossSiteWrites) {
  EXPECT_TRUE(IsCrossSiteWrite({}, From("https://evil.example", "POST")));
  EXPECT_TRUE(IsCrossSiteWrite({}, From("null", "DELETE")));
  EXPECT_FALSE(IsCrossSiteWrite({}, From("https://evil.example", "GET")));
  EXPECT_FALSE(IsCrossSiteWrite({}, From("", "POST")));  // no browser
  EXPECT_FALSE(IsCrossSiteWrite({}, From("http://server:8080", "POST")));
  EXPECT_FALSE(IsCrossSiteWrite({}, From("https://server:8080", "POST")));
  EXPECT_FALSE(IsCrossSiteWrite({"https://a.example"}, From("https://a.example", "POST")));
}

TEST(Cors, WhatAnOriginIs) {
  for (const char* good : {"*", "https://a.example", "http://localhost:5173", "http://[::1]:80"}) {
    EXPECT_TRUE(IsOrigin(good)) << good;
  }
  for (const char* bad : {"", "a.example", "https://", "https://a.example/", "https://a b", "ftp://a", "null"}) {
    EXPECT_FALSE(IsOrigin(bad)) << bad;
  }
}

// A name that leads here by DNS is not one of ours, whatever its address.
TEST(Hosts, AreThoseOfTheList) {
  const std::vector<std::string> hosts = {"localhost", "127.0.0.1", "[::1]"};
  const auto allowed = [&hosts](const std::string& host) {
    HttpRequest request;
    request.headers = {{"Host", host}};
    return IsAllowedHost(hosts, request);
  };
  for (const char* good : {"localhost", "LOCALHOST:80", "127.0.0.1:8080", "[::1]", "[::1]:8080"}) {
    EXPECT_TRUE(allowed(good)) << good;
  }
  for (const char* bad : {"evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.2", "::1", "[::2]:80",
                          "[", "localhost@evil.example"}) {
    EXPECT_FALSE(allowed(bad)) << bad;
  }
  EXPECT_TRUE(IsAllowedHost(hosts, HttpRequest())) << "HTTP/1.0";
  HttpRequest anything;
  anything.headers = {{"Host", "evil.example"}};
  EXPECT_TRUE(IsAllowedHost({}, anything));
}

}  // namespace
}  // namespace depthtween::server
