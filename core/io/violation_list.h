// Everything wrong with a folder, collected per file.
#ifndef DEPTHTWEEN_CORE_IO_VIOLATION_LIST_H_
#define DEPTHTWEEN_CORE_IO_VIOLATION_LIST_H_

#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "core/base/status.h"

namespace depthtween {

// One offending file and what is wrong with it.
struct FileViolation {
  std::string file;  // relative to the folder
  absl::Status status;
};

class ViolationList {
 public:
  // The code of a file's violation is that of its first problem; its message has the first three and how many more.
  void Add(std::string_view file, const absl::Status& problem);

  bool empty() const { return files_.empty(); }
  bool Contains(const std::string& file) const { return index_of_.contains(file); }
  // One per file, in the order in which files were first added.
  std::vector<FileViolation> PerFile() const;
  // OK when empty. Otherwise the code of the first, and a message that names the first 20 files.
  absl::Status ToStatus() const;

 private:
  struct File {
    std::string name;
    absl::Status first;
    std::string message;
    int problem_count = 0;
  };
  static absl::Status StatusOf(const File& file);

  std::vector<File> files_;
  std::unordered_map<std::string, size_t> index_of_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_VIOLATION_LIST_H_
