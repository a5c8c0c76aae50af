#include "core/io/frame_list.h"

#include <unordered_map>

#include "absl/strings/str_format.h"
#include "core/base/byte_order_mark.h"
#include "core/base/utf8.h"

namespace depthtween {
namespace {

constexpr size_t kMaxNameBytes = 1024;

std::string_view Trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

struct Line {
  Stamp stamp = 0;
  std::string path;
};

absl::StatusOr<Line> ParseLine(std::string_view line) {
  if (!IsUtf8(line)) return absl::InvalidArgumentError("is not UTF-8 text");
  const size_t gap = line.find_first_of(" \t");
  if (gap == std::string_view::npos)
    return absl::InvalidArgumentError("must be 'timestamp filename', the file name is missing");
  Line parsed;
  ASSIGN_OR_RETURN(parsed.stamp, ParseStamp(line.substr(0, gap)));
  parsed.path = std::string(Trim(line.substr(gap)));
  RETURN_IF_ERROR(CheckFrameName(parsed.path));
  return parsed;
}

// What `# unit: ms` says, or nothing for any other comment.
absl::StatusOr<std::optional<TimeUnit>> ParseComment(std::string_view line) {
  constexpr std::string_view kUnit = "unit:";
  const std::string_view comment = Trim(line.substr(1));
  if (!comment.starts_with(kUnit)) return std::nullopt;
  const std::string_view name = Trim(comment.substr(kUnit.size()));
  const std::optional<TimeUnit> unit = ParseTimeUnit(name);
  if (!unit.has_value()) return absl::InvalidArgumentError("the unit of time stamps must be s, ms, us or ns");
  return unit;
}

}  // namespace

absl::Status CheckFrameName(std::string_view name) {
  const auto refuse = [name](const char* rule) {
    const bool quotable = name.size() <= 256 && IsUtf8(name) &&
                          name.find_first_of(std::string_view("\0\n\r", 3)) == std::string_view::npos;
    return absl::InvalidArgumentError(
        absl::StrFormat("file name%s %s", quotable ? absl::StrFormat(" '%s'", std::string(name)) : "", rule));
  };
  if (name.empty()) return refuse("is empty");
  if (name.size() > kMaxNameBytes) return refuse("must be at most 1024 bytes long");
  if (!IsUtf8(name)) return refuse("must be UTF-8");
  if (name.front() == '/') return refuse("must be relative to the sequence folder, not absolute");
  for (const char c : name) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F || c == '\\')
      return refuse("must have no control characters and no backslashes");
  }
  for (size_t begin = 0; begin <= name.size();) {
    const size_t end = std::min(name.find('/', begin), name.size());
    const std::string_view part = name.substr(begin, end - begin);
    if (part.empty() || part == "." || part == "..")
      return refuse("must stay inside the sequence folder: no '..', '.' or empty parts");
    begin = end + 1;
  }
  return absl::OkStatus();
}

FrameList ParseFrameList(std::string_view text) {
  FrameList list;
  if (LooksLikeUtf16(text)) {
    list.problems.push_back(absl::InvalidArgumentError("is UTF-16 text, must be UTF-8: save it in that encoding"));
    return list;
  }
  text = SkipByteOrderMark(text);
  std::unordered_map<std::string, int> line_of_path, line_of_stem;
  int line_number = 0, entries = 0;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view line = Trim(text.substr(begin, end - begin));
    begin = end + 1;
    ++line_number;
    if (line.empty()) continue;
    if (line.front() == '#') {
      const absl::StatusOr<std::optional<TimeUnit>> unit = ParseComment(line);
      if (!unit.ok()) list.problems.push_back(WithContext(unit.status(), absl::StrFormat("line %d", line_number)));
      if (!unit.ok() || !unit->has_value()) continue;
      list.unit = **unit;
      list.unit_is_said = true;
      continue;
    }
    if (++entries > kMaxListedFrames) {
      list.problems.push_back(absl::ResourceExhaustedError(absl::StrFormat(
          "line %d: at most %d frames are allowed: split the recording", line_number, kMaxListedFrames)));
      break;
    }
    const std::string where = absl::StrFormat("line %d", line_number);
    absl::StatusOr<Line> frame = ParseLine(line);
    if (!frame.ok()) {
      list.problems.push_back(WithContext(frame.status(), where));
    } else if (const auto [path, is_new] = line_of_path.try_emplace(frame->path, line_number); !is_new) {
      list.problems.push_back(absl::InvalidArgumentError(
          absl::StrFormat("%s: %s is listed on line %d already", where, frame->path, path->second)));
    } else if (const auto [stem, is_new] = line_of_stem.try_emplace(FrameRef{.path = frame->path}.Stem(), line_number);
               !is_new) {
      list.problems.push_back(
          absl::InvalidArgumentError(absl::StrFormat("%s: %s has the name of the file on line %d but for folder and "
                                                     "extension: results are named by it, rename one",
                                                     where, frame->path, stem->second)));
    } else {
      list.frames.push_back({.path = std::move(frame->path)});
      list.stamps.push_back(frame->stamp);
    }
  }
  if (!list.unit_is_said) {
    const absl::StatusOr<TimeUnit> unit = GuessTimeUnit(list.stamps);
    if (unit.ok())
      list.unit = *unit;
    else
      list.problems.push_back(unit.status());
  }
  if (const absl::Status status = SetTimeUnit(list.unit, list); !status.ok()) list.problems.push_back(status);
  return list;
}

absl::Status SetTimeUnit(TimeUnit unit, FrameList& list) {
  std::vector<int64_t> times_ns;
  times_ns.reserve(list.stamps.size());
  for (size_t i = 0; i < list.stamps.size(); ++i) {
    const std::optional<int64_t> time_ns = StampNs(list.stamps[i], unit);
    if (!time_ns.has_value())
      return absl::InvalidArgumentError(absl::StrFormat("%s: its time stamp, in %s, lies beyond 292 years",
                                                        list.frames[i].path, std::string(LongName(unit))));
    times_ns.push_back(*time_ns);
  }
  for (size_t i = 0; i < times_ns.size(); ++i) list.frames[i].time_ns = times_ns[i];
  list.unit = unit;
  return absl::OkStatus();
}

std::string FormatFrameList(const std::vector<FrameRef>& frames) {
  std::vector<Stamp> stamps;
  stamps.reserve(frames.size());
  for (const FrameRef& frame : frames) stamps.emplace_back(frame.time_ns);
  const absl::StatusOr<TimeUnit> guess = GuessTimeUnit(stamps);
  std::string text = "# timestamp filename\n";
  if (!guess.ok() || *guess != TimeUnit::kSeconds) text += "# unit: s\n";
  for (const FrameRef& frame : frames) absl::StrAppend(&text, FormatSeconds(frame.time_ns), " ", frame.path, "\n");
  return text;
}

}  // namespace depthtween
