#include "core/tools/tools.h"

#include <malloc.h>

#include <cstdio>
#include <exception>
#include <iostream>
#include <new>
#include <string>

#include "core/flow/one_opencv_thread.h"
#include "core/tools/commands.h"

namespace depthtween::tools {
namespace {

constexpr char kDescription[] =
    "Gives depth video the frame rate of colour video.\n"
    "\n"
    "A recording is a sequence folder: rgb.txt and depth.txt list time-stamped images, camera.json describes the "
    "camera.\n"
    "No recording at hand? These four lines make one, upsample it, measure the result and show it:\n"
    "\n"
    "  depthtween-core synth kick -o /tmp/kick\n"
    "  depthtween-core upsample /tmp/kick -o /tmp/kick_out\n"
    "  depthtween-core evaluate /tmp/kick_out --reference /tmp/kick --baselines\n"
    "  depthtween-core preview /tmp/kick_out -o /tmp/kick.png\n";

// What the processor lacks of what this program was compiled for, or null.
const char* MissingProcessorFeature() {
#if defined(__x86_64__) && defined(__AVX2__)
  __builtin_cpu_init();
  if (!__builtin_cpu_supports("avx2")) return "AVX2";
  if (!__builtin_cpu_supports("fma")) return "FMA";
  if (!__builtin_cpu_supports("bmi2")) return "BMI2";
#endif
  return nullptr;
}

}  // namespace

int ReportStatus(const absl::Status& status) {
  if (status.ok()) return kExitOk;
  std::cerr << "depthtween-core: " << status.message() << std::endl;
  return kExitFailed;
}

void AddThreads(CLI::App& command, int& threads, const char* help) {
  command.add_option("--threads", threads, help)
      ->capture_default_str()
      ->check(CLI::Range(1, kMaxThreads))
      ->type_name("N");
}

int RunProgram(int argc, const char* const* argv, const char* name, const char* description,
               const std::function<void(CLI::App& app, int* exit_code)>& add) {
  // First of all, so that an older processor gets a sentence instead of an illegal instruction. fputs: no iostream code
  // that could itself hold one.
  if (const char* missing = MissingProcessorFeature()) {
    std::fputs(name, stderr);
    std::fputs(": this processor lacks ", stderr);
    std::fputs(missing, stderr);
    std::fputs(
        ", which this build needs (x86-64-v3: Intel Haswell of 2013, AMD Zen of 2017, or later). "
        "Build for this machine with: cmake --preset release -DDEPTHTWEEN_CPU=native\n",
        stderr);
    return kExitFailed;
  }
  const OneOpenCvThread one_thread;
  // Large blocks that are no images (those have memory of their own, core/base/image.h) go back to the system when
  // freed, instead of leaving holes in a heap that grows with the length of the clip.
  mallopt(M_MMAP_THRESHOLD, 64 * 1024);
  // What is smaller comes from one heap: frames are written by threads that come and go, and each heap of theirs would
  // keep its own fragments (400 frames of stereo at 240 x 160: 54 MiB, as 65 frames, instead of 115).
  mallopt(M_ARENA_MAX, 1);

  int exit_code = kExitOk;
  CLI::App app(description, name);
  app.set_version_flag("--version", std::string(name) + " " DEPTHTWEEN_VERSION);
  app.get_formatter()->column_width(34);
  add(app, &exit_code);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kExitOk : kExitUsage;  // --help and --version end parsing too
  } catch (const std::bad_alloc&) {
    return ReportStatus(absl::ResourceExhaustedError("out of memory: use fewer --threads or smaller images"));
  } catch (const std::exception& error) {
    return ReportStatus(absl::InternalError(std::string("unexpected failure, please report it: ") + error.what()));
  }
  return exit_code;
}

int Main(int argc, const char* const* argv) {
  return RunProgram(argc, argv, "depthtween-core", kDescription, [](CLI::App& app, int* exit_code) {
    app.require_subcommand(1);
    AddSynthCommand(app, exit_code);
    AddUpsampleCommand(app, exit_code);
    AddSceneFlowCommand(app, exit_code);
    AddEvaluateCommand(app, exit_code);
    AddPreviewCommand(app, exit_code);
    AddRenderCommand(app, exit_code);
    AddSyncCommand(app, exit_code);
    AddTaskCommand(app, exit_code);
    AddTaskHostCommand(app, Main);
  });
}

}  // namespace depthtween::tools
