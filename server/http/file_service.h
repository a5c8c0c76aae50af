// The routes of files (file_route.h), for the router.
#ifndef DEPTHTWEEN_SERVER_HTTP_FILE_SERVICE_H_
#define DEPTHTWEEN_SERVER_HTTP_FILE_SERVICE_H_

#include "server/http/calls.h"
#include "server/http/router.h"

namespace depthtween::server {

// The channel must outlive every exchange that the router hands out.
void AddFileRoutes(Router& router, RpcChannel& channel);

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_HTTP_FILE_SERVICE_H_
