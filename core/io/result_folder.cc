#include "core/io/result_folder.h"

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/folder_parts.h"
#include "core/io/frame_list.h"
#include "core/io/npz.h"
#include "core/io/png.h"
#include "core/io/quantise.h"
#include "core/sequence/camera_json.h"

namespace depthtween {
namespace {

constexpr char kReportFile[] = "report.json";
constexpr int64_t kMaxReportBytes = int64_t{64} << 20;

std::string FrameName(const char* folder, const std::string& stem) { return absl::StrCat(folder, "/", stem, ".png"); }

struct HalfFlow {
  uint16_t u = 0, v = 0;
};

float RoundMotion(float pixels) { return std::nearbyint(pixels * 32.0F) / 32.0F; }

Image<uint8_t> ProvenanceBytes(ImageView<const Provenance> provenance) {
  Image<uint8_t> bytes(provenance.width(), provenance.height());
  for (int y = 0; y < bytes.height(); ++y) {
    for (int x = 0; x < bytes.width(); ++x) bytes(x, y) = static_cast<uint8_t>(provenance(x, y));
  }
  return bytes;
}

absl::StatusOr<Image<float>> ReadSigma(const std::string& dir, const std::string& stem, double depth_scale) {
  ASSIGN_OR_RETURN(const Image<uint16_t> units, ReadPng16(JoinPath(dir, ResultUncertaintyName(stem))));
  return DequantiseSigma(units, depth_scale);
}

absl::StatusOr<Image<Provenance>> ReadProvenance(const std::string& dir, const std::string& stem) {
  const std::string path = JoinPath(dir, ResultProvenanceName(stem));
  ASSIGN_OR_RETURN(const Image<uint8_t> bytes, ReadPng8(path));
  Image<Provenance> provenance(bytes.width(), bytes.height());
  for (int y = 0; y < bytes.height(); ++y) {
    for (int x = 0; x < bytes.width(); ++x) {
      if (bytes(x, y) > static_cast<uint8_t>(Provenance::kHeld))
        return absl::DataLossError(
            absl::StrFormat("%s: value %d at (%d, %d), provenance must be 0 to 5", path, bytes(x, y), x, y));
      provenance(x, y) = static_cast<Provenance>(bytes(x, y));
    }
  }
  return provenance;
}

// Bounds-checked, so that a caller's loop over another clip's frames fails by name.
absl::StatusOr<std::string> StemAt(const std::vector<FrameRef>& frames, int index) {
  if (index < 0 || index >= static_cast<int>(frames.size()))
    return absl::InvalidArgumentError(absl::StrFormat("frame %d does not exist, there are %d", index, frames.size()));
  return frames[index].Stem();
}

}  // namespace

std::string ResultDepthName(const std::string& stem) { return FrameName("depth", stem); }
std::string ResultUncertaintyName(const std::string& stem) { return FrameName("uncertainty", stem); }
std::string ResultProvenanceName(const std::string& stem) { return FrameName("provenance", stem); }
std::string ResultMotionName(const std::string& stem) { return absl::StrCat("motion/", stem, ".npz"); }

absl::Status WriteResultFrame(const std::string& dir, const std::string& stem, double depth_scale,
                              const DepthResult& result) {
  const ImageView<const float> depth_m = result.depth_m;
  if (!depth_m.SameSize(result.sigma_m.view()) || !depth_m.SameSize(result.provenance.view()))
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %s: depth is %d x %d, uncertainty %d x %d, provenance %d x %d pixels: they must agree",
                        stem, depth_m.width(), depth_m.height(), result.sigma_m.width(), result.sigma_m.height(),
                        result.provenance.width(), result.provenance.height()));
  if (!result.motion_next.empty()) {
    ASSIGN_OR_RETURN(const std::string motion, EncodeMotion(result.motion_next, result.motion_back));
    RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, ResultMotionName(stem)), motion));
  }
  ASSIGN_OR_RETURN(const std::string provenance, EncodePng8(ProvenanceBytes(result.provenance)));
  ASSIGN_OR_RETURN(const std::string uncertainty, EncodePng16(QuantiseSigma(result.sigma_m, depth_scale)));
  ASSIGN_OR_RETURN(const std::string depth, EncodePng16(QuantiseDepth(depth_m, depth_scale)));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, ResultProvenanceName(stem)), provenance));
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir, ResultUncertaintyName(stem)), uncertainty));
  return WriteFileDurably(JoinPath(dir, ResultDepthName(stem)), depth);
}

