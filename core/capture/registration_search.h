// Roughly how far depth edges lie beside those of colour, when that may be many pixels: the registration under which
// most edges meet a change of colour.
#ifndef DEPTHTWEEN_CORE_CAPTURE_REGISTRATION_SEARCH_H_
#define DEPTHTWEEN_CORE_CAPTURE_REGISTRATION_SEARCH_H_

#include <array>
#include <vector>

#include "core/base/image.h"
#include "core/capture/depth_edges.h"
#include "core/sequence/registration.h"

namespace depthtween {

// A depth frame's edges, and how much colour changes in each direction around each place of the frame they are seen in.
class EdgeScene {
 public:
  EdgeScene() = default;
  // Edges beyond `max_edges` are left out evenly.
  EdgeScene(ImageView<const Rgb8> color, const std::vector<DepthEdge>& edges, size_t max_edges);

  // Cells of a few pixels: what a search has to tell apart.
  static int CellPx(int width);
  const std::vector<DepthEdge>& edges() const { return edges_; }
  // The cell of a place, in pixels; one beyond the image for places beyond all reason.
  int CellOf(float px) const;
  // 0 to 1: the contrast across edge e at a cell against that of the places around the edge.
  float Vote(size_t e, int x, int y) const;
  // The same at a place in pixels, interpolated.
  float VoteBetween(size_t e, float x_px, float y_px) const;
  int width() const { return width_; }
  int height() const { return height_; }

 private:
  struct Change {
    float xx = 0.0F, xy = 0.0F, yy = 0.0F;  // of the structure tensor, summed over the channels
    float Across(float nx, float ny) const { return xx * nx * nx + 2 * xy * nx * ny + yy * ny * ny; }
  };
  int width_ = 0, height_ = 0;  // of the image
  float cell_px_ = 1.0F;
  Image<Change> changes_;
  std::vector<DepthEdge> edges_;
  std::vector<float> usual_;  // contrast around each edge
};

struct RegistrationSearch {
  Registration best;         // the identity unless another is better beyond chance
  double met = 0.0;          // mean vote of the edges under `best`
  double met_unmoved = 0.0;  // under the identity
  double best_met = 0.0;     // under what is met best, by chance or not
};

// Shifts up to a twelfth of the image's width, growth by up to 18 %, parallax. `scenes` are of one image size; with
// `reference_m` the depth about which parallax turns. Threads change nothing.
RegistrationSearch SearchRegistration(const std::vector<EdgeScene>& scenes, double reference_m, int threads);

// Edges of depth that belongs to other pictures meet colour less often than this wherever they are put; those that
// belong there, more often.
inline constexpr double kLeastMet = 0.3;

// Mean vote of all edges under `registration`; 0 of none.
double MeanVote(const std::vector<EdgeScene>& scenes, const Registration& registration);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_CAPTURE_REGISTRATION_SEARCH_H_
