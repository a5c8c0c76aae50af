// How the two eyes of a stereo picture travel in one: side by side, one above the other, or through coloured glasses.
//
// Threads: safe to call concurrently.
#ifndef DEPTHTWEEN_CORE_RENDER_STEREO_FORMAT_H_
#define DEPTHTWEEN_CORE_RENDER_STEREO_FORMAT_H_

#include <span>
#include <string_view>
#include <vector>

#include "core/base/image.h"
#include "core/base/status.h"
#include "core/render/stereo.h"

namespace depthtween {

enum class StereoFormat {
  kFullSbs,            // left eye left, right eye right, each whole
  kHalfSbs,            // the same, each squeezed to half its width
  kFullTb,             // left eye above right eye
  kHalfTb,             // the same, each squeezed to half its height
  kAnaglyphDubois,     // red-cyan glasses; colours by least squares
  kAnaglyphHalfColor,  // red: left eye's luma; green, blue: right eye's
  kAnaglyphGrey,       // luma of both
  kSeparate,           // two pictures
};

// What a container must say of a frame so that a stereo display switches by itself.
enum class StereoPacking { kNone, kSideBySide, kTopBottom };

struct StereoFormatFacts {
  StereoFormat format;
  std::string_view name;  // as options say it: "full-sbs"
  std::vector<std::string_view>
      suffixes;  // that players know the format by, after the file's stem: one for each picture
  StereoPacking packing;
  bool full_chroma;  // colour carries the eyes: 4:2:0 would mix them
};
std::span<const StereoFormatFacts> StereoFormats();
const StereoFormatFacts& FactsOf(StereoFormat format);

// InvalidArgument with the names there are.
absl::StatusOr<StereoFormat> ParseStereoFormat(std::string_view name);

// The pictures of a pair, as many as the format has suffixes. Squeezing averages pairs of pixels in linear light; of an
// odd size the last pixel stands alone.
std::vector<Image<Rgb8>> PackStereo(StereoFormat format, const StereoPair& pair);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_RENDER_STEREO_FORMAT_H_
