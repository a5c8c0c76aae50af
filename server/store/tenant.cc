#include "server/store/tenant.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace depthtween::server {

absl::Status CheckTenantName(std::string_view name) {
  const auto plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'); };
  const bool good = !name.empty() && name.size() <= 63 && plain(name.front()) &&
                    std::all_of(name.begin(), name.end(), [&](char c) { return plain(c) || c == '-'; });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("tenant = \"%s\", must be 1 to 63 lower-case letters, digits and \"-\", and begin with a letter "
                      "or a digit",
                      std::string(name.substr(0, 100))));
}

}  // namespace depthtween::server
