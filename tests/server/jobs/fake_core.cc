// Speaks the protocol of `depthtween-core task` without computing anything, and misbehaves when its script says so.
//
// The script is the file "script" of the sequence folder, one "word [number [rest]]" a line:
//   intervals N        the clip has N intervals of two frames (3 if not said)
//   invalid            validate finds a violation
//   crash_at I TIMES   dies by SIGSEGV when it begins interval I, the first TIMES times
//   crash_validate     dies by SIGABRT in validate
//   error_at I CODE    reports that error when it begins interval I
//   babble_at I        reports an error of 50,000 characters when it begins interval I
//   wait_at I          waits at interval I until the sequence folder has a file "go"
//   hang KIND TIMES    a task of that kind, the first TIMES times, says a line and then nothing, and waits to be ended;
//                      KIND: 1 validate, 2 prepare, 3 intervals, 4 assemble, 5 self-check, 6 render
//   suspend KIND TIMES the same, but suspends itself (SIGSTOP)
//   burn KIND          a task of that kind uses processor time for ever, and says so all the time
//   slow_at I          takes a tenth of a second at interval I, in twenty steps that it tells of
//   wait_validate      validate waits until the sequence folder has a file "go"
//   ignore_term        ignores SIGTERM, and so does a process that it starts and leaves behind
//   fill_at I          writes a file of 1 MiB at interval I, reporting RESOURCE_EXHAUSTED if it cannot
//   lie_at I           says that interval I is done without writing its files
//   quit_at I          ends with exit code 0 when it begins interval I
//   reach N            a frame can be rendered when the N frames before and after it are finished (1 if not said)
//   wait_render I      waits when it begins to render interval I until the sequence folder has a file "go"
//   slow_frame         render-frame waits until it is killed
//   moves              renders need motion, and every frame has it
//   lost N WHAT        render-frame misses WHAT of frame N, which was made
//   wait_check         self-check waits until the sequence folder has a file "go"
//   no_check           self-check says that nothing can be measured
//   wait_flow N        assemble waits before it makes scene flow of frame N until the sequence folder has a file "go"
//   slow_plan          plan logs "start PID" and waits until it is killed
//   no_pairs           plan finds no depth for colour frames that scene flow needs
// It appends "start PID\n", "check 1\n", "interval I\n" and "render I\n" to the file "log" of the sequence folder.
//
// Of scene flow it knows the formats npz and kitti, and writes both. Of renders it knows the name alone: one picture a
// frame with the name and the frame's number in it, a video if the options speak of a container, and an error for one
// that is called "bad".
#include <fcntl.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

#include "core/launch/launch.h"

