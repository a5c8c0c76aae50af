#include "server/http/probes.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "depthtween/v1/admin.pb.h"
#include "grpc/health/v1/health.pb.h"
#include "server/http/errors.h"

namespace depthtween::server {
namespace {

namespace asio = boost::asio;

HttpResponse ProbeResponse(int status, std::string_view state) {
  return {.status = status,
          .headers = {{"Content-Type", "application/json"}},
          .body = absl::StrCat("{\"status\":\"", std::string(state), "\"}\n")};
}

asio::awaitable<void> AnswerHealthz(Exchange& exchange) {
  HttpResponse response = ProbeResponse(200, "UP");
  (void)co_await exchange.Respond(std::move(response));
}

asio::awaitable<void> AnswerReadyz(RpcChannel& channel, Exchange& exchange) {
  const grpc::health::v1::HealthCheckRequest request;
  grpc::health::v1::HealthCheckResponse answer;
  const grpc::Status status = co_await CallUnary(channel, exchange, "/grpc.health.v1.Health/Check", request, &answer);
  HttpResponse response;
  if (status.ok()) {
    const bool serving = answer.status() == grpc::health::v1::HealthCheckResponse::SERVING;
    response =
        ProbeResponse(serving ? 200 : 503, grpc::health::v1::HealthCheckResponse::ServingStatus_Name(answer.status()));
  } else {
    response = ErrorResponse(status);
    response.status = 503;
  }
  (void)co_await exchange.Respond(std::move(response));
}

HttpResponse MetricsResponse(const std::string& text) {
  return {.status = 200, .headers = {{"Content-Type", "text/plain; version=0.0.4"}}, .body = text};
}

asio::awaitable<void> AnswerMetrics(RpcChannel& channel, Exchange& exchange) {
  const v1::GetMetricsRequest request;  // named: GCC 12 destroys temporaries of a co_await twice
  v1::Metrics metrics;
  const grpc::Status status =
      co_await CallUnary(channel, exchange, "/depthtween.v1.AdminService/GetMetrics", request, &metrics);
  HttpResponse response;
  if (status.ok()) {
    response = MetricsResponse(metrics.text());
  } else {
    response = ErrorResponse(status);
  }
  (void)co_await exchange.Respond(std::move(response));
}

}  // namespace

void AddProbes(Router& router, RpcChannel& channel) {
  router.Add("GET", "/healthz", AnswerHealthz);
  router.Add("GET", "/readyz", [&channel](Exchange& exchange) { return AnswerReadyz(channel, exchange); });
  router.Add("GET", "/metrics", [&channel](Exchange& exchange) { return AnswerMetrics(channel, exchange); });
}

}  // namespace depthtween::server
