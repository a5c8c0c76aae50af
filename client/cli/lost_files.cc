#include "client/cli/lost_files.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/cli/common.h"

namespace depthtween::cli {
namespace {

constexpr size_t kMostRanges = 8;  // that a person reads; --json has them all

// "3, 8-10" of 3 8 9 10.
std::string Ranges(const std::vector<int>& frames) {
  std::vector<std::string> ranges;
  for (size_t first = 0, next = 0; first < frames.size(); first = next) {
    for (next = first + 1; next < frames.size() && frames[next] == frames[next - 1] + 1;) ++next;
    if (ranges.size() == kMostRanges) {
      ranges.push_back(absl::StrCat("and ", frames.size() - first, " more"));
      break;
    }
    const int last = frames[next - 1];
    ranges.push_back(frames[first] == last ? absl::StrCat(last) : absl::StrCat(frames[first], "-", last));
  }
  return absl::StrJoin(ranges, ", ");
}

}  // namespace

std::string DescribeLost(const std::string& job, const std::vector<client::LostOutput>& lost,
                         const std::string& where) {
  std::vector<std::string> parts;
  size_t count = 0;
  for (const client::LostOutput& output : lost) {
    const size_t frames = output.frames.size();
    count += std::max<size_t>(1, frames);
    parts.push_back(frames == 0 ? output.place
                                : absl::StrFormat("%d %s of %s (%s)", frames, frames == 1 ? "frame" : "frames",
                                                  output.place, Ranges(output.frames)));
  }
  std::string text = parts.back();
  parts.pop_back();
  if (!parts.empty()) text = absl::StrCat(absl::StrJoin(parts, ", "), " and ", text);
  return Printable(absl::StrFormat(
      "%s: %s %s lost or damaged on the server's disk; everything else that is ready is in %s. To recreate %s, "
      "run 'depthtween delete %s' and submit again",
      job, text, count == 1 ? "is" : "are", where, count == 1 ? "it" : "them", job));
}

nlohmann::json LostToJson(const std::vector<client::LostOutput>& lost) {
  nlohmann::json json = nlohmann::json::array();
  for (const client::LostOutput& output : lost) {
    nlohmann::json one = {{"output", output.output}};
    if (!output.frames.empty()) one["frames"] = output.frames;
    json.push_back(std::move(one));
  }
  return json;
}

}  // namespace depthtween::cli
