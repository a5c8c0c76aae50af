// Any bytes as a page token: an error about a field, or the number of which exactly this token is made.
#include <cstdlib>

#include "server/store/error_info.h"
#include "server/store/list_request.h"
#include "server/store/sqlite_store_impl.h"

using namespace depthtween::server;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto page = ParsePage(0, {reinterpret_cast<const char*>(data), size}, 100);
  if (!page.ok()) std::abort();
  const auto number = ParsePageToken(*page, "jobs");
  if (!number.ok() && GetErrorInfo(number.status())->reason != "BAD_FIELD") std::abort();
  if (number.ok() && size > 0 && MakePageToken(*number, "jobs") != page->token) std::abort();
  return 0;
}
