#include "core/io/png.h"

#include <png.h>

#include <bit>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <new>
#include <vector>

#include "absl/strings/str_format.h"
#include "core/io/file.h"
#include "core/io/jpeg.h"

// libpng reports errors by longjmp, which runs no destructors. So every function below that calls setjmp, and every
// callback that libpng may jump out of, holds plain data only; C++ objects live in their callers.

namespace depthtween {
namespace {

static_assert(std::endian::native == std::endian::little, "png_set_swap below assumes it");

// Signature, then the first chunk: length, "IHDR", width, height, bit depth, colour type, ..., checksum.
constexpr size_t kSignatureBytes = 8;
constexpr size_t kHeaderBytes = kSignatureBytes + 8 + 13 + 4;

// Deflate cannot pack tighter than 258 bytes into two bits (zlib's technical notes), so a file that promises more
// pixels than that is known to be cut short before its pixels are allocated.
constexpr int64_t kMaxDeflateRatio = 1032;

struct Header {
  int64_t width = 0, height = 0;
  int bit_depth = 0, color_type = 0;
};

struct Input {
  const char* data;
  size_t size;
  size_t position;
};

struct Failure {
  char message[160];
};

[[noreturn]] void OnError(png_structp png, png_const_charp message) {
  auto* failure = static_cast<Failure*>(png_get_error_ptr(png));
  std::snprintf(failure->message, sizeof failure->message, "%s", message);
  png_longjmp(png, 1);
}

void OnWarning(png_structp, png_const_charp) {}  // about chunks that we do not use

void OnRead(png_structp png, png_bytep out, size_t count) {
  auto* input = static_cast<Input*>(png_get_io_ptr(png));
  if (count > input->size - input->position) png_error(png, "the file is cut short");
  std::memcpy(out, input->data + input->position, count);
  input->position += count;
}

uint32_t BigEndian32(const char* bytes) {
  const auto* b = reinterpret_cast<const unsigned char*>(bytes);
  return uint32_t{b[0]} << 24 | uint32_t{b[1]} << 16 | uint32_t{b[2]} << 8 | uint32_t{b[3]};
}

int ChannelsOf(int color_type) {
  switch (color_type) {
    case PNG_COLOR_TYPE_GRAY_ALPHA:
      return 2;
    case PNG_COLOR_TYPE_RGB:
      return 3;
    case PNG_COLOR_TYPE_RGB_ALPHA:
      return 4;
    default:
      return 1;
  }
}

std::string KindName(int bit_depth, int color_type) {
  const char* color = "colour of an unknown kind";
  switch (color_type) {
    case PNG_COLOR_TYPE_GRAY:
      color = "grey";
      break;
    case PNG_COLOR_TYPE_GRAY_ALPHA:
      color = "grey with alpha";
      break;
    case PNG_COLOR_TYPE_RGB:
      color = "RGB";
      break;
    case PNG_COLOR_TYPE_RGB_ALPHA:
      color = "RGB with alpha";
      break;
    case PNG_COLOR_TYPE_PALETTE:
      color = "palette";
      break;
  }
  return absl::StrFormat("%d-bit %s", bit_depth, color);
}

absl::StatusOr<Header> ParseHeader(std::string_view bytes, const ImageLimits& limits) {
  if (bytes.empty()) return absl::DataLossError("the file is empty");
  if (!LooksLikePng(bytes)) return absl::DataLossError("not a PNG");
  if (bytes.size() < kHeaderBytes) return absl::DataLossError("damaged PNG: the file is cut short");
  const char* chunk = bytes.data() + kSignatureBytes;
  if (BigEndian32(chunk) != 13 || std::memcmp(chunk + 4, "IHDR", 4) != 0)
    return absl::DataLossError("damaged PNG: it does not begin with a header");
  const Header header = {.width = BigEndian32(chunk + 8),
                         .height = BigEndian32(chunk + 12),
                         .bit_depth = static_cast<unsigned char>(chunk[16]),
                         .color_type = static_cast<unsigned char>(chunk[17])};
  RETURN_IF_ERROR(limits.Check(header.width, header.height));
  const int64_t row_bytes = (header.width * ChannelsOf(header.color_type) * header.bit_depth + 7) / 8;
  if (row_bytes * header.height > kMaxDeflateRatio * static_cast<int64_t>(bytes.size()))
    return absl::DataLossError(
        absl::StrFormat("damaged PNG: %d bytes cannot hold %d x %d pixels, the file is cut short", bytes.size(),
                        header.width, header.height));
  return header;
}

class Reader {
 public:
  explicit Reader(std::string_view bytes) : input_{bytes.data(), bytes.size(), 0} {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, &failure_, OnError, OnWarning);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::bad_alloc();
  }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }

