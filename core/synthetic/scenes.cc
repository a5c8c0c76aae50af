#include "core/synthetic/scenes.h"

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace depthtween {
namespace {

struct Entry {
  SceneInfo info;
  void (*build)(Scene& scene, uint64_t seed);
};

constexpr Entry kEntries[] = {
    {{"bounce", "balls bounce, squash on the floor and fly past boxes; a racket swings through"}, BuildBounce},
    {{"kick", "a figure kicks a hanging ball; its legs cross, thin bars behind"}, BuildKick},
    {{"cloth", "a flag waves in the wind before a moving curtain; the camera drifts"}, BuildCloth},
    {{"turntable", "objects turn on a stage and hide one another; a windmill with thin vanes"}, BuildTurntable},
    {{"pan", "a hand-held camera sweeps past pillars and chairs while a ball rolls by"}, BuildPan},
    {{"still", "nothing moves: a check that nothing is made up"}, BuildStill},
};

}  // namespace

const std::vector<SceneInfo>& SceneList() {
  static const std::vector<SceneInfo>* const list = [] {
    auto* scenes = new std::vector<SceneInfo>;
    for (const Entry& entry : kEntries) scenes->push_back(entry.info);
    return scenes;
  }();
  return *list;
}

absl::StatusOr<std::unique_ptr<Scene>> MakeScene(std::string_view name, uint64_t seed) {
  for (const Entry& entry : kEntries) {
    if (entry.info.name != name) continue;
    auto scene = std::make_unique<Scene>(std::string(name));
    entry.build(*scene, seed);
    return scene;
  }
  const std::string names =
      absl::StrJoin(kEntries, ", ", [](std::string* out, const Entry& entry) { out->append(entry.info.name); });
  return absl::InvalidArgumentError(absl::StrFormat("scene = '%s', must be one of: %s", std::string(name), names));
}

}  // namespace depthtween
