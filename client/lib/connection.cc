#include "client/lib/connection.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace depthtween::client {
namespace {

constexpr char kDefaultPort[] = "50051";
constexpr std::chrono::seconds kFirstContact{5};

// "host" -> "host:50051"; "host:port", "[v6]:port" and "unix:path" stay.
std::string WithPort(const std::string& address) {
  const size_t colon = address.find_last_of(':');
  const size_t bracket = address.find_last_of(']');
  const bool has_port = colon != std::string::npos && (bracket == std::string::npos || colon > bracket);
  return has_port ? address : absl::StrCat(address, ":", kDefaultPort);
}

ConnectionOptions Normalised(ConnectionOptions options) {
  options.address = WithPort(options.address);
  return options;
}

std::shared_ptr<grpc::ChannelCredentials> Credentials(const ConnectionOptions& options) {
  if (!options.tls) return grpc::InsecureChannelCredentials();
  return grpc::SslCredentials(
      {.pem_root_certs = options.tls_roots, .pem_private_key = options.tls_key, .pem_cert_chain = options.tls_cert});
}

std::shared_ptr<grpc::Channel> MakeChannel(const ConnectionOptions& options) {
  grpc::ChannelArguments arguments;
  // After this much silence on a stream, its peer has vanished (cable, suspended machine). The server's heartbeats keep
  // healthy streams below it.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10'000);
  // Our own back-off paces the tries; the channel's own would wait up to two minutes for a server that is long back.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  // http_proxy is meant for the web; obeying it would send even loopback calls there.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  return grpc::CreateCustomChannel(options.address, Credentials(options), arguments);
}

// gRPC's reason for a missing connection, without what only its authors need.
std::string Why(const std::string& words) {
  if (absl::StrContains(words, "DNS resolution failed")) return "the host name is not known";
  constexpr absl::string_view kRefused = "Failed to connect to remote host: ";
  const size_t at = words.rfind(kRefused.data());
  return at == std::string::npos ? words : words.substr(at + kRefused.size());
}

}  // namespace

std::string AddressProblem(const std::string& address) {
  const std::string rule = absl::StrCat("'", address, "' is not the address of a server: ");
  if (absl::StartsWith(address, "unix:")) return "";
  if (absl::StrContains(address, "://")) return rule + "remove what precedes HOST:PORT";
  const std::string full = WithPort(address);
  const size_t colon = full.find_last_of(':');
  int port = 0;
  if (colon == 0) return rule + "it names no host, must be HOST, HOST:PORT or unix:PATH";
  if (!absl::SimpleAtoi(full.substr(colon + 1), &port) || port < 1 || port > 65535) {
    return rule + "the port must be a number from 1 to 65535";
  }
  return "";
}

Connection::Connection(ConnectionOptions options)
    : options_(Normalised(std::move(options))),
      channel_(MakeChannel(options_)),
      admin_(v1::AdminService::NewStub(channel_)),
      sequences_(v1::SequenceService::NewStub(channel_)),
      jobs_(v1::JobService::NewStub(channel_)),
      outputs_(v1::OutputService::NewStub(channel_)) {}

absl::StatusOr<std::unique_ptr<Connection>> Connection::Open(const ConnectionOptions& options) {
  if (const std::string problem = AddressProblem(options.address); !problem.empty()) {
    return absl::InvalidArgumentError(problem);
  }
  std::unique_ptr<Connection> connection(new Connection(options));
  v1::AdminService::StubInterface& admin = *connection->admin_;
  absl::StatusOr<v1::ServerInfo> server =
      connection->CallWithin(std::min<std::chrono::milliseconds>(kFirstContact, options.call_timeout), admin,
                             &v1::AdminService::StubInterface::GetServerInfo, v1::GetServerInfoRequest());
  if (absl::IsUnimplemented(server.status())) {
    return absl::UnimplementedError(absl::StrFormat("what answers at %s is not a Depthtween server: check the address",
                                                    connection->options_.address));
  }
  RETURN_IF_ERROR(server.status());
  connection->server_ = *std::move(server);
  return connection;
}

void Connection::Authorize(grpc::ClientContext& context) const {
  if (!options_.token.empty()) context.AddMetadata("authorization", "Bearer " + options_.token);
}

absl::Status Connection::Answer(const grpc::Status& status) const {
  // An address that drops packets runs into our deadline; others refuse at once. A deadline of the server itself
  // carries details.
  const bool silent = status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && status.error_details().empty();
  // Cancelled, but not by us: the server ended the call because it is stopping.
  if (!silent && status.error_code() != grpc::StatusCode::UNAVAILABLE &&
      status.error_code() != grpc::StatusCode::CANCELLED) {
    const absl::Status answer = FromRpc(status);
    if (!absl::IsUnauthenticated(answer) || !options_.token.empty()) return answer;
    return absl::UnauthenticatedError(
        absl::StrFormat("%s asks for a token: name the file that holds yours with --token-file FILE or the environment "
                        "variable DEPTHTWEEN_TOKEN_FILE; the server's operator makes one with 'depthtween-server token "
                        "new'",
                        options_.address));
  }
  // Whoever speaks TLS ends a connection that does not, and the other way round.
  const std::string& words = status.error_message();
  const bool ended = absl::StrContains(words, "Socket closed") || absl::StrContains(words, "Connection reset") ||
                     absl::StrContains(words, "handshake") || absl::StrContains(words, "SSL") ||
                     absl::StrContains(words, "recvmsg") || absl::StrContains(words, "Ssl");
  if (ended && !silent) {
    return absl::UnavailableError(absl::StrFormat(
        "%s ends the connection (%s). %s", options_.address, Why(words),
        options_.tls
            ? "Does it speak TLS, has --tls-ca signed its certificate, does the certificate name this host, and "
              "does it ask for a certificate of yours (--tls-cert, --tls-key)?"
            : "Does it speak TLS? Then say --tls, or name who has signed its certificate with --tls-ca FILE"));
  }
  return absl::UnavailableError(
      absl::StrFormat("no server answers at %s (%s). Start one with 'depthtween-server serve --data-dir DIR --listen "
                      "%s', or name another "
                      "with --server ADDRESS or the environment variable DEPTHTWEEN_SERVER",
                      options_.address, silent ? "no answer in time" : Why(status.error_message()), options_.address));
}

}  // namespace depthtween::client
