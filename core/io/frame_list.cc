#include "core/io/frame_list.h"

#include <unordered_map>

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

constexpr size_t kMaxNameBytes = 1024;

// Well-formed UTF-8 as Unicode's table 3-7 has it: no overlong forms, no surrogates, nothing past U+10FFFF.
bool IsUtf8(std::string_view text) {
  const auto* p = reinterpret_cast<const unsigned char*>(text.data());
  const auto* const end = p + text.size();
  while (p < end) {
    const unsigned lead = *p++;
    if (lead < 0x80) continue;
    if (lead < 0xC2 || lead > 0xF4) return false;
    const int tail_bytes = lead < 0xE0 ? 1 : lead < 0xF0 ? 2 : 3;
    if (end - p < tail_bytes) return false;
    const unsigned first_low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
    const unsigned first_high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
    if (*p < first_low || *p > first_high) return false;
    for (int i = 1; i < tail_bytes; ++i) {
      if (p[i] < 0x80 || p[i] > 0xBF) return false;
    }
    p += tail_bytes;
  }
  return true;
}

std::string_view Trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

absl::StatusOr<FrameRef> ParseLine(std::string_view line) {
  if (!IsUtf8(line)) return absl::InvalidArgumentError("is not UTF-8 text");
  const size_t gap = line.find_first_of(" \t");
  if (gap == std::string_view::npos)
    return absl::InvalidArgumentError("must be 'timestamp filename', the file name is missing");
  FrameRef frame;
  ASSIGN_OR_RETURN(frame.time_ns, ParseSeconds(line.substr(0, gap)));
  frame.path = std::string(Trim(line.substr(gap)));
  RETURN_IF_ERROR(CheckFrameName(frame.path));
  return frame;
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
  std::unordered_map<std::string, int> line_of_path, line_of_stem;
  int line_number = 0, entries = 0;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view line = Trim(text.substr(begin, end - begin));
    begin = end + 1;
    ++line_number;
    if (line.empty() || line.front() == '#') continue;
    if (++entries > kMaxListedFrames) {
      list.problems.push_back(absl::ResourceExhaustedError(absl::StrFormat(
          "line %d: at most %d frames are allowed: split the recording", line_number, kMaxListedFrames)));
      break;
    }
    const std::string where = absl::StrFormat("line %d", line_number);
    absl::StatusOr<FrameRef> frame = ParseLine(line);
    if (!frame.ok()) {
      list.problems.push_back(WithContext(frame.status(), where));
    } else if (const auto [path, is_new] = line_of_path.try_emplace(frame->path, line_number); !is_new) {
      list.problems.push_back(absl::InvalidArgumentError(
          absl::StrFormat("%s: %s is listed on line %d already", where, frame->path, path->second)));
    } else if (const auto [stem, is_new] = line_of_stem.try_emplace(frame->Stem(), line_number); !is_new) {
      list.problems.push_back(
          absl::InvalidArgumentError(absl::StrFormat("%s: %s has the name of the file on line %d but for folder and "
                                                     "extension: results are named by it, rename one",
                                                     where, frame->path, stem->second)));
    } else {
      list.frames.push_back(*std::move(frame));
    }
  }
  return list;
}

std::string FormatFrameList(const std::vector<FrameRef>& frames) {
  std::string text = "# timestamp filename\n";
  for (const FrameRef& frame : frames) absl::StrAppend(&text, FormatSeconds(frame.time_ns), " ", frame.path, "\n");
  return text;
}

}  // namespace depthtween
