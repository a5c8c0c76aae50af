#include "core/api/make_upsampler.h"

#include <string>

#include "core/baselines/baselines.h"
#include "core/upsample/causal.h"
#include "core/upsample/fill_limit.h"
#include "core/upsample/pipeline.h"

namespace depthtween {

absl::StatusOr<std::unique_ptr<Upsampler>> MakeUpsampler(const UpsampleOptions& options) {
  RETURN_IF_ERROR(Validate(options));
  if (options.method != "ours") return MakeBaseline(options.method);
  ASSIGN_OR_RETURN(PipelineOptions pipeline, PipelineOptions::ForPreset(options.preset));
  for (const std::string& part : options.without) RETURN_IF_ERROR(pipeline.SwitchOff(part));
  for (const std::string& choice : options.literal) RETURN_IF_ERROR(pipeline.solver.TakeLiterally(choice));
  RETURN_IF_ERROR(pipeline.Validate());
  ASSIGN_OR_RETURN(const Fill fill, ParseFill(options.fill));
  return WithFillLimit(options.causal ? MakeCausalUpsampler(pipeline) : MakePipeline(pipeline), fill);
}

}  // namespace depthtween
