// The images of a source, told by another list: other stamps, or fewer frames.
#ifndef DEPTHTWEEN_CORE_SEQUENCE_RETOLD_SOURCE_H_
#define DEPTHTWEEN_CORE_SEQUENCE_RETOLD_SOURCE_H_

#include <utility>

#include "core/sequence/sequence.h"

namespace depthtween {

// `source` must outlive it. Frame i of `sequence` is frame i of the source, so only the end of a list may be cut off.
class RetoldSource : public FrameSource {
 public:
  RetoldSource(const FrameSource& source, Sequence sequence) : source_(source), sequence_(std::move(sequence)) {}
  const Sequence& sequence() const override { return sequence_; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return source_.Color(index); }
  absl::StatusOr<Image<float>> Depth(int index) const override { return source_.Depth(index); }

 private:
  const FrameSource& source_;
  const Sequence sequence_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SEQUENCE_RETOLD_SOURCE_H_
