// What a server has lost of a result, in words and as JSON.
#ifndef DEPTHTWEEN_CLIENT_CLI_LOST_FILES_H_
#define DEPTHTWEEN_CLIENT_CLI_LOST_FILES_H_

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "client/lib/fetch.h"

namespace depthtween::cli {

// "jobs/7: 4 frames of depth (3, 8-10) and report.json are lost or damaged on the server's disk; everything else
// ... To recreate them, ...", on one line. `lost` must not be empty.
std::string DescribeLost(const std::string& job, const std::vector<client::LostOutput>& lost, const std::string& where);

// [{"output": "jobs/7/outputs/depth", "frames": [3, 8, 9, 10]}, {"output": "jobs/7/outputs/report"}]
nlohmann::json LostToJson(const std::vector<client::LostOutput>& lost);

}  // namespace depthtween::cli

#endif  // DEPTHTWEEN_CLIENT_CLI_LOST_FILES_H_
