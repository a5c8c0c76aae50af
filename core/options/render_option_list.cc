#include "core/options/render_option_list.h"

#include <limits>

#include "absl/strings/str_join.h"

namespace depthtween {
namespace {

constexpr char kLens[] = "Depth of field";
constexpr char kEyes[] = "Stereo";
constexpr double kAny = std::numeric_limits<double>::max();  // ranges stand where the values are used

OptionSpec Number(const char* group, const char* name, const char* flag, const char* unit, const char* help) {
  return {.name = name,
          .help = help,
          .placeholder = unit,
          .group = group,
          .flag = flag,
          .min = -kAny,
          .max = kAny,
          .type = OptionType::kNumber};
}

OptionSpec Whole(const char* group, const char* name, const char* flag, const char* help) {
  return {.name = name,
          .help = help,
          .placeholder = "N",
          .group = group,
          .flag = flag,
          .min = std::numeric_limits<int>::min(),
          .max = std::numeric_limits<int>::max(),
          .type = OptionType::kInteger};
}

OptionSpec Word(const char* group, const char* name, const char* flag, const std::string& help,
                std::vector<std::string> words) {
  std::string text = help + ": " + absl::StrJoin(words, ", ");
  return {.name = name,
          .help = std::move(text),
          .placeholder = "NAME",
          .group = group,
          .flag = flag,
          .words = std::move(words),
          .type = OptionType::kWord};
}

}  // namespace

const std::vector<OptionSpec>& DepthOfFieldOptionSpecs() {
  static const auto* const kSpecs = new std::vector<OptionSpec>{
      Number(kLens, "fstop", "--fstop", "N", "Aperture = focal length / this; smaller is more blur [1.8]"),
      Number(kLens, "focal_mm", "--focal-mm", "MM",
             "Focal length; the field of view stays the camera's [that of this field of view on the sensor]"),
      Word(kLens, "sensor", "--sensor", "Size of the sensor [full-frame]",
           {"full-frame", "medium-format", "super-35", "aps-c", "micro-four-thirds", "one-inch"}),
      Number(kLens, "aperture_mm", "--aperture-mm", "MM", "Diameter of the aperture, instead of --fstop"),
      Word(kLens, "method", "--dof-method",
           "How [layers]; kraus (Kraus and Strengert 2007) and gather are there to compare with",
           {"layers", "kraus", "gather"}),
      Whole(kLens, "layers", "--layers", "Layers of equal width in blur [20]"),
      Whole(kLens, "blades", "--blades", "Blades of the aperture, 3 to 16; 0 is round [0]"),
      Number(kLens, "max_radius_px", "--max-radius", "PX", "Largest radius of blur, pixels, up to 128 [32]"),
  };
  return *kSpecs;
}

const std::vector<OptionSpec>& StereoOptionSpecs() {
  static const auto* const kSpecs = new std::vector<OptionSpec>{
      Word(kEyes, "format", "--format", "How both eyes are packed [full-sbs]",
           {"full-sbs", "half-sbs", "full-tb", "half-tb", "anaglyph-dubois", "anaglyph-half-colour", "anaglyph-grey",
            "separate"}),
      Word(kEyes, "made", "--eye", "The eye that is made [left]", {"left", "right", "both"}),
      Number(kEyes, "divergence_percent", "--divergence", "PERCENT",
             "Disparity from the nearest to the farthest of the clip, percent of the width [2]"),
      Number(kEyes, "baseline_m", "--baseline", "M", "Distance between the eyes, up to 100, instead of --divergence"),
      Number(kEyes, "convergence_m", "--convergence", "M", "Depth that appears on the screen [by the clip]"),
      Number(kEyes, "screen_width_m", "--screen-width", "M", "Width of the screen, for the comfort report [1]"),
      Number(kEyes, "viewing_distance_m", "--viewing-distance", "M",
             "Distance of the viewer, for the comfort report [3]"),
  };
  return *kSpecs;
}

const std::vector<std::string>& FrameFormatWords() {
  static const auto* const kWords = new std::vector<std::string>{"png", "jpeg"};
  return *kWords;
}

const std::vector<std::string>& FocusEasingWords() {
  static const auto* const kWords = new std::vector<std::string>{"smooth", "linear"};
  return *kWords;
}

}  // namespace depthtween
