#include "core/sandbox/sandbox.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/capability.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "core/base/descriptor.h"

namespace depthtween {
namespace {

// ---- system calls ----

// Those that no task needs. Some are of one architecture, some newer than the headers this may be compiled with.
constexpr auto kDeniedCalls = std::to_array<uint32_t>({
    // the network, and sockets of any kind
    SYS_socket,
    SYS_socketpair,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_accept,
    SYS_accept4,
    SYS_sendto,
    SYS_sendmsg,
    SYS_sendmmsg,
    SYS_recvfrom,
    SYS_recvmsg,
    SYS_recvmmsg,
    SYS_setsockopt,
    // new programs
    SYS_execve,
    SYS_execveat,
    // other processes
    SYS_tkill,
    SYS_rt_sigqueueinfo,
    SYS_rt_tgsigqueueinfo,
    SYS_pidfd_open,
    SYS_pidfd_send_signal,
    SYS_pidfd_getfd,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_process_madvise,
    SYS_kcmp,
    SYS_setpgid,
    SYS_setsid,
    SYS_ioprio_set,
    SYS_ptrace,
    // mounts and namespaces
    SYS_mount,
    SYS_umount2,
    SYS_pivot_root,
    SYS_chroot,
    SYS_unshare,
    SYS_setns,
    SYS_open_tree,
    SYS_move_mount,
    SYS_fsopen,
    SYS_fsconfig,
    SYS_fsmount,
    SYS_fspick,
    SYS_mount_setattr,
    SYS_open_by_handle_at,
    SYS_name_to_handle_at,
    SYS_swapon,
    SYS_swapoff,
    SYS_quotactl,
    SYS_quotactl_fd,
    // owners, modes and attributes, which Landlock leaves alone
    SYS_fchmod,
    SYS_fchmodat,
    SYS_fchown,
    SYS_fchownat,
    SYS_setxattr,
    SYS_lsetxattr,
    SYS_fsetxattr,
    SYS_removexattr,
    SYS_lremovexattr,
    SYS_fremovexattr,
    SYS_utimensat,
    SYS_mknodat,
    // the kernel itself
    SYS_bpf,
    SYS_perf_event_open,
    SYS_userfaultfd,
    SYS_io_uring_setup,
    SYS_io_uring_enter,
    SYS_io_uring_register,
    SYS_add_key,
    SYS_request_key,
    SYS_keyctl,
    SYS_init_module,
    SYS_finit_module,
    SYS_delete_module,
    SYS_kexec_load,
    SYS_reboot,
    SYS_acct,
    SYS_syslog,
    SYS_settimeofday,
    SYS_clock_settime,
    SYS_clock_adjtime,
    SYS_adjtimex,
    SYS_sethostname,
    SYS_setdomainname,
    SYS_personality,
    SYS_vhangup,
    SYS_fanotify_init,
    SYS_lookup_dcookie,
    SYS_mbind,
    SYS_migrate_pages,
    SYS_move_pages,
    // identities
    SYS_setuid,
    SYS_setgid,
    SYS_setreuid,
    SYS_setregid,
    SYS_setresuid,
    SYS_setresgid,
    SYS_setfsuid,
    SYS_setfsgid,
    SYS_setgroups,
    SYS_capset,
#ifdef __x86_64__
    SYS_chmod,
    SYS_chown,
    SYS_lchown,
    SYS_utime,
    SYS_utimes,
    SYS_futimesat,
    SYS_mknod,
    SYS_fork,
    SYS_vfork,
    SYS_ioperm,
    SYS_iopl,
    SYS_modify_ldt,
    SYS_uselib,
    SYS_ustat,
    SYS_sysfs,
    SYS_kexec_file_load,
#endif
});

#if defined(__x86_64__)
constexpr uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#else
#error "name the architecture as the kernel's linux/audit.h does"
#endif

constexpr uint32_t kDeny = SECCOMP_RET_ERRNO | EPERM;

sock_filter Load(size_t offset) { return BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<uint32_t>(offset)); }
sock_filter Return(uint32_t verdict) { return BPF_STMT(BPF_RET | BPF_K, verdict); }
// Skips so many instructions when what was loaded is, or is not, `value`.
sock_filter SkipIfEqual(uint32_t value, uint8_t count) { return BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, count, 0); }
sock_filter SkipUnlessEqual(uint32_t value, uint8_t count) {
  return BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, count);
}

