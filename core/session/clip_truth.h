// What the true depth and motion of a sequence folder are, frame by frame.
//
// Truth is SEQ/gt/depth where present; else the depth maps that were left out of the input (key_every > 1), each taken
// for the truth of the colour frame that it was taken with, as its stamp says: at most 3 ms apart, or no further than
// stamps wander (PairDepthWithinJitter). True motion: gt/flow and gt/occ, where present.
#ifndef DEPTHTWEEN_CORE_SESSION_CLIP_TRUTH_H_
#define DEPTHTWEEN_CORE_SESSION_CLIP_TRUTH_H_

#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "core/base/status.h"
#include "core/io/flow_png.h"
#include "core/io/sequence_folder.h"
#include "core/metrics/comparison.h"
#include "core/session/clip_alignment.h"

namespace depthtween {

struct FrameTruth {
  int color_index = -1;
  Image<float> depth_m;
  FlowField flow;                         // to the next colour frame; empty where not known
  Image<uint8_t> hidden_in_next, unseen;  // likewise

  TruthFrame View() const;
};

class ClipTruth {
 public:
  enum class Kind { kBest, kLeftOutDepth };

  // `folder` must outlive it. Left-out depth maps are placed by `alignment`; but pairing by index is no clock: where it
  // says that a map belongs is what is to be judged, so the stamps place it. FailedPrecondition says why when no frame
  // strictly between the first and the last key has truth. kLeftOutDepth looks at no gt/depth.
  static absl::StatusOr<ClipTruth> Open(const SequenceFolder& folder, const ClipAlignment& alignment, int key_every,
                                        Kind kind = Kind::kBest);

  // "gt/depth" or "left-out depth maps".
  const std::string& kind() const { return kind_; }
  bool IsLeftOutDepth() const { return kind_ == kLeftOut; }
  // Truth that cannot be scored, and why.
  const std::vector<std::string>& notes() const { return notes_; }
  // Colour frames with truth, ascending.
  std::vector<int> Frames() const;
  // Leaves only frames for which `keep` holds; returns how many went.
  int Keep(const std::function<bool(int color_index)>& keep);

  // Of one of Frames(); each call must ask for a later frame than the one before. Errors: what reading files returns;
  // InvalidArgument when motion is not of the camera's size; Cancelled when `stop` fires.
  absl::StatusOr<FrameTruth> Read(int color_index, const std::stop_token& stop = {});

 private:
  static constexpr char kLeftOut[] = "left-out depth maps";

  // One frame, and where its truth comes from.
  struct Ref {
    int color = -1;
    int depth = -1;    // into the folder's depth maps, or -1:
    std::string path;  // gt/depth of this frame
  };

  ClipTruth(const SequenceFolder& folder, const Registration& registration)
      : folder_(&folder), registration_(registration) {}
  // Goes on to the next colour frame.
  absl::Status Advance();

  const SequenceFolder* folder_;
  Registration registration_;  // of left-out depth maps
  std::string kind_;
  std::vector<Ref> refs_;
  std::vector<std::string> notes_;
  std::vector<bool> at_key_time_;  // by colour frame

  // Of the colour frame read last, and what the key before it saw of it.
  int current_ = -1;
  FlowField flow_;
  Image<uint8_t> hidden_, unseen_;
  KeyVisibility visibility_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_CLIP_TRUTH_H_
