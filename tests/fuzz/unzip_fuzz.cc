// Any bytes as a zip archive: a list of violations, or files that lie in the folder and are as large as is said.
#include "core/io/unzip.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>

using namespace depthtween;  // NOLINT(google-build-using-namespace): this file is one function

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  namespace fs = std::filesystem;
  static const struct Root {
    std::string path = (fs::temp_directory_path() / "unzip_fuzz_XXXXXX").string();
    Root() {
      if (mkdtemp(path.data()) == nullptr) std::abort();
    }
    ~Root() { fs::remove_all(path); }
  } root;
  const std::string archive = root.path + "/a.zip", folder = root.path + "/out";
  std::ofstream(archive, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  fs::remove_all(folder);
  fs::create_directories(folder);
  const auto summary = Unzip(archive, folder, {.max_files = 10, .max_bytes = 1 << 20}, {}, nullptr);
  if (!summary.ok()) std::abort();  // nothing is wrong with this disk
  int files = 0;
  int64_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_directory()) continue;
    if (!entry.is_regular_file()) std::abort();
    ++files;
    bytes += static_cast<int64_t>(entry.file_size());
  }
  if (files > 10 || bytes > 1 << 20) std::abort();
  if (summary->ok() && (files != summary->files || bytes != summary->bytes)) std::abort();
  // Nothing beside the folder.
  if (std::distance(fs::directory_iterator(root.path), fs::directory_iterator()) != 2) std::abort();
  return 0;
}