// The lower half of an argument; both architectures are little-endian.
size_t Argument(int index) { return offsetof(seccomp_data, args) + sizeof(uint64_t) * static_cast<size_t>(index); }

std::vector<sock_filter> CallFilter() {
  std::vector<sock_filter> filter = {
      // Numbers mean other calls in the 32-bit mode of the same processor.
      Load(offsetof(seccomp_data, arch)),
      SkipIfEqual(kArchitecture, 1),
      Return(SECCOMP_RET_KILL_PROCESS),
      Load(offsetof(seccomp_data, nr)),
#ifdef __x86_64__
      // The x32 mode has the same calls under other numbers.
      BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, 0x40000000U, 0, 1),
      Return(SECCOMP_RET_KILL_PROCESS),
#endif
  };
  for (const uint32_t call : kDeniedCalls) {
    filter.push_back(SkipUnlessEqual(call, 1));
    filter.push_back(Return(kDeny));
  }
  const auto self = static_cast<uint32_t>(getpid());
  // kill and tgkill reach this process alone.
  for (const uint32_t call : {SYS_kill, SYS_tgkill}) {
    filter.insert(filter.end(), {SkipUnlessEqual(call, 4), Load(Argument(0)), SkipIfEqual(self, 1), Return(kDeny),
                                 Return(SECCOMP_RET_ALLOW)});
  }
  // Limits of this process alone: 0 is another name for it.
  filter.insert(filter.end(), {SkipUnlessEqual(SYS_prlimit64, 5), Load(Argument(0)), SkipIfEqual(self, 2),
                               SkipIfEqual(0, 1), Return(kDeny), Return(SECCOMP_RET_ALLOW)});
  // Threads but no processes. The flags of clone3 are out of a filter's sight; without it the C library uses clone.
  filter.insert(filter.end(),
                {SkipUnlessEqual(SYS_clone3, 1), Return(SECCOMP_RET_ERRNO | ENOSYS), SkipUnlessEqual(SYS_clone, 4),
                 Load(Argument(0)), BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, CLONE_THREAD, 1, 0), Return(kDeny),
                 Return(SECCOMP_RET_ALLOW)});
  filter.push_back(Return(SECCOMP_RET_ALLOW));
  return filter;
}

absl::Status LimitSystemCalls() {
  std::vector<sock_filter> filter = CallFilter();
  const sock_fprog program{.len = static_cast<uint16_t>(filter.size()), .filter = filter.data()};
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) return ErrnoStatus(errno, "seccomp");
  return absl::OkStatus();
}

// ---- files ----

// As in linux/landlock.h of Linux 6.12, of which older headers have a part.
struct LandlockRules {
  uint64_t files = 0, network = 0, scoped = 0;
};
constexpr uint64_t kRefer = 1 << 13, kTruncate = 1 << 14, kDevices = 1 << 15;
constexpr uint64_t kAllNetwork = 3, kAllScopes = 3;
constexpr uint64_t kReadFile = LANDLOCK_ACCESS_FS_READ_FILE;
constexpr uint64_t kRead = kReadFile | LANDLOCK_ACCESS_FS_READ_DIR;
constexpr uint64_t kWrite = kRead | LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR |
                            LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG |
                            kRefer | kTruncate;
constexpr uint64_t kFirstRights = (1 << 13) - 1;  // of the first version

