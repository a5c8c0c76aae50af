#include "core/tools/self_check_aloud.h"

#include <iostream>
#include <nlohmann/json.hpp>
#include <utility>

#include "core/session/self_check.h"
#include "core/tools/progress_bar.h"

namespace depthtween::tools {

using nlohmann::json;

absl::StatusOr<json> CheckSelfAloud(const SequenceFolder& recording, const UpsampleOptions& options,
                                    std::stop_token stop) {
  if (!options.self_check) return json();
  absl::StatusOr<SelfCheck> check = SelfCheck();
  {
    CountLine counter("checked", "held-out depth maps");
    check = CheckSelf(recording, options, std::move(stop), [&](int done, int total) { counter.Show(done, total); });
  }
  RETURN_IF_ERROR(check.status());
  std::cout << FormatTable(*check) << std::endl;
  return ToJson(*check);
}

}  // namespace depthtween::tools