absl::StatusOr<Image<float>> ReadResultDepth(const std::string& dir, const std::string& stem, double depth_scale) {
  ASSIGN_OR_RETURN(const Image<uint16_t> units, ReadPng16(JoinPath(dir, ResultDepthName(stem))));
  return DequantiseDepth(units, depth_scale);
}

absl::StatusOr<DepthResult> ReadResultFrame(const std::string& dir, const std::string& stem, double depth_scale) {
  DepthResult result;
  ASSIGN_OR_RETURN(result.depth_m, ReadResultDepth(dir, stem, depth_scale));
  ASSIGN_OR_RETURN(result.sigma_m, ReadSigma(dir, stem, depth_scale));
  ASSIGN_OR_RETURN(result.provenance, ReadProvenance(dir, stem));
  const ImageView<const float> depth_m = result.depth_m;
  if (!depth_m.SameSize(result.sigma_m.view()) || !depth_m.SameSize(result.provenance.view()))
    return absl::DataLossError(absl::StrFormat("%s: frame %s: its images differ in size", dir, stem));
  return result;
}

absl::StatusOr<std::string> EncodeMotion(ImageView<const Flow2> next, ImageView<const Flow2> back) {
  if (!next.SameSize(back))
    return absl::InvalidArgumentError(absl::StrFormat("motion: next is %d x %d, back %d x %d pixels: they must agree",
                                                      next.width(), next.height(), back.width(), back.height()));
  Npz arrays;
  for (const auto& [name, flow] : {std::pair("next", next), std::pair("back", back)}) {
    NpyArray& array = arrays[name];
    array.type = ElementType::kFloat16;
    array.shape = {flow.height(), flow.width(), 2};
    array.bytes.resize(flow.pixel_count() * sizeof(HalfFlow));
    char* out = array.bytes.data();
    for (int y = 0; y < flow.height(); ++y) {
      const Flow2* row = flow.row(y);
      for (int x = 0; x < flow.width(); ++x, out += sizeof(HalfFlow)) {
        const HalfFlow stored = {FloatToHalf(RoundMotion(row[x].u)), FloatToHalf(RoundMotion(row[x].v))};
        std::memcpy(out, &stored, sizeof(stored));
      }
    }
  }
  return EncodeNpz(arrays, NpzCompression::kFast);
}

absl::StatusOr<FrameMotion> ReadResultMotion(const std::string& dir, const std::string& stem) {
  const std::string path = JoinPath(dir, ResultMotionName(stem));
  ASSIGN_OR_RETURN(const Npz arrays, ReadNpz(path));
  FrameMotion motion;
  for (const auto& [name, flow] : {std::pair("next", &motion.next), std::pair("back", &motion.back)}) {
    const auto found = arrays.find(name);
    if (found == arrays.end() || found->second.type != ElementType::kFloat16 || found->second.shape.size() != 3 ||
        found->second.shape[2] != 2 || found->second.shape != arrays.begin()->second.shape)
      return absl::DataLossError(absl::StrFormat("%s: array '%s' must be H x W x 2 half floats", path, name));
    const NpyArray& array = found->second;
    *flow = Image<Flow2>(static_cast<int>(array.shape[1]), static_cast<int>(array.shape[0]));
    const char* in = array.bytes.data();
    for (size_t i = 0; i < flow->pixel_count(); ++i, in += sizeof(HalfFlow)) {
      HalfFlow stored;
      std::memcpy(&stored, in, sizeof(stored));
      flow->data()[i] = {HalfToFloat(stored.u), HalfToFloat(stored.v)};
    }
  }
  return motion;
}