// What libraries read by themselves: how many processors there are and which, other libraries, time zones.
constexpr std::array kSystemPaths = {
    "/proc/self",       "/proc/cpuinfo",  "/proc/meminfo", "/proc/stat", "/proc/sys/vm", "/sys/devices/system",
    "/sys/fs/cgroup",   "/sys/kernel/mm", "/usr/lib",      "/lib",       "/lib64",       "/usr/share/zoneinfo",
    "/etc/ld.so.cache", "/etc/localtime", "/dev/null",     "/dev/zero",  "/dev/urandom"};

// The version of the kernel's Landlock; 0 if it has none.
int LandlockVersion() {
  const int64_t version = syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION);
  return version > 0 ? static_cast<int>(version) : 0;
}

// NotFound if there is no such path.
absl::Status AllowBelow(const Descriptor& rules, const std::string& path, uint64_t rights) {
  const Descriptor target(open(path.c_str(), O_PATH | O_CLOEXEC));
  struct stat facts {};
  if (!target.valid() || fstat(target.get(), &facts) != 0) return ErrnoStatus(errno, path);
  // A file has no right that is about the entries of a folder.
  if (!S_ISDIR(facts.st_mode)) rights &= kReadFile | LANDLOCK_ACCESS_FS_WRITE_FILE | kTruncate;
  const landlock_path_beneath_attr rule{.allowed_access = rights, .parent_fd = target.get()};
  if (syscall(SYS_landlock_add_rule, rules.get(), LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0) {
    return ErrnoStatus(errno, "Landlock, " + path);
  }
  return absl::OkStatus();
}

absl::Status LimitFiles(const SandboxPaths& paths) {
  const int version = LandlockVersion();
  LandlockRules handled{.files = kFirstRights};
  if (version >= 2) handled.files |= kRefer;
  if (version >= 3) handled.files |= kTruncate;
  if (version >= 4) handled.network = kAllNetwork;
  if (version >= 5) handled.files |= kDevices;
  if (version >= 6) handled.scoped = kAllScopes;
  const Descriptor rules(static_cast<int>(syscall(SYS_landlock_create_ruleset, &handled, sizeof(handled), 0)));
  if (!rules.valid()) return ErrnoStatus(errno, "Landlock");
  for (const std::string& folder : paths.write) {
    RETURN_IF_ERROR(AllowBelow(rules, folder, kWrite & handled.files));
  }
  std::vector<std::string> readable(kSystemPaths.begin(), kSystemPaths.end());
  readable.insert(readable.end(), paths.read.begin(), paths.read.end());
  for (const std::string& path : readable) {
    // What is not there, or hidden from this process anyhow, needs no rule.
    const absl::Status allowed = AllowBelow(rules, path, kRead);
    if (!allowed.ok() && !absl::IsNotFound(allowed) && !absl::IsPermissionDenied(allowed)) return allowed;
  }
  if (syscall(SYS_landlock_restrict_self, rules.get(), 0) != 0) return ErrnoStatus(errno, "Landlock");
  return absl::OkStatus();
}

// ---- privileges ----

// Of a process that has none, these change nothing.
void DropCapabilities() {
  for (int capability = 0; prctl(PR_CAPBSET_READ, capability, 0, 0, 0) >= 0; ++capability) {
    prctl(PR_CAPBSET_DROP, capability, 0, 0, 0);
  }
  __user_cap_header_struct header{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  std::array<__user_cap_data_struct, 2> none{};
  syscall(SYS_capset, &header, none.data());
}

}  // namespace

absl::Status EnterSandbox(const SandboxPaths& paths) {
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return ErrnoStatus(errno, "no_new_privs");
  const SandboxSupport support = SupportedSandbox();
  if (support.files) RETURN_IF_ERROR(LimitFiles(paths));
  DropCapabilities();
  return support.system_calls ? LimitSystemCalls() : absl::OkStatus();
}

SandboxSupport SupportedSandbox() {
#ifdef DEPTHTWEEN_SANITIZED
  return {};
#endif
  uint32_t action = SECCOMP_RET_ERRNO;
  return {.system_calls = syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0,
          .files = LandlockVersion() > 0};
}

}  // namespace depthtween
