// How good ours is on the user's own clip, measured before anything is computed from it.
//
// Every second depth frame of the input is held out: keys 0, 2, 4... are input, 1, 3, 5... are truth. Ours and the
// quick baselines answer the colour frame nearest in time to a held-out one, at most 3 ms away, and are scored as
// `evaluate` scores. The result itself is better than that: its gaps are half as wide. At most kMaxMapsChecked maps are
// scored, spread evenly over the clip, each for the price of a gap of double width: a check costs at most what 2 x
// kMaxMapsChecked intervals of the upsampling cost, whatever the length of the clip.
#ifndef DEPTHTWEEN_CORE_SESSION_SELF_CHECK_H_
#define DEPTHTWEEN_CORE_SESSION_SELF_CHECK_H_

#include <functional>
#include <stop_token>
#include <string>

#include "core/base/status.h"
#include "core/io/sequence_folder.h"
#include "core/sequence/self_check.h"
#include "core/session/upsample_run.h"

namespace depthtween {

inline constexpr int kMaxMapsChecked = 12;
inline constexpr int kWorstFramesTold = 5;

// `options.self_check` does not matter; `options.threads` does not change the numbers. `on_map` is called before each
// map, from the calling thread; `on_item` whenever some of the work is done, from any thread; both may be empty. A clip
// that cannot be checked is a SelfCheck with a reason.
// Errors: InvalidArgument for options; Cancelled when `stop` fires; else what reading files returns.
absl::StatusOr<SelfCheck> CheckSelf(const SequenceFolder& recording, const UpsampleOptions& options,
                                    std::stop_token stop = {},
                                    const std::function<void(int done, int total)>& on_map = nullptr,
                                    const std::function<void()>& on_item = nullptr);

// What it comes to, in one sentence for people: SelfCheck::summary, from the other members.
std::string Summary(const SelfCheck& check);
// The sentence, then a table of the methods and the worst frames.
std::string FormatTable(const SelfCheck& check);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SESSION_SELF_CHECK_H_