absl::StatusOr<ResultWriter> ResultWriter::Create(const std::string& dir, const Sequence& sequence, bool with_motion) {
  RETURN_IF_ERROR(Validate(sequence));
  if (FileExists(JoinPath(dir, "rgb.txt")) && !FileExists(JoinPath(dir, kReportFile)))
    return absl::AlreadyExistsError(
        absl::StrCat(dir, " holds a recording, whose depth the result would overwrite: choose another folder"));
  for (const char* folder : {"depth", "uncertainty", "provenance"}) RETURN_IF_ERROR(MakeFolder(JoinPath(dir, folder)));
  if (with_motion) RETURN_IF_ERROR(MakeFolder(JoinPath(dir, "motion")));
  return ResultWriter(dir, sequence);
}

absl::Status ResultWriter::Write(const DepthResult& result) const {
  ASSIGN_OR_RETURN(const std::string stem, StemAt(sequence_.color, result.color_index));
  if (result.depth_m.width() != sequence_.camera.width || result.depth_m.height() != sequence_.camera.height)
    return absl::InvalidArgumentError(absl::StrFormat("frame %s: depth is %d x %d pixels, must be the camera's %d x %d",
                                                      stem, result.depth_m.width(), result.depth_m.height(),
                                                      sequence_.camera.width, sequence_.camera.height));
  return WriteResultFrame(dir_, stem, sequence_.depth_scale, result);
}

absl::Status ResultWriter::Finish(const nlohmann::json& report) const {
  std::vector<FrameRef> frames;
  for (const FrameRef& color : sequence_.color) {
    std::string name = ResultDepthName(color.Stem());
    if (!FileExists(JoinPath(dir_, name)))
      return absl::FailedPreconditionError(
          absl::StrCat(JoinPath(dir_, name), " has not been written: the result is not whole"));
    frames.push_back({color.time_ns, std::move(name)});
  }
  RETURN_IF_ERROR(WriteFileDurably(JoinPath(dir_, "depth.txt"), FormatFrameList(frames)));
  RETURN_IF_ERROR(
      WriteFileDurably(JoinPath(dir_, "camera.json"), FormatCameraJson(sequence_.camera, sequence_.depth_scale)));
  return WriteFileDurably(JoinPath(dir_, kReportFile), report.dump(1) + "\n");
}

absl::StatusOr<ResultFolder> ResultFolder::Open(const std::string& dir) {
  RETURN_IF_ERROR(CheckFolder(dir));
  const std::string report_path = JoinPath(dir, kReportFile);
  if (!FileExists(report_path))
    return absl::FailedPreconditionError(absl::StrCat(report_path, " is missing: the result is not finished"));
  ViolationList violations;
  ResultFolder folder;
  folder.dir_ = dir;
  const CameraFile camera_file = ReadCameraPart(dir, violations);
  folder.camera_ = camera_file.camera;
  folder.depth_scale_ = camera_file.depth_scale;
  folder.frames_ = ReadListPart(dir, "depth.txt", violations).frames;
  if (!violations.empty()) return WithContext(violations.ToStatus(), dir);
  // A result's depth is its list, on the clock of the colour frames it was made for.
  RETURN_IF_ERROR(WithContext(Validate({folder.camera_, folder.depth_scale_, folder.frames_, folder.frames_}), dir));
  ASSIGN_OR_RETURN(const std::string report, ReadFile(report_path, kMaxReportBytes));
  folder.report_ = nlohmann::json::parse(report, /*cb=*/nullptr, /*allow_exceptions=*/false);
  if (!folder.report_.is_object()) return absl::DataLossError(absl::StrCat(report_path, ": not a JSON object"));
  return folder;
}

absl::StatusOr<Image<float>> ResultFolder::Depth(int index) const {
  ASSIGN_OR_RETURN(const std::string stem, StemAt(frames_, index));
  return ReadResultDepth(dir_, stem, depth_scale_);
}

absl::StatusOr<Image<float>> ResultFolder::Sigma(int index) const {
  ASSIGN_OR_RETURN(const std::string stem, StemAt(frames_, index));
  return ReadSigma(dir_, stem, depth_scale_);
}

absl::StatusOr<Image<Provenance>> ResultFolder::ProvenanceAt(int index) const {
  ASSIGN_OR_RETURN(const std::string stem, StemAt(frames_, index));
  return ReadProvenance(dir_, stem);
}

}  // namespace depthtween
