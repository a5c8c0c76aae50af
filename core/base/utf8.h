// Whether bytes are text in UTF-8: what lists, names and messages must be.
#ifndef DEPTHTWEEN_CORE_BASE_UTF8_H_
#define DEPTHTWEEN_CORE_BASE_UTF8_H_

#include <string_view>

namespace depthtween {

// Well-formed UTF-8 as Unicode's table 3-7 has it: no overlong forms, no surrogates, nothing past U+10FFFF.
bool IsUtf8(std::string_view text);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_UTF8_H_
