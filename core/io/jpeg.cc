#include "core/io/jpeg.h"

#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <vector>

// jpeglib.h needs <cstdio> before it.
#include <jerror.h>
#include <jpeglib.h>

#include "absl/strings/str_format.h"

// libjpeg's errors leave by longjmp, which runs no destructors. So every function below that calls setjmp holds plain
// data only; C++ objects live in their callers.

namespace depthtween {
namespace {

// A progressive file may hold any number of scans over the whole image, each a few bytes long; encoders write about
// ten.
constexpr int kMaxScans = 100;

// More bytes than this behind the last pixel are taken for pixels that got lost.
constexpr int kMaxStrayBytes = 64;

struct ErrorManager {
  jpeg_error_mgr base;  // first, so that the library's pointer to it is a pointer to this
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
};

[[noreturn]] void OnError(j_common_ptr codec) {
  auto* manager = reinterpret_cast<ErrorManager*>(codec->err);
  codec->err->format_message(codec, manager->message);
  std::longjmp(manager->jump, 1);
}

// Bytes that belong to nothing, before a marker. Cameras leave some behind the last pixel, or between header segments.
// Within a scan, and before a restart marker, they are pixels that were not understood, and so are many of them.
bool SkippedBytesHarmNothing(j_common_ptr codec) {
  const int count = codec->err->msg_parm.i[0], marker = codec->err->msg_parm.i[1];
  const bool before_restart = marker >= JPEG_RST0 && marker <= JPEG_RST0 + 7;
  const bool in_header = codec->is_decompressor && reinterpret_cast<j_decompress_ptr>(codec)->input_scan_number == 0;
  return !before_restart && (in_header || count <= kMaxStrayBytes);
}

void OnMessage(j_common_ptr codec, int level) {
  const int code = codec->err->msg_code;
  // Odd headers harm no pixel. After any other warning the library makes pixels up.
  const bool harmless = level >= 0 || code == JWRN_ADOBE_XFORM || code == JWRN_JFIF_MAJOR ||
                        (code == JWRN_EXTRANEOUS_DATA && SkippedBytesHarmNothing(codec));
  if (!harmless) OnError(codec);
}

void OnProgress(j_common_ptr codec) {
  const auto* decoder = reinterpret_cast<j_decompress_ptr>(codec);
  if (decoder->input_scan_number <= kMaxScans) return;
  auto* manager = reinterpret_cast<ErrorManager*>(codec->err);
  std::snprintf(manager->message, sizeof manager->message, "more than %d scans", kMaxScans);
  std::longjmp(manager->jump, 1);
}

void SetUp(ErrorManager& manager) {
  jpeg_std_error(&manager.base);
  manager.base.error_exit = OnError;
  manager.base.emit_message = OnMessage;
}

class Decoder {
 public:
  Decoder() {
    SetUp(errors_);
    codec_.err = &errors_.base;
    progress_.progress_monitor = OnProgress;
  }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
  ~Decoder() { jpeg_destroy_decompress(&codec_); }

  absl::Status ReadHeader(std::string_view bytes) {
    if (!ReadHeaderOrJump(bytes.data(), bytes.size())) return Damaged();
    return absl::OkStatus();
  }
  int width() const { return static_cast<int>(codec_.image_width); }
  int height() const { return static_cast<int>(codec_.image_height); }
  bool IsGreyOrColor() const {
    return codec_.jpeg_color_space == JCS_GRAYSCALE || codec_.jpeg_color_space == JCS_YCbCr ||
           codec_.jpeg_color_space == JCS_RGB;
  }
  absl::Status Start() { return StartOrJump() ? absl::OkStatus() : Damaged(); }
  absl::Status ReadRow(Rgb8* row) {
    return ReadRowOrJump(reinterpret_cast<JSAMPROW>(row)) ? absl::OkStatus() : Damaged();
  }
  absl::Status Finish() { return FinishOrJump() ? absl::OkStatus() : Damaged(); }

 private:
  bool ReadHeaderOrJump(const char* data, size_t size) {
    if (setjmp(errors_.jump)) return false;
    jpeg_create_decompress(&codec_);
    codec_.progress = &progress_;
    jpeg_mem_src(&codec_, reinterpret_cast<const unsigned char*>(data), size);
    jpeg_read_header(&codec_, TRUE);
    return true;
  }
  bool StartOrJump() {
    if (setjmp(errors_.jump)) return false;
    codec_.out_color_space = JCS_RGB;
    codec_.dct_method = JDCT_ISLOW;
    jpeg_start_decompress(&codec_);
    return true;
  }
  bool ReadRowOrJump(JSAMPROW row) {
    if (setjmp(errors_.jump)) return false;
    return jpeg_read_scanlines(&codec_, &row, 1) == 1;
  }
  bool FinishOrJump() {
    if (setjmp(errors_.jump)) return false;
    return jpeg_finish_decompress(&codec_) == TRUE;
  }
  absl::Status Damaged() const {
    switch (errors_.base.msg_code) {
      case JERR_BAD_PRECISION:
        return NotRead(absl::StrFormat("has %d bits per sample", codec_.data_precision));
      case JERR_SOF_UNSUPPORTED:
        return NotRead("is coded without loss or in a way that is not common");
      case JERR_ARITH_NOTIMPL:
        return NotRead("is coded arithmetically");
      default:
        return absl::DataLossError(absl::StrCat("damaged JPEG: ", errors_.message));
    }
  }
  static absl::Status NotRead(const std::string& what) {
    return absl::InvalidArgumentError(
        absl::StrCat("is a JPEG that ", what,
                     ", must be a baseline or progressive one of 8 bits: convert it to PNG, for instance by "
                     "`ffmpeg -i IN.jpg OUT.png` or what wrote it"));
  }

