// The mark that some editors (Windows' Notepad, PowerShell, Excel) put before text in UTF-8. It is no part of the text.
#ifndef DEPTHTWEEN_CORE_BASE_BYTE_ORDER_MARK_H_
#define DEPTHTWEEN_CORE_BASE_BYTE_ORDER_MARK_H_

#include <string_view>

namespace depthtween {

// `text` without a byte-order mark of UTF-8 at its beginning.
inline std::string_view SkipByteOrderMark(std::string_view text) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (text.starts_with(kMark)) text.remove_prefix(kMark.size());
  return text;
}

// Whether `text` begins with a byte-order mark of UTF-16, so that its bytes are no UTF-8.
inline bool LooksLikeUtf16(std::string_view text) {
  return text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF");
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_BYTE_ORDER_MARK_H_
