// The options of renders that are plain values, for flags and help. The document that they are part of is described in
// core/session/render_options.h, which also checks what needs more than a word or a type.
#ifndef DEPTHTWEEN_CORE_OPTIONS_RENDER_OPTION_LIST_H_
#define DEPTHTWEEN_CORE_OPTIONS_RENDER_OPTION_LIST_H_

#include <string>
#include <vector>

#include "core/options/option.h"

namespace depthtween {

const std::vector<OptionSpec>& DepthOfFieldOptionSpecs();
const std::vector<OptionSpec>& StereoOptionSpecs();

const std::vector<std::string>& FrameFormatWords();
const std::vector<std::string>& FocusEasingWords();

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_OPTIONS_RENDER_OPTION_LIST_H_
