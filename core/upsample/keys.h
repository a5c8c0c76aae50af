// A key: a depth frame made ready as a source, together with the colour frame it is seen in.
#ifndef DEPTHTWEEN_CORE_UPSAMPLE_KEYS_H_
#define DEPTHTWEEN_CORE_UPSAMPLE_KEYS_H_

#include <stop_token>

#include "core/base/status.h"
#include "core/fill/depth_noise.h"
#include "core/sequence/sequence.h"
#include "core/upsample/match.h"
#include "core/upsample/upsampler.h"

namespace depthtween {

struct Key {
  int64_t time_ns = 0;   // of the depth frame
  int color_index = -1;  // the colour frame nearest to it in time, into Sequence::color
  // How far the depth frame lies from that colour frame, in steps to its neighbour `toward` (index; -1 when it
  // coincides).
  float fraction = 0.0F;
  int toward = -1;
  Image<float> depth_m;   // cleaned and filled, on the colour frame's grid
  Image<float> distance;  // pixels to the nearest measurement, along colour; 0 = measured
  MatchImage image;
};

// A depth frame of the recording without a rim of mixtures (core/fill/mixed_rim.h): how all stages read it.
absl::StatusOr<Image<float>> ReadDepthFrame(const FrameSource& source, int depth_index);

// Which colour frame a depth frame belongs to. (That of a frame stamped within jitter of it: PairDepthWithinJitter.)
Key LocateKey(const Sequence& sequence, int depth_index);

// Moves a depth map that was measured `fraction` of a step after (along `flow_to_neighbour`) the colour frame onto its
// grid: backward, nearest pixel, so that no two surfaces mix.
Image<float> MoveDepthToColorFrame(ImageView<const float> depth_m, ImageView<const Flow2> flow_to_neighbour,
                                   float fraction);

// Cleans and fills `depth_m` along `color` into the key.
void PrepareKey(ImageView<const float> depth_m, ImageView<const Rgb8> color, const DepthNoise& noise, int threads,
                Key& key);

// The frame that a key is seen in shows what the sensor saw, unless the depth frame had to be moved to it: pixels that
// `depth_frame_m`, as it was read, holds are marked as measured. What other depth frames told of the others stays.
void MarkMeasured(const Key& key, ImageView<const float> depth_frame_m, ImageView<Provenance> provenance);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_UPSAMPLE_KEYS_H_
