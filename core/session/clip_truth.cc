#include "core/session/clip_truth.h"

#include <algorithm>
#include <cassert>
#include <cstdlib>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sequence/sequence.h"

namespace depthtween {
namespace {

constexpr int64_t kSameTimeNs = 3'000'000;  // a depth map may be scored at a colour frame this near in time

bool SameTime(int64_t depth_ns, int64_t color_ns) { return std::abs(depth_ns - color_ns) <= kSameTimeNs; }

}  // namespace

TruthFrame FrameTruth::View() const {
  return {.color_index = color_index,
          .depth_m = depth_m,
          .motion = {.flow_px = flow.flow.view(), .valid = flow.valid.view(), .hidden_in_next = hidden_in_next.view()},
          .unseen = unseen};
}

absl::StatusOr<ClipTruth> ClipTruth::Open(const SequenceFolder& folder, const ClipAlignment& alignment, int key_every,
                                          Kind kind) {
  const ClipClock& clock = alignment.clock;
  const Sequence sequence = ByStamps(folder.sequence(), clock);
  const Sequence keys = InputOf(folder.sequence(), clock, key_every);
  const int64_t first_ns = keys.depth.front().time_ns, last_ns = keys.depth.back().time_ns;
  const auto between_keys = [&](int64_t time_ns) { return time_ns > first_ns && time_ns < last_ns; };

  ClipTruth truth(folder, alignment.registration);
  truth.at_key_time_.assign(sequence.color.size(), false);
  for (const FrameRef& key : keys.depth) {
    const int color = NearestColorFrame(sequence, key.time_ns);
    if (SameTime(key.time_ns, sequence.color[color].time_ns)) truth.at_key_time_[color] = true;
  }

  truth.kind_ = "gt/depth";
  for (size_t c = 0; c < sequence.color.size() && kind == Kind::kBest; ++c) {
    if (!between_keys(sequence.color[c].time_ns)) continue;
    if (auto path = GroundTruthDepthPath(folder.dir(), sequence.color[c].Stem()))
      truth.refs_.push_back({.color = static_cast<int>(c), .path = *std::move(path)});
  }
  if (!truth.refs_.empty()) return truth;

  truth.kind_ = kLeftOut;
  if (key_every == 1)
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s has no gt/depth between its first and last depth map, and all its depth maps were input, so there is no "
        "truth to score: run upsample with --key-every 2 or more and evaluate that result",
        folder.dir()));
  int left_out = 0;
  for (size_t d = 0; d < sequence.depth.size(); ++d) {
    const int64_t time_ns = sequence.depth[d].time_ns;
    if (d % key_every == 0 || !between_keys(time_ns)) continue;
    ++left_out;
    const int color = NearestColorFrame(sequence, time_ns);
    if (SameTime(time_ns, sequence.color[color].time_ns) && between_keys(sequence.color[color].time_ns))
      truth.refs_.push_back({.color = color, .depth = static_cast<int>(d)});
  }
  const int unmatched = left_out - static_cast<int>(truth.refs_.size());
  if (truth.refs_.empty())
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s: none of its %d left-out depth maps is within 3 ms of a colour frame, so there is no truth to score: use a "
        "recording whose colour and depth stamps meet, or another --key-every",
        folder.dir(), left_out));
  if (unmatched > 0)
    truth.notes_.push_back(absl::StrFormat("%d of %d left-out depth maps are not scored: no colour frame within 3 ms",
                                           unmatched, left_out));
  return truth;
}

std::vector<int> ClipTruth::Frames() const {
  std::vector<int> frames;
  for (const Ref& ref : refs_) frames.push_back(ref.color);
  return frames;
}

int ClipTruth::Keep(const std::function<bool(int color_index)>& keep) {
  return static_cast<int>(std::erase_if(refs_, [&](const Ref& ref) { return !keep(ref.color); }));
}

absl::Status ClipTruth::Advance() {
  ++current_;
  const std::string stem = folder_->sequence().color[current_].Stem();
  const int width = folder_->sequence().camera.width, height = folder_->sequence().camera.height;
  const bool followed = !flow_.flow.empty() && !hidden_.empty();
  if (at_key_time_[current_])
    visibility_.Restart(width, height);
  else if (visibility_.Started() && followed)
    visibility_.Advance({.flow_px = flow_.flow.view(), .valid = flow_.valid.view(), .hidden_in_next = hidden_.view()});
  else
    visibility_ = KeyVisibility();
  flow_ = {};
  hidden_ = {};
  const std::string flow_path = JoinPath(folder_->dir(), "gt/flow/" + stem + ".png");
  const std::string hidden_path = JoinPath(folder_->dir(), "gt/occ/" + stem + ".png");
  if (FileExists(flow_path)) {
    ASSIGN_OR_RETURN(flow_, ReadFlowPng(flow_path));
  }
  if (FileExists(hidden_path)) {
    ASSIGN_OR_RETURN(hidden_, ReadPng8(hidden_path));
  }
  const auto fits = [&](const auto& image) {
    return image.empty() || (image.width() == width && image.height() == height);
  };
  if (!fits(flow_.flow) || !fits(hidden_))
    return absl::InvalidArgumentError(
        absl::StrFormat("%s or %s is not %d x %d, must be as the camera says", flow_path, hidden_path, width, height));
  unseen_ = visibility_.Started() ? visibility_.Unseen() : Image<uint8_t>();
  return absl::OkStatus();
}

absl::StatusOr<FrameTruth> ClipTruth::Read(int color_index, const std::stop_token& stop) {
  assert(color_index > current_);
  while (current_ < color_index) {
    if (stop.stop_requested()) return absl::CancelledError("stopped on request");
    RETURN_IF_ERROR(Advance());
  }
  const auto ref = std::find_if(refs_.begin(), refs_.end(), [&](const Ref& r) { return r.color == color_index; });
  assert(ref != refs_.end());
  FrameTruth truth{.color_index = color_index,
                   .flow = {.flow = flow_.flow.Clone(), .valid = flow_.valid.Clone()},
                   .hidden_in_next = hidden_.Clone(),
                   .unseen = unseen_.Clone()};
  if (ref->depth >= 0) {
    ASSIGN_OR_RETURN(Image<float> left_out, folder_->Depth(ref->depth));
    truth.depth_m = Align(std::move(left_out), registration_);
  } else {
    ASSIGN_OR_RETURN(const Image<uint16_t> units, ReadPng16(ref->path));
    truth.depth_m = DequantiseRecordedDepth(units, folder_->sequence().depth_scale);
  }
  return truth;
}

}  // namespace depthtween
