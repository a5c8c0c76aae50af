// The description of the file routes against the routes themselves: each path is one that the router's own function
// knows, and each method of each route is described.
#include "server/http/openapi_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "server/http/file_route.h"

namespace depthtween::server {
namespace {

TEST(OpenApiFiles, EveryRouteIsDescribedAndNoOther) {
  std::map<FileRoute::Kind, std::set<std::string>> described;
  const nlohmann::ordered_json files = FileRoutesOfOpenApi();
  for (const auto& [path, operations] : files["paths"].items()) {
    // With ids in the places of the names.
    const std::string real = absl::StrReplaceAll(path, {{"{job}", "j"},
                                                        {"{output}", "depth"},
                                                        {"{sequence}", "s"},
                                                        {"{upload}", "u"},
                                                        {"{frame}", "7"},
                                                        {"{format}", "png"}});
    ASSERT_EQ(real.find('{'), std::string::npos) << path;
    const auto route = MatchFileRoute(absl::StrSplit(real.substr(1), '/'));
    ASSERT_TRUE(route) << path;
    for (const auto& [verb, operation] : operations.items()) {
      described[route->kind].insert(absl::AsciiStrToUpper(verb));
      EXPECT_FALSE(operation["description"].empty());
    }
  }
  using Kind = FileRoute::Kind;
  for (const Kind kind :
       {Kind::kFrame, Kind::kArchive, Kind::kFile, Kind::kTusCreation, Kind::kTusUpload, Kind::kUpload}) {
    const std::vector<std::string_view> methods = MethodsOf(kind);
    EXPECT_THAT(described[kind], testing::ElementsAreArray(methods)) << static_cast<int>(kind);
  }
}

// Every encoding that a frame's file can have is one that the description names.
TEST(OpenApiFiles, FramesHaveTheirFormats) {
  std::set<std::string> formats;
  const nlohmann::ordered_json files = FileRoutesOfOpenApi();
  for (const auto& format : files["components"]["parameters"]["format"]["schema"]["enum"]) {
    formats.insert(format);
    EXPECT_TRUE(MatchFileRoute({"v1", "jobs", "j", "outputs", "o", "frames", "7." + std::string(format)}));
  }
  for (const v1::Encoding encoding :
       {v1::ENCODING_PNG, v1::ENCODING_JPEG, v1::ENCODING_NPZ, v1::ENCODING_FLO, v1::ENCODING_PFM}) {
    EXPECT_EQ(formats.count(std::string(ExtensionOf(encoding).substr(1))), 1U);
  }
}

}  // namespace
}  // namespace depthtween::server
