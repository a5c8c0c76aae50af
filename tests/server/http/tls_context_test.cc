// TLS between real sockets, with certificates that the test makes: what a client sees is the certificate it is shown.
#include "server/http/tls_context.h"

#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/write.hpp>
#include <cstdio>
#include <filesystem>

#include "absl/time/clock.h"
#include "server/http/http_server.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;
namespace ssl = boost::asio::ssl;

// A self-signed certificate with its key, for a day.
void WriteCertificate(const std::string& name, const std::string& cert_file, const std::string& key_file) {
  EVP_PKEY* key = EVP_EC_gen("P-256");
  X509* cert = X509_new();
  ASN1_INTEGER_set(X509_get_serialNumber(cert), 1);
  X509_gmtime_adj(X509_getm_notBefore(cert), -60);
  X509_gmtime_adj(X509_getm_notAfter(cert), 86400);
  X509_set_pubkey(cert, key);
  X509_NAME* subject = X509_get_subject_name(cert);
  X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1,
                             0);
  X509_set_issuer_name(cert, subject);
  X509_sign(cert, key, EVP_sha256());
  std::FILE* file = std::fopen(cert_file.c_str(), "w");
  PEM_write_X509(file, cert);
  std::fclose(file);
  file = std::fopen(key_file.c_str(), "w");
  PEM_write_PrivateKey(file, key, nullptr, nullptr, 0, nullptr, nullptr);
  std::fclose(file);
  X509_free(cert);
  EVP_PKEY_free(key);
}

class TlsTest : public testing::Test {
 protected:
  TlsTest() { WriteCertificate("first", files.cert, files.key); }

  void StartServer() {
    // Nobody is there: these tests make no calls.
    auto channel = grpc::CreateChannel("unix:/nonexistent", grpc::InsecureChannelCredentials());
    auto started = HttpServer::Start({.listen = "127.0.0.1:0", .tls = files, .threads = 1}, std::move(channel));
    ASSERT_TRUE(started.ok()) << started.status();
    server_ = *std::move(started);
  }

  // The name in the server's certificate and the start of its answer to a request; "" if there is no connection.
  std::pair<std::string, std::string> Ask(const TlsFiles& own = {}, int max_version = 0) {
    asio::io_context context;
    ssl::context tls(ssl::context::tls_client);
    if (max_version != 0) SSL_CTX_set_max_proto_version(tls.native_handle(), max_version);
    if (!own.cert.empty()) {
      tls.use_certificate_chain_file(own.cert);
      tls.use_private_key_file(own.key, ssl::context::pem);
    }
    ssl::stream<asio::ip::tcp::socket> stream(context, tls);
    boost::system::error_code error;
    stream.next_layer().connect({asio::ip::address_v4::loopback(), static_cast<uint16_t>(server_->port())}, error);
    if (!error) stream.handshake(ssl::stream_base::client, error);
    if (error) return {};
    X509* cert = SSL_get1_peer_certificate(stream.native_handle());
    char name[64] = "";
    X509_NAME_get_text_by_NID(X509_get_subject_name(cert), NID_commonName, name, sizeof(name));
    X509_free(cert);
    const std::string request = "GET /healthz HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n";
    asio::write(stream, asio::buffer(request), error);
    std::string answer(12, '\0');
    // In TLS 1.3 a client learns only here that its certificate is not wanted.
    if (!error) asio::read(stream, asio::buffer(answer), error);
    return error ? std::pair<std::string, std::string>() : std::pair<std::string, std::string>(name, answer);
  }

  TemporaryFolder folder;
  TlsFiles files = {.cert = folder / "cert.pem", .key = folder / "key.pem"};

 private:
  std::unique_ptr<HttpServer> server_;
};

TEST_F(TlsTest, ServesOverTls) {
  StartServer();
  EXPECT_EQ(Ask(), std::make_pair(std::string("first"), std::string("HTTP/1.1 200")));
  EXPECT_EQ(Ask({}, TLS1_2_VERSION).first, "first");
  EXPECT_EQ(Ask({}, TLS1_1_VERSION).first, "");
}

TEST_F(TlsTest, FollowsItsFiles) {
  StartServer();
  EXPECT_EQ(Ask().first, "first");
  WriteCertificate("second", files.cert, files.key);
  while (Ask().first != "second") absl::SleepFor(absl::Milliseconds(100));
  // Broken files leave what worked.
  { std::filesystem::resize_file(files.cert, 10); }
  const auto tls = TlsContext::Load(files);
  EXPECT_EQ(tls.status().code(), absl::StatusCode::kInvalidArgument);
  absl::SleepFor(absl::Milliseconds(1200));
  EXPECT_EQ(Ask().first, "second");
}

TEST_F(TlsTest, AsksForCertificatesOfClients) {
  const TlsFiles client = {.cert = folder / "client.pem", .key = folder / "client-key.pem"};
  const TlsFiles stranger = {.cert = folder / "stranger.pem", .key = folder / "stranger-key.pem"};
  WriteCertificate("client", client.cert, client.key);
  WriteCertificate("stranger", stranger.cert, stranger.key);
  files.client_ca = client.cert;
  StartServer();
  EXPECT_EQ(Ask(client).second, "HTTP/1.1 200");
  EXPECT_EQ(Ask().second, "");
  EXPECT_EQ(Ask(stranger).second, "");
}

TEST_F(TlsTest, ChecksOnlyNowAndThen) {
  const auto tls = TlsContext::Load(files);
  ASSERT_TRUE(tls.ok()) << tls.status();
  const auto first = (*tls)->Current();
  WriteCertificate("second", files.cert, files.key);
  std::filesystem::last_write_time(files.cert, std::filesystem::file_time_type::clock::now() + std::chrono::seconds(5));
  EXPECT_EQ((*tls)->Current(absl::Hours(1)), first);
  EXPECT_NE((*tls)->Current(absl::ZeroDuration()), first);
}

}  // namespace
}  // namespace depthtween::server