namespace {

std::map<std::string, std::string> options;

struct Order {
  int number = 0;
  std::string rest;
};
std::map<std::string, Order> script;

bool Says(const char* word, int number) { return script.count(word) > 0 && script[word].number == number; }

void Append(const std::string& file, const std::string& text) {
  const int fd = open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
  if (write(fd, text.data(), text.size()) < 0) exit(9);
  close(fd);
}

void WriteFile(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

std::string ReadFile(const std::string& path) {
  std::stringstream content;
  content << std::ifstream(path).rdbuf();
  return content.str();
}

void Tell(const std::string& line) {
  const std::string text = line + "\n";
  if (write(std::stoi(options["--progress-fd"]), text.data(), text.size()) < 0) exit(8);
}

[[noreturn]] void FailWith(const std::string& code, const std::string& message) {
  Tell(R"({"error":{"code":")" + code + R"(","message":")" + message + R"("}})");
  exit(1);
}

void Die(int signal_number) {
  signal(signal_number, SIG_DFL);
  raise(signal_number);
}

std::string Stem(int frame) {
  char text[16];
  snprintf(text, sizeof(text), "%06d", frame);
  return text;
}

// Hangs, suspends itself or burns processor time as the script says.
void Misbehave(const std::string& kind) {
  const std::map<std::string, int> kinds = {{"validate", 1}, {"prepare", 2},    {"intervals", 3},
                                            {"assemble", 4}, {"self-check", 5}, {"render", 6}};
  const auto found = kinds.find(kind);
  if (found == kinds.end()) return;
  while (Says("burn", found->second)) {
    const std::clock_t start = std::clock();
    while (std::clock() - start < CLOCKS_PER_SEC / 100) {
    }
    Tell(R"({"alive":true})");
  }
  for (const char* word : {"hang", "suspend"}) {
    if (!Says(word, found->second)) continue;
    const std::string times = options["--sequence"] + "/" + word + "s";
    if (static_cast<int>(ReadFile(times).size()) >= std::stoi(script[word].rest)) continue;
    Append(times, "x");
    Append(options["--sequence"] + "/log", std::string(word) + " " + std::to_string(getpid()) + "\n");
    Tell(R"({"stage":"hanging about"})");
    if (strcmp(word, "suspend") == 0) raise(SIGSTOP);
    while (true) pause();
  }
}

void Validate() {
  if (script.count("crash_validate") > 0) {
    fputs("about to abort\n", stderr);
    Die(SIGABRT);
  }
  Tell(R"({"checked":1,"of":2})");
  Append(options["--sequence"] + "/log", "validate " + std::to_string(getpid()) + "\n");
  while (script.count("wait_validate") > 0 && access((options["--sequence"] + "/go").c_str(), F_OK) != 0) usleep(1000);
  Tell("this is no JSON");
  const bool ok = script.count("invalid") == 0;
  printf(R"({"ok":%s,"violations":[%s],"warnings":["fake"],
"camera":{"width":4,"height":3,"fx":5,"fy":5,"cx":1.5,"cy":1,"depth_scale":5000},"median_depth_m":1.5,
"color":[{"time_ns":10,"path":"rgb/0.png"},{"time_ns":20,"path":"rgb/1.png"}],"depth":[{"time_ns":10,"path":"depth/0.png"}]})",
         ok ? "true" : "false", ok ? "" : R"({"file":"depth/0.png","code":"DATA_LOSS","message":"cut short"})");
}

void Prepare(int intervals) {
  std::string list, frames;
  for (int i = 0; i < intervals; ++i) {
    list += std::string(i > 0 ? "," : "") + R"({"index":)" + std::to_string(i) + R"(,"first_frame":)" +
            std::to_string(2 * i) + R"(,"frame_count":2,"held":false})";
    for (int frame = 2 * i; frame < 2 * i + 2; ++frame) {
      frames += std::string(frame > 0 ? "," : "") + R"({"index":)" + std::to_string(frame) + R"(,"time_ns":)" +
                std::to_string(1000 * frame) + R"(,"stem":")" + Stem(frame) + "\"}";
    }
  }
  const bool estimate = ReadFile(options["--options"]).find(R"("clock":"estimate")") != std::string::npos;
  const std::string clock = estimate ? R"(,"clock":{"estimate":{"reason":"","reference_ns":10,
"offset_ns":4e6,"offset_sigma_ns":5e4,"drift_ppm":300,"drift_sigma_ppm":20,"stamp_sigma_ns":6e4,"row_time_ns":12000,
"row_time_sigma_ns":-1,"keys":66,"edges":70000}})"
                                     : "";
  WriteFile(options["--constants"], R"({"constants":{"warnings":["a warning"]},"intervals":[)" + list +
                                        R"(],"frames":[)" + frames + "]" + clock + "}");
}

