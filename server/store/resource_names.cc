#include "server/store/resource_names.h"

#include <sys/random.h>

#include <algorithm>
#include <array>
#include <new>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "proto/depthtween/sha256.h"
#include "server/store/error_info.h"

namespace depthtween::server {
namespace {

bool IsId(absl::string_view id) {
  return !id.empty() && id.size() <= 64 && std::all_of(id.begin(), id.end(), [](unsigned char c) {
    return absl::ascii_isalnum(c) || c == '-' || c == '_';
  });
}

// The ids in a name of the form "<collection>/<id>/<collection>/<id>"...
absl::StatusOr<std::vector<std::string>> ParseName(std::string_view field, std::string_view name,
                                                   const std::vector<absl::string_view>& collections,
                                                   absl::string_view form) {
  const std::vector<absl::string_view> parts = absl::StrSplit(View(name), '/');
  std::vector<std::string> ids;
  bool matches = parts.size() == 2 * collections.size();
  for (size_t i = 0; matches && i < collections.size(); ++i) {
    matches = parts[2 * i] == collections[i] && IsId(parts[2 * i + 1]);
    ids.emplace_back(parts[2 * i + 1]);
  }
  if (!matches) {
    return InvalidField(field, absl::StrCat("= \"", absl::CHexEscape(View(name.substr(0, 200))), "\", must be ", form));
  }
  return ids;
}

}  // namespace

std::string NewId() {
  std::array<char, 8> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) throw std::bad_alloc();
  return Hex({bytes.data(), bytes.size()});
}

std::string SequenceName(std::string_view id) { return absl::StrCat("sequences/", View(id)); }
std::string UploadName(std::string_view sequence_id, std::string_view upload_id) {
  return absl::StrCat("sequences/", View(sequence_id), "/uploads/", View(upload_id));
}
std::string JobName(std::string_view id) { return absl::StrCat("jobs/", View(id)); }
std::string OutputName(std::string_view job_id, std::string_view output_id) {
  return absl::StrCat("jobs/", View(job_id), "/outputs/", View(output_id));
}

absl::StatusOr<std::string> ParseSequenceName(std::string_view field, std::string_view name) {
  ASSIGN_OR_RETURN(const std::vector<std::string> ids, ParseName(field, name, {"sequences"}, "sequences/{sequence}"));
  return ids[0];
}

absl::StatusOr<std::string> ParseJobName(std::string_view field, std::string_view name) {
  ASSIGN_OR_RETURN(const std::vector<std::string> ids, ParseName(field, name, {"jobs"}, "jobs/{job}"));
  return ids[0];
}

absl::StatusOr<UploadIds> ParseUploadName(std::string_view field, std::string_view name) {
  ASSIGN_OR_RETURN(const std::vector<std::string> ids,
                   ParseName(field, name, {"sequences", "uploads"}, "sequences/{sequence}/uploads/{upload}"));
  return UploadIds{ids[0], ids[1]};
}

absl::StatusOr<OutputIds> ParseOutputName(std::string_view field, std::string_view name) {
  ASSIGN_OR_RETURN(const std::vector<std::string> ids,
                   ParseName(field, name, {"jobs", "outputs"}, "jobs/{job}/outputs/{output}"));
  return OutputIds{ids[0], ids[1]};
}

}  // namespace depthtween::server
