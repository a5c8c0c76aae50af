#include "core/io/violation_list.h"

#include "absl/strings/str_format.h"

namespace depthtween {
namespace {

constexpr int kMaxProblemsPerFile = 3;
constexpr size_t kMaxFilesInMessage = 20;

}  // namespace

void ViolationList::Add(std::string_view file, const absl::Status& problem) {
  const auto [it, is_new] = index_of_.try_emplace(std::string(file), files_.size());
  if (is_new) files_.push_back({.name = std::string(file), .first = problem});
  File& entry = files_[it->second];
  if (++entry.problem_count > kMaxProblemsPerFile) return;
  absl::StrAppend(&entry.message, entry.message.empty() ? "" : "; ", problem.message());
}

absl::Status ViolationList::StatusOf(const File& file) {
  const int hidden = file.problem_count - kMaxProblemsPerFile;
  return {file.first.code(), hidden > 0 ? absl::StrFormat("%s; and %d more", file.message, hidden) : file.message};
}

std::vector<FileViolation> ViolationList::PerFile() const {
  std::vector<FileViolation> violations;
  for (const File& file : files_) violations.push_back({file.name, StatusOf(file)});
  return violations;
}

absl::Status ViolationList::ToStatus() const {
  if (files_.empty()) return absl::OkStatus();
  std::string message;
  for (size_t i = 0; i < files_.size() && i < kMaxFilesInMessage; ++i)
    absl::StrAppend(&message, i == 0 ? "" : "\n", files_[i].name, ": ", StatusOf(files_[i]).message());
  if (files_.size() > kMaxFilesInMessage)
    absl::StrAppendFormat(&message, "\nand %d more files", files_.size() - kMaxFilesInMessage);
  return {files_.front().first.code(), message};
}

}  // namespace depthtween