void CheckSelf() {
  Append(options["--sequence"] + "/log", "check 1\n");
  Tell(R"({"stage":"self-check, map 1 of 1"})");
  while (script.count("wait_check") > 0 && access((options["--sequence"] + "/go").c_str(), F_OK) != 0) usleep(1000);
  WriteFile(options["--out"], script.count("no_check") > 0
                                  ? R"({"summary":"no self-check: too short","reason":"too short"})"
                                  : R"({"summary":"it errs by 7 mm","maps_checked":1,"maps_held_out":2,"pixels":12,
"methods":[{"name":"ours","rmse_mm":7,"mae_mm":5,"edge_band_rmse_mm":9,"completeness":0.5,"within_one_sigma":0.25},
{"name":"hold","rmse_mm":70,"mae_mm":50,"completeness":1}],
"worst_frames":[{"frame":3,"stem":"000003","time_ns":3000,"rmse_mm":8}],
"sensor_floor":{"rmse_mm":2,"mae_mm":1},"seconds":0.5})");
}

void ComputeInterval(int interval) {
  const std::string sequence = options["--sequence"], out = options["--out"];
  if (Says("crash_at", interval)) {
    const std::string crashes = sequence + "/crashes";
    if (static_cast<int>(ReadFile(crashes).size()) < std::stoi(script["crash_at"].rest)) {
      Append(crashes, "x");
      Die(SIGSEGV);
    }
  }
  if (Says("error_at", interval)) FailWith(script["error_at"].rest, "as the script says in " + sequence + "/script");
  if (Says("babble_at", interval)) FailWith("FAILED_PRECONDITION", std::string(50'000, 'x'));
  if (Says("quit_at", interval)) exit(0);
  while (Says("wait_at", interval) && access((sequence + "/go").c_str(), F_OK) != 0) usleep(1000);
  if (Says("fill_at", interval)) {
    const int fd = open((out + "/big").c_str(), O_WRONLY | O_CREAT, 0644);
    const std::string big(1 << 20, 'x');
    if (write(fd, big.data(), big.size()) != static_cast<ssize_t>(big.size()))
      FailWith("RESOURCE_EXHAUSTED", "no room");
    close(fd);
  }
  for (int i = 0; Says("slow_at", interval) && i < 20; ++i) {
    usleep(5000);
    Tell(R"({"alive":true})");
  }
  Tell(R"({"stage":"flow","interval":)" + std::to_string(interval) + "}");
  if (!Says("lie_at", interval)) {
    const bool scene_flow = ReadFile(options["--options"]).find(R"("scene_flow":{)") != std::string::npos;
    const std::map<std::string, std::string> upsampled = {
        {"depth", ".png"}, {"uncertainty", ".png"}, {"provenance", ".png"}};
    const std::map<std::string, std::string> moved = {
        {"sceneflow", ".npz"}, {"kitti/flow", ".png"}, {"kitti/disp_0", ".png"}, {"kitti/disp_1", ".png"}};
    for (const auto& [output, extension] : scene_flow ? moved : upsampled) {
      std::filesystem::create_directories(out + "/" + output);
      for (int frame = 2 * interval; frame < 2 * interval + 2; ++frame) {
        WriteFile(out + "/" + output + "/" + Stem(frame) + extension, output + " " + std::to_string(frame));
      }
    }
  }
  if (script.count("moves") > 0) {
    std::filesystem::create_directories(out + "/motion");
    for (int frame = 2 * interval; frame < 2 * interval + 2; ++frame) {
      WriteFile(out + "/motion/" + Stem(frame) + ".npz", "motion " + std::to_string(frame));
    }
  }
  WriteFile(out + "/interval_" + Stem(interval) + ".json",
            script.count("moves") > 0 ? R"({"motion_frames":2})" : R"({"motion_frames":0})");
  Append(sequence + "/log", "interval " + std::to_string(interval) + "\n");
  Tell(R"({"interval_done":)" + std::to_string(interval) + R"(,"seconds":0.25,"frames":2})");
}

// The values of "name" in the options, with what stands before each: enough for options that tests write.
std::map<std::string, std::string> RenderNames(const std::string& text) {
  std::map<std::string, std::string> names;
  const std::string key = R"("name":")";
  size_t before = 0;
  for (size_t at = text.find(key); at != std::string::npos; at = text.find(key, at + 1)) {
    const size_t begin = at + key.size();
    names[text.substr(begin, text.find('"', begin) - begin)] = text.substr(before, at - before);
    before = at;
  }
  return names;
}

void Plan() {
  if (script.count("slow_plan") > 0) {
    Append(options["--sequence"] + "/log", "start " + std::to_string(getpid()) + "\n");
    while (true) pause();
  }
  if (script.count("no_pairs") > 0 && ReadFile(options["--options"]).find(R"("scene_flow":{)") != std::string::npos)
    FailWith("FAILED_PRECONDITION", "rates differ");
  std::string plans;
  for (const auto& [name, text] : RenderNames(ReadFile(options["--options"]))) {
    if (name == "bad") {
      Tell(
          R"({"error":{"code":"INVALID_ARGUMENT","message":"renders[0].name = bad, must be good","field":"renders[0].name"}})");
      exit(1);
    }
    const int reach = script.count("reach") > 0 ? script["reach"].number : 1;
    plans += std::string(plans.empty() ? "" : ",") + R"({"name":")" + name + R"(","reach_frames":)" +
             std::to_string(reach) + R"(,"anchor_frame":-1,"uses_motion":)" +
             (script.count("moves") > 0 ? "true" : "false") + R"(,"streams":[")" + name +
             R"("],"extension":"png","videos":[)" +
             (text.find("container") == std::string::npos ? "" : "\"" + name + ".mp4\"") + "]}";
  }
  WriteFile(options["--out"], R"({"renders":[)" + plans + "]}");
}

