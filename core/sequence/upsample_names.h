// The words by which an upsampling is asked for. They lie here, below all that computes, because a server that only
// passes orders on has to know them too.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_UPSAMPLE_NAMES_H_
#define DEPTHTWEEN_CORE_SEQUENCE_UPSAMPLE_NAMES_H_

#include <string>
#include <vector>

namespace depthtween {

// "ours" and the baselines.
const std::vector<std::string>& UpsampleMethods();
// All baselines, in the order that tables show them. MakeBaseline (core/baselines) knows each.
const std::vector<std::string>& BaselineNames();

// Of method "ours": from the fastest on, "fast", "balanced" (the default), "best"; "reference" solves as the paper
// does, to compare with.
// PipelineOptions::ForPreset (core/upsample) knows each.
const std::vector<std::string>& PresetNames();
// The stages of method "ours" that one can do without, and the terms and detectors of its joint optimisation.
// PipelineOptions::SwitchOff knows each.
const std::vector<std::string>& PartNames();
// Choices of the paper that preset "reference" can take as printed. SolveOptions::TakeLiterally (core/solve) knows
// each.
const std::vector<std::string>& LiteralNames();

// More threads than this nobody may ask for, locally or of a server.
inline constexpr int kMaxThreads = 1024;

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_UPSAMPLE_NAMES_H_
