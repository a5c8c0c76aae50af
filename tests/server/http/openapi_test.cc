// The description against the descriptors it is made from, and against the rules of OpenAPI 3.1 that clients'
// generators rely on: every $ref leads somewhere, operation ids are unique, every {name} of a path is a parameter.
#include "server/http/openapi.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <nlohmann/json.hpp>
#include <set>

#include "server/http/api.h"

namespace depthtween::server {
namespace {

using testing::HasSubstr;
using Json = nlohmann::json;

const Json& Document() {
  static const Json document = [] {
    const auto api = CommentedApi::Load();
    EXPECT_TRUE(api.ok()) << api.status();
    return Json::parse(OpenApiDocument((*api)->files(), "1.2.3"));
  }();
  return document;
}

TEST(OpenApi, EveryMethodIsAnOperation) {
  EXPECT_EQ(Document()["openapi"], "3.1.0");
  EXPECT_EQ(Document()["info"]["version"], "1.2.3");
  std::set<std::string> ids;
  for (const auto& [path, operations] : Document()["paths"].items()) {
    for (const auto& [verb, operation] : operations.items()) {
      EXPECT_TRUE(ids.insert(operation["operationId"]).second) << operation["operationId"];
      std::set<std::string> in_path;
      for (const Json& given : operation.value("parameters", Json::array())) {
        const Json& parameter =
            given.contains("$ref") ? Document()[Json::json_pointer(std::string(given["$ref"]).substr(1))] : given;
        if (parameter["in"] == "path") in_path.insert("{" + std::string(parameter["name"]) + "}");
      }
      for (const std::string& name : in_path) EXPECT_THAT(path, HasSubstr(name));
      EXPECT_EQ(std::count(path.begin(), path.end(), '{'), static_cast<long>(in_path.size())) << path;
    }
  }
  for (const ApiMethod& method : ApiMethods(ApiFiles())) {
    EXPECT_EQ(ids.count(method.descriptor->service()->name() + "_" + method.descriptor->name()), 1U) << method.rpc;
  }
}

// The probes are for balancers, which have no token; what the server counts tells of all tenants.
TEST(OpenApi, OnlyProbesAreOpen) {
  const Json& paths = Document()["paths"];
  EXPECT_TRUE(paths["/readyz"]["get"]["security"].empty());
  EXPECT_TRUE(paths["/readyz"]["get"].contains("security"));
  EXPECT_EQ(paths["/metrics"]["get"]["security"], Json::parse(R"([{"bearer": ["admin"]}])"));
  EXPECT_FALSE(Document()["security"].empty());
}

TEST(OpenApi, EveryReferenceLeadsSomewhere) {
  int references = 0;
  const std::function<void(const Json&)> visit = [&](const Json& json) {
    if (json.is_object() && json.contains("$ref")) {
      ++references;
      EXPECT_TRUE(Document().contains(Json::json_pointer(std::string(json["$ref"]).substr(1)))) << json["$ref"];
    }
    if (json.is_structured()) {
      for (const auto& item : json) visit(item);
    }
  };
  visit(Document());
  EXPECT_GT(references, 50);
}

TEST(OpenApi, SaysWhatTheProtoSays) {
  const Json& watch = Document()["paths"]["/v1/jobs/{job}:watch"]["get"];
  EXPECT_THAT(std::string(watch["description"]), HasSubstr("First a snapshot"));
  EXPECT_TRUE(watch["responses"]["200"]["content"].contains("text/event-stream"));
  EXPECT_EQ(watch["responses"]["default"]["content"]["application/json"]["schema"]["$ref"],
            "#/components/schemas/google.rpc.Status");
  const Json& job = Document()["components"]["schemas"]["Job"];
  EXPECT_EQ(job["required"], Json::array({"sequence"}));
  EXPECT_EQ(job["properties"]["state"]["readOnly"], true);
  EXPECT_THAT(std::string(job["properties"]["displayName"]["description"]), HasSubstr("200 bytes"));
  EXPECT_EQ(job["properties"]["createTime"]["format"], "date-time");
  EXPECT_EQ(Document()["components"]["schemas"]["Job.State"]["enum"][1], "STATE_QUEUED");
  EXPECT_EQ(Document()["components"]["securitySchemes"]["bearer"]["scheme"], "bearer");
  EXPECT_EQ(Document()["security"], Json::parse(R"([{"bearer": []}])"));
  EXPECT_EQ(watch["security"], Json::parse(R"([{"bearer": ["read"]}, {"signature": []}])")) << "a signed link opens it";
  EXPECT_EQ(Document()["paths"]["/v1/jobs/{job}:cancel"]["post"]["security"],
            Json::parse(R"([{"bearer": ["write"]}])"));
  const Json& create = Document()["paths"]["/v1/jobs"]["post"];
  EXPECT_EQ(create["requestBody"]["content"]["application/json"]["schema"]["$ref"], "#/components/schemas/Job");
  EXPECT_EQ(create["tags"], Json::array({"JobService"}));
}

}  // namespace
}  // namespace depthtween::server
