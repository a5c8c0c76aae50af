// The study of parameters: which numbers of the pipeline are varied, and over which range.
#ifndef DEPTHTWEEN_TESTS_BENCH_PARAMETERS_H_
#define DEPTHTWEEN_TESTS_BENCH_PARAMETERS_H_

#include <string_view>
#include <vector>

#include "core/upsample/pipeline.h"

namespace depthtween {

// A number among the options whose effect is worth knowing.
struct PipelineParameter {
  std::string_view name;
  std::vector<double> studied;  // ascending, valid; the default preset's value is among them
  double (*get)(const PipelineOptions& options);
  void (*set)(PipelineOptions& options, double value);
};
const std::vector<PipelineParameter>& PipelineParameters();

}  // namespace depthtween

#endif  // DEPTHTWEEN_TESTS_BENCH_PARAMETERS_H_