  // Reads everything before the pixels and sets up `to_rgb8`, the conversion to 8-bit RGB, or none.
  absl::Status Begin(bool to_rgb8, size_t expected_row_bytes) {
    if (!BeginOrJump(png_, info_, &input_, to_rgb8)) return Damaged();
    if (png_get_rowbytes(png_, info_) != expected_row_bytes)
      return absl::InternalError("libpng would deliver rows of another size than asked for");
    return absl::OkStatus();
  }
  absl::Status ReadRows(png_bytepp rows) { return ReadRowsOrJump(png_, rows) ? absl::OkStatus() : Damaged(); }

 private:
  static bool BeginOrJump(png_structp png, png_infop info, Input* input, bool to_rgb8) {
    if (setjmp(png_jmpbuf(png))) return false;
    png_set_read_fn(png, input, OnRead);
    // Pixels are in critical chunks. A damaged profile or time of writing is left out.
    png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_WARN_DISCARD);
    // Text, profiles and the like are skipped unread: they may unpack to megabytes.
    png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
    png_read_info(png, info);
    if (to_rgb8) {
      png_set_palette_to_rgb(png);
      png_set_expand_gray_1_2_4_to_8(png);
      png_set_scale_16(png);
      png_set_gray_to_rgb(png);
      png_set_strip_alpha(png);
    } else if (png_get_bit_depth(png, info) == 16) {
      png_set_swap(png);
    }
    png_set_interlace_handling(png);
    png_read_update_info(png, info);
    return true;
  }
  static bool ReadRowsOrJump(png_structp png, png_bytepp rows) {
    if (setjmp(png_jmpbuf(png))) return false;
    png_read_image(png, rows);
    png_read_end(png, nullptr);
    return true;
  }
  absl::Status Damaged() const { return absl::DataLossError(absl::StrCat("damaged PNG: ", failure_.message)); }

  Failure failure_ = {};
  Input input_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

template <typename T>
absl::StatusOr<Image<T>> DecodePixels(std::string_view bytes, const Header& header, bool to_rgb8) {
  Reader reader(bytes);
  RETURN_IF_ERROR(reader.Begin(to_rgb8, static_cast<size_t>(header.width) * sizeof(T)));
  Image<T> image(static_cast<int>(header.width), static_cast<int>(header.height));
  std::vector<png_bytep> rows(header.height);
  for (int y = 0; y < image.height(); ++y) rows[y] = reinterpret_cast<png_bytep>(image.row(y));
  RETURN_IF_ERROR(reader.ReadRows(rows.data()));
  return image;
}

// The row filter to write with, or 0 for libpng's choice per row. Trying all filters takes longer than packing does,
// and on the depth and uncertainty of a 512 x 424 sensor its choice is no smaller than always the left neighbour: 8.0
// ms and 299 kB against 11.0 ms and 300 kB, 3.4 ms and 97 kB against 5.1 ms and 115 kB. 8-bit grey holds labels and
// masks, whose differences mean nothing.
int FilterFor(const Header& header) {
  if (header.color_type != PNG_COLOR_TYPE_GRAY) return 0;
  return header.bit_depth == 16 ? PNG_FILTER_SUB : PNG_FILTER_NONE;
}

// Decodes a file of exactly this kind.
template <typename T>
absl::StatusOr<Image<T>> DecodeExactly(std::string_view bytes, const ImageLimits& limits, int bit_depth,
                                       int color_type) {
  if (LooksLikeJpeg(bytes))
    return absl::InvalidArgumentError(absl::StrFormat("is a JPEG, must be a PNG, %s", KindName(bit_depth, color_type)));
  ASSIGN_OR_RETURN(const Header header, ParseHeader(bytes, limits));
  if (header.bit_depth != bit_depth || header.color_type != color_type)
    return absl::InvalidArgumentError(absl::StrFormat(
        "is %s, must be %s", KindName(header.bit_depth, header.color_type), KindName(bit_depth, color_type)));
  return DecodePixels<T>(bytes, header, /*to_rgb8=*/false);
}