void RenderInterval(int interval, int intervals) {
  const std::string out = options["--out"], name = options["--render"];
  while (Says("wait_render", interval) && access((options["--sequence"] + "/go").c_str(), F_OK) != 0) usleep(1000);
  const int reach = script.count("reach") > 0 ? script["reach"].number : 1;
  for (int frame = 2 * interval - reach; frame < 2 * interval + 2 + reach; ++frame) {
    const std::string depth = options["--result"] + "/depth/" + Stem(frame) + ".png";
    if (frame >= 0 && frame < 2 * intervals && access(depth.c_str(), F_OK) != 0)
      FailWith("FAILED_PRECONDITION", "no " + depth);
  }
  mkdir((out + "/" + name).c_str(), 0755);
  for (int frame = 2 * interval; frame < 2 * interval + 2; ++frame) {
    WriteFile(out + "/" + name + "/" + Stem(frame) + ".png", name + " " + std::to_string(frame));
  }
  WriteFile(out + "/render_" + name + "_" + Stem(interval) + ".json", "{}");
  Append(options["--sequence"] + "/log", "render " + std::to_string(interval) + "\n");
  Tell(R"({"interval_done":)" + std::to_string(interval) + R"(,"seconds":0.5,"frames":2})");
}

// What depthtween-core does in one task.
int RunFakeTask(int argc, const char* const* argv) {
  if (argc < 3 || strcmp(argv[1], "task") != 0) return 2;
  const std::string kind = argv[2];
  for (int i = 3; i + 1 < argc; i += 2) {
    if (strcmp(argv[i], "--keep-motion") == 0) ++i;  // has no value
    options[argv[i]] = argv[i + 1];
  }
  const std::string sequence = options["--sequence"];
  std::istringstream lines(ReadFile(sequence + "/script"));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string word;
    Order order;
    words >> word >> order.number >> order.rest;
    script[word] = order;
  }
  if (script.count("ignore_term") > 0) {
    signal(SIGTERM, SIG_IGN);
    int ends[2];
    if (kind == "intervals" && pipe(ends) == 0) {
      if (fork() == 0) {
        Append(sequence + "/log", "start " + std::to_string(getpid()) + "\n");
        close(ends[0]);
        close(ends[1]);
        while (true) pause();
      }
      // Until it has said so: a short interval must not end before.
      char none;
      close(ends[1]);
      if (read(ends[0], &none, 1) != 0) exit(7);
      close(ends[0]);
    }
  }
  signal(SIGPIPE, SIG_IGN);
  const int intervals = script.count("intervals") > 0 ? script["intervals"].number : 3;
  Misbehave(kind);
  if (kind == "validate") Validate();
  if (kind == "prepare") Prepare(intervals);
  if (kind == "self-check") CheckSelf();
  if (kind == "intervals") {
    Append(sequence + "/log", "start " + std::to_string(getpid()) + "\n");
    const int first = std::stoi(options["--first"]), count = std::stoi(options["--count"]);
    for (int i = first; i < first + count; ++i) ComputeInterval(i);
  }
  if (kind == "plan") Plan();
  if (kind == "render") {
    const int first = std::stoi(options["--first"]), count = std::stoi(options["--count"]);
    for (int i = first; i < first + count; ++i) RenderInterval(i, intervals);
  }
  if (kind == "render-frame") {
    Append(sequence + "/log", "start " + std::to_string(getpid()) + "\n");
    while (script.count("slow_frame") > 0) pause();
    if (RenderNames(ReadFile(options["--options"])).count("bad") > 0) {
      Tell(
          R"({"error":{"code":"INVALID_ARGUMENT","message":"render.name = bad, must be good","field":"render.name"}})");
      exit(1);
    }
    if (script.count("lost") > 0) {
      Tell(R"({"error":{"code":"DATA_LOSS","message":"gone","lost":{"what":")" + script["lost"].rest + R"(","frame":)" +
           std::to_string(script["lost"].number) + "}}}");
      exit(1);
    }
    WriteFile(options["--out"], "picture " + options["--frame"] + " " + ReadFile(options["--options"]));
  }
  if (kind == "assemble") {
    const std::string out = options["--out"];
    const std::map<std::string, std::string> renders = RenderNames(ReadFile(options["--options"]));
    for (int i = 0; i < intervals; ++i) {
      if (access((out + "/interval_" + Stem(i) + ".json").c_str(), F_OK) != 0)
        FailWith("FAILED_PRECONDITION", "incomplete");
      for (const auto& [name, text] : renders) {
        if (access((out + "/render_" + name + "_" + Stem(i) + ".json").c_str(), F_OK) != 0)
          FailWith("FAILED_PRECONDITION", "incomplete pictures");
      }
    }
    for (const auto& [name, text] : renders) {
      if (text.find("container") != std::string::npos) WriteFile(out + "/" + name + ".mp4", "video of " + name);
    }
    if (ReadFile(options["--options"]).find(R"("scene_flow":true)") != std::string::npos) {
      for (int frame = 0; frame + 1 < 2 * intervals; ++frame) {
        Tell(R"({"stage":"scene flow, frame )" + std::to_string(frame) + " of " + std::to_string(2 * intervals - 1) +
             "\"}");
        while (Says("wait_flow", frame) && access((sequence + "/go").c_str(), F_OK) != 0) usleep(1000);
        WriteFile(out + "/sceneflow/" + Stem(frame) + ".npz", "scene flow " + std::to_string(frame));
      }
    }
    const bool checked = options.count("--self-check") > 0;
    WriteFile(out + "/report.json",
              ReadFile(options["--options"]) + (checked ? ReadFile(options["--self-check"]) : ""));
    WriteFile(out + "/preview.png", "preview");
    WriteFile(out + "/depth.txt", "");
    WriteFile(out + "/camera.json", "{}");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && strcmp(argv[1], depthtween::kHostCommand) == 0) {
    depthtween::HostTasks(depthtween::kProgressFd, RunFakeTask);
    return 0;
  }
  return RunFakeTask(argc, argv);
}
