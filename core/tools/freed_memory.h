// The heap of a program that works for a long time. Libraries leave it to their callers.
#ifndef DEPTHTWEEN_CORE_TOOLS_FREED_MEMORY_H_
#define DEPTHTWEEN_CORE_TOOLS_FREED_MEMORY_H_

#include <malloc.h>

namespace depthtween::tools {

// Gives freed memory back to the system. Fragments of one interval must not become the floor of the next: memory is
// that of an interval, not of a clip.
inline void ReturnFreedMemory() { malloc_trim(0); }

}  // namespace depthtween::tools

#endif  // DEPTHTWEEN_CORE_TOOLS_FREED_MEMORY_H_
