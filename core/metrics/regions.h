// The parts of a frame over which errors are quoted apart, and where a truth map has edges.
//
// Units: depth in metres along z, 0 = unknown. Masks: W x H, nonzero = inside.
// Threads: all functions are pure; safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_METRICS_REGIONS_H_
#define DEPTHTWEEN_CORE_METRICS_REGIONS_H_

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "core/base/image.h"

namespace depthtween {

enum class Region { kAll, kEdgeBand, kInterior, kMoving, kFast, kStatic, kDisoccluded, kUntextured };
inline constexpr std::array kRegions = {Region::kAll,  Region::kEdgeBand, Region::kInterior,    Region::kMoving,
                                        Region::kFast, Region::kStatic,   Region::kDisoccluded, Region::kUntextured};
// "all", "edge_band", ...: the names used in reports.
std::string_view RegionName(Region region);

inline constexpr float kEdgeJumpM = 0.15F;  // between 3x3 neighbours: what counts as a depth edge
inline constexpr int kEdgeBandPx = 4;       // the band reaches this far from a jump
inline constexpr float kMovingPx = 0.25F;   // true motion per colour frame above which a pixel moves
inline constexpr float kFastPx = 4.0F;      // and above which it is fast: 32 px over 8 frames
inline constexpr float kUntexturedLevels =
    3.0F;                                       // standard deviation of luma: above the noise of a good camera, of 1-2
inline constexpr int kTextureRadiusPx = 4;      // in a square window of this radius
inline constexpr float kFarthestTruthM = 8.0F;  // truth beyond is not scored unless asked for: depth sensors end there

// Pixels in whose 3x3 window known depths differ by more than kEdgeJumpM. A jump across a hole of one pixel counts:
// real sensors rarely see both sides of an edge side by side.
Image<uint8_t> DepthJumps(ImageView<const float> depth_m);

// Pixels on the nearer side of a jump to a known 3x3 neighbour: outlines, one pixel wide.
Image<uint8_t> Silhouettes(ImageView<const float> depth_m);

// Pixels at most `radius` pixels from a pixel of the mask: Euclidean distance, or along rows and columns (a square).
Image<uint8_t> DilateDisc(ImageView<const uint8_t> mask, int radius);
Image<uint8_t> DilateSquare(ImageView<const uint8_t> mask, int radius);

// Within kEdgeBandPx of a jump, Euclidean distance.
Image<uint8_t> EdgeBand(ImageView<const float> depth_m);

// Pixels around which luma varies by less than kUntexturedLevels: nothing there for motion to hold on to.
Image<uint8_t> Untextured(ImageView<const Rgb8> color);

// True motion to the next colour frame.
struct TrueMotion {
  ImageView<const Flow2> flow_px;
  ImageView<const uint8_t> valid;           // nonzero: flow_px is known
  ImageView<const uint8_t> hidden_in_next;  // nonzero: hidden or outside in the next frame; empty: not known
};

// Follows every pixel of a key through true motion, to tell what the key could not see.
// Grammar of use:  (Restart Mask? (Advance Mask?)*)*
class KeyVisibility {
 public:
  // The current frame is a key: all of it is seen.
  void Restart(int width, int height);
  // On to the next frame. `motion` is that of the current frame, of the size given to Restart, with hidden_in_next.
  void Advance(const TrueMotion& motion);
  // False before Restart.
  bool Started() const { return !alive_.empty(); }
  // Pixels of the current frame that the key did not see. Single lines of pixels between seen ones count as seen: they
  // are where a surface grew, not where one came out from behind another.
  Image<uint8_t> Unseen() const;

 private:
  Image<Flow2> position_;  // of each key pixel in the current frame
  Image<uint8_t> alive_;   // 0: became hidden, or its motion is unknown
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_METRICS_REGIONS_H_
