#include "server/http/file_service.h"

#include <boost/asio/awaitable.hpp>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/http/downloads.h"
#include "server/http/errors.h"
#include "server/http/exchange.h"
#include "server/http/file_route.h"
#include "server/http/uploads.h"

namespace depthtween::server {
namespace {

class FileService {
 public:
  explicit FileService(RpcChannel& channel) : downloads_(channel), uploads_(channel) {}

  boost::asio::awaitable<void> Handle(Exchange& exchange) {
    const std::optional<FileRoute> route = MatchFileRoute(exchange.request().segments);
    if (!route) co_return co_await AnswerNotFound(exchange);
    switch (route->kind) {
      case FileRoute::Kind::kFrame:
        co_return co_await downloads_.SendFrame(exchange, *route);
      case FileRoute::Kind::kArchive:
        co_return co_await downloads_.SendArchive(exchange, *route);
      case FileRoute::Kind::kFile:
        co_return co_await downloads_.SendFile(exchange, *route);
      case FileRoute::Kind::kTusCreation:
        co_return co_await uploads_.CreateTus(exchange, *route);
      case FileRoute::Kind::kTusUpload:
        co_return co_await uploads_.HandleTus(exchange, *route);
      case FileRoute::Kind::kUpload:
        co_return co_await uploads_.Put(exchange, *route);
    }
  }

 private:
  // The router's stars take more than there is: what follows a number, or an output's name.
  static boost::asio::awaitable<void> AnswerNotFound(Exchange& exchange) {
    HttpResponse response = ErrorResponse(
        ErrorOf(absl::NotFoundError(
                    "there is no such file: frames are /frames/NUMBER.png (.jpg, .npz, .flo, .pfm, as the output "
                    "offers), an output is OUTPUT.zip or OUTPUT:download"),
                "NO_SUCH_RESOURCE"));
    const absl::Status sent = co_await exchange.Respond(std::move(response));
    (void)sent;
  }

  Downloads downloads_;
  Uploads uploads_;
};

constexpr std::pair<FileRoute::Kind, std::string_view> kFileRoutes[] = {
    {FileRoute::Kind::kFrame, "/v1/jobs/*/outputs/*/frames/*"},
    {FileRoute::Kind::kArchive, "/v1/jobs/*/outputs/*"},
    {FileRoute::Kind::kFile, "/v1/jobs/*/outputs/*:download"},
    {FileRoute::Kind::kTusCreation, "/v1/sequences/*/uploads:tus"},
    {FileRoute::Kind::kTusUpload, "/v1/sequences/*/uploads/*:tus"},
    {FileRoute::Kind::kUpload, "/v1/sequences/*/uploads/*"},
};

}  // namespace

void AddFileRoutes(Router& router, RpcChannel& channel) {
  const auto service = std::make_shared<FileService>(channel);
  for (const auto& [kind, path] : kFileRoutes) {
    for (const std::string_view method : MethodsOf(kind)) {
      router.Add(method, path, [service](Exchange& exchange) { return service->Handle(exchange); });
    }
  }
}

}  // namespace depthtween::server