  ErrorManager errors_ = {};
  jpeg_progress_mgr progress_ = {};
  jpeg_decompress_struct codec_ = {};
};

class Encoder {
 public:
  Encoder() {
    SetUp(errors_);
    codec_.err = &errors_.base;
  }
  Encoder(const Encoder&) = delete;
  Encoder& operator=(const Encoder&) = delete;
  ~Encoder() {
    jpeg_destroy_compress(&codec_);
    std::free(buffer_);
  }

  absl::StatusOr<std::string> Encode(ImageView<const Rgb8> image, int quality) {
    if (!EncodeOrJump(image, quality)) return absl::InternalError(absl::StrCat("encoding JPEG: ", errors_.message));
    return std::string(reinterpret_cast<const char*>(buffer_), size_);
  }

 private:
  bool EncodeOrJump(ImageView<const Rgb8> image, int quality) {
    if (setjmp(errors_.jump)) return false;
    jpeg_create_compress(&codec_);
    jpeg_mem_dest(&codec_, &buffer_, &size_);
    codec_.image_width = static_cast<JDIMENSION>(image.width());
    codec_.image_height = static_cast<JDIMENSION>(image.height());
    codec_.input_components = 3;
    codec_.in_color_space = JCS_RGB;
    jpeg_set_defaults(&codec_);
    jpeg_set_quality(&codec_, quality, TRUE);
    for (int c = 0; c < 3; ++c) codec_.comp_info[c].h_samp_factor = codec_.comp_info[c].v_samp_factor = 1;
    codec_.dct_method = JDCT_ISLOW;
    jpeg_start_compress(&codec_, TRUE);
    while (codec_.next_scanline < codec_.image_height) {
      const Rgb8* pixels = image.row(static_cast<int>(codec_.next_scanline));
      JSAMPROW row = reinterpret_cast<JSAMPROW>(const_cast<Rgb8*>(pixels));
      jpeg_write_scanlines(&codec_, &row, 1);
    }
    jpeg_finish_compress(&codec_);
    return true;
  }

  ErrorManager errors_ = {};
  jpeg_compress_struct codec_ = {};
  unsigned char* buffer_ = nullptr;  // malloc'ed and grown by the library
  unsigned long size_ = 0;           // NOLINT(google-runtime-int): the library's type
};

}  // namespace

bool LooksLikeJpeg(std::string_view bytes) { return bytes.substr(0, 3) == "\xff\xd8\xff"; }

absl::StatusOr<Image<Rgb8>> DecodeJpeg(std::string_view bytes, const ImageLimits& limits) {
  if (bytes.empty()) return absl::DataLossError("the file is empty");
  if (!LooksLikeJpeg(bytes)) return absl::DataLossError("not a JPEG");
  Decoder decoder;
  RETURN_IF_ERROR(decoder.ReadHeader(bytes));
  RETURN_IF_ERROR(limits.Check(decoder.width(), decoder.height()));
  if (!decoder.IsGreyOrColor())
    return absl::InvalidArgumentError("is a CMYK JPEG, must be RGB or grey: convert it to sRGB");
  RETURN_IF_ERROR(decoder.Start());
  // One row before the image is allocated: a header without pixels costs no memory.
  std::vector<Rgb8> first_row(decoder.width());
  RETURN_IF_ERROR(decoder.ReadRow(first_row.data()));
  Image<Rgb8> image(decoder.width(), decoder.height());
  std::copy(first_row.begin(), first_row.end(), image.row(0));
  for (int y = 1; y < image.height(); ++y) RETURN_IF_ERROR(decoder.ReadRow(image.row(y)));
  RETURN_IF_ERROR(decoder.Finish());
  return image;
}

absl::StatusOr<std::string> EncodeJpeg(ImageView<const Rgb8> image, int quality) {
  if (image.empty()) return absl::InvalidArgumentError("image has no pixels, a JPEG must have at least one");
  if (image.width() > JPEG_MAX_DIMENSION || image.height() > JPEG_MAX_DIMENSION)
    return absl::InvalidArgumentError(absl::StrFormat("image is %d x %d pixels, a JPEG has at most %d on a side",
                                                      image.width(), image.height(), JPEG_MAX_DIMENSION));
  if (quality < 1 || quality > 100)
    return absl::InvalidArgumentError(absl::StrFormat("quality = %d, must be 1 to 100", quality));
  return Encoder().Encode(image, quality);
}

}  // namespace depthtween
