// The levels of the solver: which points take part, what joins them, what the images say of them, and how the motion of
// a coarse level starts the next.
#ifndef DEPTHTWEEN_CORE_SOLVE_LEVEL_H_
#define DEPTHTWEEN_CORE_SOLVE_LEVEL_H_

#include <vector>

#include "core/base/image.h"
#include "core/solve/association.h"
#include "core/solve/energy.h"
#include "core/solve/solve.h"

namespace depthtween {

// What is known of every point of the finest grid, once for all levels.
struct Evidence {
  Image<Triple<float>> point, normal;  // (0, 0, 0) where there is none
  Image<float> jump_weight;            // trust in data by the distance to a depth jump
  // [frame]: where composed flow sees the point, ideal pixels; trust in that flow from the key on.
  std::vector<Image<PixelOf<float>>> track;
  std::vector<Image<float>> visible;
};
Evidence GatherEvidence(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels);

struct Level {
  EnergyData data;
  Image<int32_t> source;  // index of the point on the finest grid, -1 = none
  int spacing = 1;        // grid points of the finest level between neighbours
};

// The finest level first.
std::vector<Image<int32_t>> DecimatePoints(const Evidence& evidence, const DepthNoise& noise, int levels);

Level MakeLevel(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels,
                const Evidence& evidence, Image<int32_t> source, int spacing);

// Motion along the tracks, at the depth of the partner at the end, if there is one there, else of the key.
void StartFromTracks(const SolveProblem& problem, const Evidence& evidence, const PartnerSurface& other,
                     const Level& level, Planes& unknowns);
// Motion of the coarser level: of a point, the mean of what the rigid pieces around say of it, those that lie in its
// surface.
void Prolong(const Level& coarse, const Planes& coarse_unknowns, const Evidence& evidence, const DepthNoise& noise,
             const Level& fine, Planes& fine_unknowns);

// Looks up, along the predicted motion: partners, flow from frame to frame, brightness. Returns how many found a
// partner.
int Associate(const SolveProblem& problem, const SolveOptions& options, const IdealPixels& pixels,
              const Evidence& evidence, const PartnerSurface& other, const Planes& unknowns, Level& level);

// Cuts the edges that the tracks tear, between points with partners whose tracks are trusted. Returns how many.
int CutTorn(const SolveProblem& problem, const IdealPixels& pixels, const Evidence& evidence, Level& level);
// The paper's published form: edges are weighed by how their length changes along tracks to the last frame but one, at
// the key's depth. Returns how many lose more than half.
int WeighTopologyAsPrinted(const Evidence& evidence, Level& level);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_LEVEL_H_
