// What a server does with documents that it does not understand. Canonical texts are written by hand: stored jobs are
// recognised by them, so a change of one is a change of the format.
#include "core/options/job_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/options/field_error.h"

namespace depthtween {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

std::string Canonical(JobKind kind, const char* document) {
  const auto canonical = CanonicalJobOptions(kind, document, "job.options");
  EXPECT_TRUE(canonical.ok()) << canonical.status();
  return canonical.value_or("");
}

TEST(JobOptions, WhatIsLeftOutIsFilledIn) {
  EXPECT_EQ(Canonical(JobKind::kUpsample, "{}"),
            R"({"causal":false,"clock":"stamps","fill":"near","key_every":1,"literal":[],"method":"ours",)"
            R"("preset":"balanced","register":"none","scene_flow":false,"self_check":false,"without":[]})");
  EXPECT_EQ(Canonical(JobKind::kSceneFlow, "{}"), R"({"baseline_m":0.1,"every":1,"formats":["npz"],"method":"ours"})");
}

// A request that is sent again must be recognised, however its document is written.
TEST(JobOptions, TheSameOrderHasTheSameText) {
  EXPECT_EQ(Canonical(JobKind::kUpsample, R"({"preset": "fast", "key_every": 1})"),
            Canonical(JobKind::kUpsample, R"({"method": "ours", "preset": "fast"})"));
  EXPECT_EQ(Canonical(JobKind::kSceneFlow, R"({"formats": ["kitti", "npz", "kitti"], "baseline_m": 1})"),
            Canonical(JobKind::kSceneFlow, R"({"formats": ["kitti"], "baseline_m": 1.0})"));
  EXPECT_EQ(Canonical(JobKind::kUpsample, R"({"without": ["median", "settle", "median"]})"),
            Canonical(JobKind::kUpsample, R"({"without": ["median", "settle"]})"));
}

TEST(JobOptions, ErrorsNameThePathTheClientKnows) {
  const auto field = [](JobKind kind, const char* document) {
    return FieldOf(CanonicalJobOptions(kind, document, "job.options").status());
  };
  EXPECT_EQ(field(JobKind::kUpsample, "{"), "job.options");
  EXPECT_EQ(field(JobKind::kUpsample, "[]"), "job.options");
  EXPECT_EQ(field(JobKind::kUpsample, R"({"preset":"turbo"})"), "job.options.preset");
  EXPECT_EQ(field(JobKind::kSceneFlow, R"({"every":0})"), "job.options.every");
  EXPECT_EQ(field(JobKind::kSceneFlow, R"({"formats":[]})"), "job.options.formats");
  EXPECT_EQ(field(JobKind::kSceneFlow, R"({"preset":"fast"})"), "job.options.preset");
}

TEST(JobOptions, FactsFollow) {
  const auto facts = [](JobKind kind, const char* document) { return FactsOfJob(kind, Canonical(kind, document)); };
  const auto folders = [](const JobFacts& of) {
    std::vector<std::string> names;
    for (const FrameFiles& files : of.outputs) names.push_back(files.folder);
    return names;
  };
  const auto plain = facts(JobKind::kUpsample, "{}");
  ASSERT_TRUE(plain.ok());
  EXPECT_FALSE(plain->self_check || plain->keep_motion);
  EXPECT_THAT(folders(*plain), IsEmpty());
  const auto full = facts(JobKind::kUpsample, R"({"self_check":true,"scene_flow":true})");
  ASSERT_TRUE(full.ok());
  EXPECT_TRUE(full->self_check && full->keep_motion);
  EXPECT_THAT(folders(*full), ElementsAre("sceneflow"));
  const auto flow = facts(JobKind::kSceneFlow, R"({"formats":["flo"]})");
  ASSERT_TRUE(flow.ok());
  EXPECT_THAT(folders(*flow), ElementsAre("sceneflow", "flow", "depth_change"));
  EXPECT_TRUE(absl::IsDataLoss(FactsOfJob(JobKind::kUpsample, "{").status()));
  EXPECT_TRUE(absl::IsDataLoss(FactsOfJob(JobKind::kUpsample, R"({"preset":"turbo"})").status()));
}

TEST(JobOptions, DepthIsTheSameButForWhatStandsBesideIt) {
  const std::string plain = Canonical(JobKind::kUpsample, "{}");
  EXPECT_TRUE(GiveSameDepth(plain, Canonical(JobKind::kUpsample, R"({"self_check":true,"scene_flow":true})")));
  EXPECT_FALSE(GiveSameDepth(plain, Canonical(JobKind::kUpsample, R"({"preset":"fast"})")));
  EXPECT_FALSE(GiveSameDepth(plain, Canonical(JobKind::kUpsample, R"({"clock":"index"})")));
}

}  // namespace
}  // namespace depthtween
