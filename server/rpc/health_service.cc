#include "server/rpc/health_service.h"

#include <optional>
#include <string>

#include "grpc/health/v1/health.grpc.pb.h"
#include "server/rpc/server_stream.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

namespace health_v1 = grpc::health::v1;
using health_v1::HealthCheckRequest;
using health_v1::HealthCheckResponse;

HealthCheckResponse::ServingStatus EncodeServing(bool serving) {
  return serving ? HealthCheckResponse::SERVING : HealthCheckResponse::NOT_SERVING;
}

class HealthWatchStream : public ServerStream<HealthCheckResponse> {
 public:
  HealthWatchStream(CallRuntime& runtime, grpc::CallbackServerContext* context, Health& health, std::string service)
      : ServerStream(runtime, context, "Health.Watch", service), health_(health), service_(std::move(service)) {}

 private:
  absl::StatusOr<Next> Produce() override {
    if (subscription_ == nullptr) subscription_ = health_.Subscribe(Waker());
    const std::optional<bool> serving = health_.IsServing(service_);
    const auto status = serving ? EncodeServing(*serving) : HealthCheckResponse::SERVICE_UNKNOWN;
    if (sent_ == status) return Next::kWait;
    sent_ = status;
    message().set_status(status);
    return Next::kMessage;
  }

  void Release() override { subscription_.reset(); }

  Health& health_;
  const std::string service_;
  std::shared_ptr<void> subscription_;
  std::optional<HealthCheckResponse::ServingStatus> sent_;
};

class HealthService : public health_v1::Health::CallbackService {
 public:
  HealthService(CallRuntime& runtime, Health& health) : runtime_(runtime), health_(health) {}

  grpc::ServerUnaryReactor* Check(grpc::CallbackServerContext* context, const HealthCheckRequest* request,
                                  HealthCheckResponse* response) override {
    return runtime_.Unary(context, "Health.Check", request->service(), [=, this](const Caller&) -> absl::Status {
      const std::optional<bool> serving = health_.IsServing(request->service());
      if (!serving) return NoSuchResource(request->service());
      response->set_status(EncodeServing(*serving));
      return absl::OkStatus();
    });
  }

  grpc::ServerWriteReactor<HealthCheckResponse>* Watch(grpc::CallbackServerContext* context,
                                                       const HealthCheckRequest* request) override {
    return LaunchStream<HealthWatchStream>(runtime_, context, health_, request->service());
  }

 private:
  CallRuntime& runtime_;
  Health& health_;
};

}  // namespace

std::unique_ptr<grpc::Service> MakeHealthService(CallRuntime& runtime, Health& health) {
  return std::make_unique<HealthService>(runtime, health);
}

}  // namespace depthtween::server
