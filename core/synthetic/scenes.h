// The builders behind MakeScene, one file each. `seed` varies textures, clutter and phases.
#ifndef DEPTHTWEEN_CORE_SYNTHETIC_SCENES_H_
#define DEPTHTWEEN_CORE_SYNTHETIC_SCENES_H_

#include <cstdint>

#include "core/synthetic/scene.h"

namespace depthtween {

void BuildBounce(Scene& scene, uint64_t seed);
void BuildKick(Scene& scene, uint64_t seed);
void BuildCloth(Scene& scene, uint64_t seed);
void BuildTurntable(Scene& scene, uint64_t seed);
void BuildPan(Scene& scene, uint64_t seed);
void BuildStill(Scene& scene, uint64_t seed);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SYNTHETIC_SCENES_H_