class Writer {
 public:
  Writer() {
    png_ = png_create_write_struct(PNG_LIBPNG_VER_STRING, &failure_, OnError, OnWarning);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::bad_alloc();
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { png_destroy_write_struct(&png_, &info_); }

  absl::StatusOr<std::string> Write(const Header& header, int compression, png_bytepp rows) {
    if (!WriteOrJump(png_, info_, &bytes_, header, compression, FilterFor(header), rows))
      return absl::InternalError(absl::StrCat("encoding PNG: ", failure_.message));
    return std::move(bytes_);
  }

 private:
  static void OnWrite(png_structp png, png_bytep data, size_t count) {
    if (!Append(*static_cast<std::string*>(png_get_io_ptr(png)), data, count)) png_error(png, "out of memory");
  }
  static bool Append(std::string& bytes, png_bytep data, size_t count) {
    try {
      bytes.append(reinterpret_cast<const char*>(data), count);
      return true;
    } catch (const std::bad_alloc&) {  // must not cross libpng
      return false;
    }
  }
  static bool WriteOrJump(png_structp png, png_infop info, std::string* bytes, const Header& header, int compression,
                          int filter, png_bytepp rows) {
    if (setjmp(png_jmpbuf(png))) return false;
    png_set_write_fn(png, bytes, OnWrite, nullptr);
    png_set_compression_level(png, compression);
    if (filter != 0) png_set_filter(png, PNG_FILTER_TYPE_BASE, filter);
    png_set_IHDR(png, info, static_cast<png_uint_32>(header.width), static_cast<png_uint_32>(header.height),
                 header.bit_depth, header.color_type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
                 PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    if (header.bit_depth == 16) png_set_swap(png);
    png_write_image(png, rows);
    png_write_end(png, nullptr);
    return true;
  }

  Failure failure_ = {};
  std::string bytes_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

template <typename T>
absl::StatusOr<std::string> Encode(ImageView<const T> image, int bit_depth, int color_type, int compression) {
  if (image.empty()) return absl::InvalidArgumentError("image has no pixels, a PNG must have at least one");
  if (compression < 0 || compression > 9)
    return absl::InvalidArgumentError(absl::StrFormat("compression = %d, must be 0 to 9", compression));
  std::vector<png_bytep> rows(image.height());
  for (int y = 0; y < image.height(); ++y) rows[y] = reinterpret_cast<png_bytep>(const_cast<T*>(image.row(y)));
  const Header header = {image.width(), image.height(), bit_depth, color_type};
  return Writer().Write(header, compression, rows.data());
}

template <typename T>
absl::StatusOr<Image<T>> Read(const std::string& path, const ImageLimits& limits,
                              absl::StatusOr<Image<T>> (*decode)(std::string_view, const ImageLimits&)) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  absl::StatusOr<Image<T>> image = decode(bytes, limits);
  if (!image.ok()) return WithContext(image.status(), path);
  return image;
}

}  // namespace

bool LooksLikePng(std::string_view bytes) {
  return bytes.substr(0, kSignatureBytes) == std::string_view("\x89PNG\r\n\x1a\n", kSignatureBytes);
}

absl::StatusOr<Image<uint16_t>> DecodePng16(std::string_view bytes, const ImageLimits& limits) {
  return DecodeExactly<uint16_t>(bytes, limits, 16, PNG_COLOR_TYPE_GRAY);
}

absl::StatusOr<Image<uint8_t>> DecodePng8(std::string_view bytes, const ImageLimits& limits) {
  return DecodeExactly<uint8_t>(bytes, limits, 8, PNG_COLOR_TYPE_GRAY);
}

absl::StatusOr<Image<Rgb16>> DecodePngRgb16(std::string_view bytes, const ImageLimits& limits) {
  return DecodeExactly<Rgb16>(bytes, limits, 16, PNG_COLOR_TYPE_RGB);
}

absl::StatusOr<Image<Rgb8>> DecodePngRgb8(std::string_view bytes, const ImageLimits& limits) {
  ASSIGN_OR_RETURN(const Header header, ParseHeader(bytes, limits));
  return DecodePixels<Rgb8>(bytes, header, /*to_rgb8=*/true);
}

absl::StatusOr<std::string> EncodePng16(ImageView<const uint16_t> image, int compression) {
  return Encode(image, 16, PNG_COLOR_TYPE_GRAY, compression);
}

absl::StatusOr<std::string> EncodePng8(ImageView<const uint8_t> image, int compression) {
  return Encode(image, 8, PNG_COLOR_TYPE_GRAY, compression);
}

absl::StatusOr<std::string> EncodePngRgb8(ImageView<const Rgb8> image, int compression) {
  return Encode(image, 8, PNG_COLOR_TYPE_RGB, compression);
}

absl::StatusOr<std::string> EncodePngRgb16(ImageView<const Rgb16> image, int compression) {
  return Encode(image, 16, PNG_COLOR_TYPE_RGB, compression);
}

absl::StatusOr<Image<uint16_t>> ReadPng16(const std::string& path, const ImageLimits& limits) {
  return Read(path, limits, DecodePng16);
}

absl::StatusOr<Image<uint8_t>> ReadPng8(const std::string& path, const ImageLimits& limits) {
  return Read(path, limits, DecodePng8);
}

absl::Status WritePng16(const std::string& path, ImageView<const uint16_t> image) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodePng16(image));
  return WriteFile(path, bytes);
}

absl::Status WritePng8(const std::string& path, ImageView<const uint8_t> image) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodePng8(image));
  return WriteFile(path, bytes);
}

absl::Status WritePngRgb8(const std::string& path, ImageView<const Rgb8> image) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodePngRgb8(image));
  return WriteFile(path, bytes);
}

}  // namespace depthtween
