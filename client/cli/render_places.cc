#include "client/cli/render_places.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/common.h"
#include "client/lib/files.h"

namespace depthtween::cli {
namespace {

absl::Status CheckName(const std::string& name) {
  if (client::IsPlainFileName(name)) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrCat("the server named a file '", Printable(name), "', which is not a plain file name"));
}

}  // namespace

absl::StatusOr<std::string> VideoPlace(const std::string& out, const std::string& name, const v1::Output& output) {
  const std::string& file = output.file_name();
  RETURN_IF_ERROR(CheckName(file));
  const std::string ending = file.substr(std::min(file.size(), name.size()));
  if (absl::EndsWith(out, ending)) return out;
  return absl::StrCat(out.substr(0, out.size() - std::string(".mp4").size()), ending);
}

absl::StatusOr<std::string> PictureFolder(const std::string& out, const std::string& name, const v1::Output& output) {
  const std::string stream = output.name().substr(output.name().rfind('/') + 1);
  if (stream.size() <= name.size() + 1) return out;
  const std::string eye = stream.substr(name.size() + 1);
  RETURN_IF_ERROR(CheckName(eye));
  return absl::StrCat(out, "/", eye);
}

}  // namespace depthtween::cli
