// Orders as messages. The list of options is the truth: each must have a field of its name in the message, or a job
// would silently run with the default.
#include "client/cli/order.h"

#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <set>
#include <string>

#include "core/options/render_option_list.h"
#include "core/options/scene_flow_options.h"
#include "core/options/upsample_options.h"

namespace depthtween::cli {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using nlohmann::json;

bool Carries(const FieldDescriptor& field, OptionType type) {
  switch (type) {
    case OptionType::kFlag:
      return field.type() == FieldDescriptor::TYPE_BOOL;
    case OptionType::kInteger:  // 64 bits would be strings in JSON
      return field.type() == FieldDescriptor::TYPE_INT32;
    case OptionType::kNumber:
      return field.type() == FieldDescriptor::TYPE_DOUBLE;
    case OptionType::kWord:
    case OptionType::kText:
    case OptionType::kWords:
      return field.type() == FieldDescriptor::TYPE_STRING && field.is_repeated() == (type == OptionType::kWords);
  }
  return false;
}

void ExpectFields(const std::vector<OptionSpec>& specs, const Descriptor& message) {
  ASSERT_FALSE(specs.empty());
  for (const OptionSpec& spec : specs) {
    const FieldDescriptor* const field = message.FindFieldByName(spec.name);
    ASSERT_NE(field, nullptr) << message.full_name() << " lacks " << spec.name;
    EXPECT_TRUE(Carries(*field, spec.type)) << field->full_name();
  }
}

TEST(Order, MessagesHaveAFieldForEachOption) {
  ExpectFields(UpsampleOptionSpecs(), *v1::UpsampleOptions::descriptor());
  EXPECT_EQ(v1::UpsampleOptions::descriptor()->field_count(), static_cast<int>(UpsampleOptionSpecs().size()));
  ExpectFields(SceneFlowOptionSpecs(), *v1::SceneFlowOptions::descriptor());
  EXPECT_EQ(v1::SceneFlowOptions::descriptor()->field_count(), static_cast<int>(SceneFlowOptionSpecs().size()));
  ExpectFields(DepthOfFieldOptionSpecs(), *v1::DepthOfField::descriptor());
  ExpectFields(StereoOptionSpecs(), *v1::Stereo::descriptor());
}

// A message leaves out zeros and empty words, and the document then has the default: where zero is another value than
// the default, the field must tell unset from zero.
TEST(Order, ZerosAreNotLost) {
  for (const auto& [specs, message] : {std::pair(&UpsampleOptionSpecs(), v1::UpsampleOptions::descriptor()),
                                       std::pair(&SceneFlowOptionSpecs(), v1::SceneFlowOptions::descriptor())}) {
    for (const OptionSpec& spec : *specs) {
      const json zero = spec.type == OptionType::kFlag      ? json(false)
                        : spec.type == OptionType::kNumber  ? json(0.0)
                        : spec.type == OptionType::kWords   ? json::array()
                        : spec.type == OptionType::kInteger ? json(0)
                                                            : json("");
      const bool means_another = CheckOption(spec, zero, spec.name).ok() && zero != spec.default_value;
      // Formats must not be empty, by a rule of their own.
      if (!means_another || spec.name == "formats") continue;
      EXPECT_TRUE(message->FindFieldByName(spec.name)->has_presence()) << spec.name;
    }
  }
}

TEST(Order, CarriesWhatWasAskedFor) {
  const auto order = OrderOf(JobKind::kUpsample, {{"preset", "fast"}, {"without", {"draw"}}, {"causal", true}});
  ASSERT_TRUE(order.ok()) << order.status();
  EXPECT_EQ(order->options().preset(), "fast");
  EXPECT_THAT(order->options().without(), testing::ElementsAre("draw"));
  EXPECT_TRUE(order->options().causal());
  EXPECT_TRUE(absl::IsInvalidArgument(OrderOf(JobKind::kSceneFlow, {{"every", 0}}).status()));
}

TEST(Order, CarriesRenders) {
  const RenderFlags flags{.dof = true, .dof_options = {{"fstop", 1.4}, {"focus", {{"depth_m", 2.5}}}}};
  const auto renders = RenderMessagesOf(flags, "mkv");
  ASSERT_TRUE(renders.ok()) << renders.status();
  ASSERT_EQ(renders->size(), 1U);
  EXPECT_EQ(renders->at(0).container(), "mkv");
  EXPECT_EQ(renders->at(0).depth_of_field().fstop(), 1.4);
  EXPECT_EQ(renders->at(0).depth_of_field().focus().depth_m(), 2.5);
  EXPECT_FALSE(renders->at(0).depth_of_field().has_layers()) << "unset is not zero: the server has its own default";
}

}  // namespace
}  // namespace depthtween::cli
