// sync as a program: what a user sees of it. The recordings are too short for a clock, which is all they need to be:
// what is measured in longer ones is tested in core/capture.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "core/io/file.h"
#include "tests/core/tools/tool_process.h"
#include "tests/support/temporary_folder.h"

namespace depthtween::tools {
namespace {

using testing::HasSubstr;

TEST(SyncCommand, SaysWhyNothingCanBeTold) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "clip", 64, 48, 17);
  const ToolResult told = RunTool({"sync", scratch / "clip"});
  EXPECT_EQ(told.exit_code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr("the images do not tell the depth camera's clock: "));
  EXPECT_THAT(told.out, HasSubstr("too few"));

  const ToolResult machine = RunTool({"sync", scratch / "clip", "--json", "--threads", "1"});
  ASSERT_EQ(machine.exit_code, 0) << machine.err;
  const auto json = nlohmann::json::parse(machine.out);
  EXPECT_FALSE(json.at("trusted").get<bool>());
  EXPECT_THAT(json.at("reason").get<std::string>(), HasSubstr("too few"));
  EXPECT_EQ(json.at("offset_sigma_ns"), -1.0) << "unknown";
}

TEST(SyncCommand, UpsamplingKeepsStampsThatCannotBeBettered) {
  const TemporaryFolder scratch;
  WriteTinyRecording(scratch / "clip", 64, 48, 17);
  const ToolResult result = RunTool({"upsample", scratch / "clip", "-o", scratch / "out", "--clock", "estimate"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto report = nlohmann::json::parse(*ReadFile(scratch / "out/report.json"));
  EXPECT_EQ(report.at("clock").at("offset_ns"), 0.0);
  EXPECT_FALSE(report.at("clock").at("estimate").at("trusted").get<bool>());
  EXPECT_THAT(report.at("warnings").dump(), HasSubstr("the stamps are kept"));
}

TEST(SyncCommand, RefusesWhatIsNoRecording) {
  const ToolResult result = RunTool({"sync", "/nowhere"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("/nowhere"));
}

}  // namespace
}  // namespace depthtween::tools
