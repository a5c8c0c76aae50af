// What a process that decodes files of strangers gives up before it opens the first: if a file takes it over, there is
// little it can do.
//
//   system calls   (seccomp) no sockets, no new programs or processes, no look into or signal to other processes, no
//                  mounts, namespaces, keys, clocks, kernel modules, io_uring; no change of owners and modes. They fail
//                  with EPERM. A list of what is denied: what is allowed differs with every version of the C library.
//   files          (Landlock) reads what it was told to, and what the system's libraries read; writes where it was told
//                  to; nothing else. No signals to processes outside (Linux 6.12).
//   privileges     no program that it could start would gain any; of a process of root, all capabilities go.
//
// What the kernel lacks is left out, without an error: SupportedSandbox says what there is.
#ifndef DEPTHTWEEN_CORE_SANDBOX_SANDBOX_H_
#define DEPTHTWEEN_CORE_SANDBOX_SANDBOX_H_

#include <string>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

struct SandboxPaths {
  std::vector<std::string> read;   // files, or folders with all below; what does not exist is passed over
  std::vector<std::string> write;  // folders: reads, makes, changes, renames and removes all below
};

// For the rest of this process's life; open descriptors stay. Call it before there are other threads: it holds for the
// calling thread and those it starts. Errors: Internal when the kernel has a part and refuses it; NotFound for a folder
// to write to that is not there.
absl::Status EnterSandbox(const SandboxPaths& paths);

struct SandboxSupport {
  bool system_calls = false;
  bool files = false;
};
// Of this kernel, as far as it lets this process know. Nothing in a build with sanitizers, which start processes and
// write where they please.
SandboxSupport SupportedSandbox();

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SANDBOX_SANDBOX_H_
