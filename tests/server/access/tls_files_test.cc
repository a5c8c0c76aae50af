// Certificates that openssl makes for the test, alone and with what does not belong to them.
#include "server/access/tls_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "tests/server/server_fixtures.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;

class TlsFilesTest : public testing::Test {
 protected:
  // A certificate that signs itself and its key, as NAME.pem and NAME.key.
  TlsFiles Pair(const std::string& name) {
    const TlsFiles files = {.cert = folder_ / (name + ".pem"), .key = folder_ / (name + ".key")};
    const std::string command =
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=test -keyout " +
        files.key + " -out " + files.cert + " 2> /dev/null";
    EXPECT_EQ(std::system(command.c_str()), 0);
    return files;
  }
  static std::string Problem(const TlsFiles& files) { return std::string(CheckTlsFiles(files).message()); }

  const TemporaryFolder folder_;
};

TEST_F(TlsFilesTest, APairIsRight) {
  TlsFiles files = Pair("server");
  EXPECT_THAT(CheckTlsFiles(files), IsOk());
  files.client_ca = Pair("clients").cert;
  EXPECT_THAT(CheckTlsFiles(files), IsOk());
}

TEST_F(TlsFilesTest, WhatDoesNotFitIsNamed) {
  const TlsFiles files = Pair("server");
  EXPECT_THAT(Problem({.key = files.key}), HasSubstr("--tls-cert is missing"));
  EXPECT_THAT(Problem({.cert = files.cert}), HasSubstr("--tls-key is missing"));
  EXPECT_THAT(Problem({.cert = files.cert, .key = Pair("other").key}), HasSubstr("does not belong"));
  EXPECT_THAT(Problem({.cert = files.key, .key = files.key}), HasSubstr("no certificate"));
  EXPECT_THAT(Problem({.cert = files.cert, .key = folder_ / "none"}), HasSubstr("cannot be read"));
  EXPECT_THAT(Problem({.cert = files.cert, .key = files.key, .client_ca = files.key}), HasSubstr("--tls-client-ca"));
}

TEST_F(TlsFilesTest, AnyOfThemMeansTls) {
  EXPECT_FALSE(TlsFiles{}.enabled());
  EXPECT_TRUE(TlsFiles{.client_ca = "ca.pem"}.enabled());
}

}  // namespace
}  // namespace depthtween::server
