#include "core/io/npz.h"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>
#include <new>
#include <optional>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "core/io/file.h"

namespace depthtween {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie in memory");

constexpr uint32_t kLocalSignature = 0x04034b50, kCentralSignature = 0x02014b50, kEndSignature = 0x06054b50;
constexpr size_t kLocalBytes = 30, kCentralBytes = 46, kEndBytes = 22;
constexpr uint16_t kStored = 0, kDeflated = 8;
constexpr uint16_t kEncryptedFlag = 1;
constexpr uint16_t kZipVersion = 20;                         // deflate
constexpr uint16_t kFirstDosDate = (0 << 9) | (1 << 5) | 1;  // 1980-01-01: the same arrays give the same bytes
constexpr int64_t kMaxDeflateRatio = 1032;                   // see png.cc
constexpr size_t kMaxNpyHeaderBytes = 1 << 16;
constexpr size_t kMaxDimensions = 32;  // NumPy's own limit

constexpr std::string_view kNpyMagic("\x93NUMPY", 6);
constexpr std::string_view kNpySuffix = ".npy";

struct TypeName {
  ElementType type;
  const char* descr;
  size_t bytes;
};
constexpr TypeName kTypeNames[] = {
    {ElementType::kBool, "|b1", 1},    {ElementType::kUint8, "|u1", 1},   {ElementType::kInt16, "<i2", 2},
    {ElementType::kUint16, "<u2", 2},  {ElementType::kInt32, "<i4", 4},   {ElementType::kInt64, "<i8", 8},
    {ElementType::kFloat16, "<f2", 2}, {ElementType::kFloat32, "<f4", 4}, {ElementType::kFloat64, "<f8", 8},
};

const TypeName& NameOf(ElementType type) {
  const TypeName* const found =
      std::find_if(std::begin(kTypeNames), std::end(kTypeNames), [type](const TypeName& n) { return n.type == type; });
  assert(found != std::end(kTypeNames));
  return *found;
}

template <typename T>
T LoadAt(std::string_view bytes, size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

template <typename T>
void Append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

absl::Status Damaged(std::string_view what) {
  return absl::DataLossError(absl::StrCat("damaged npz: ", absl::string_view(what.data(), what.size())));
}

std::string Quoted(std::string_view text) {
  return absl::StrCat("'", absl::CHexEscape(absl::string_view(text.data(), std::min<size_t>(text.size(), 80))), "'");
}

uint32_t Checksum(std::string_view bytes) {
  return static_cast<uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

// ---- zip
// -----------------------------------------------------------------------------------------------------------------

struct ZipEntry {
  std::string_view name;
  std::string_view packed;
  uint16_t method = 0;
  uint32_t checksum = 0;
  int64_t size = 0;  // unpacked
};

absl::StatusOr<std::vector<ZipEntry>> ListEntries(std::string_view zip, const NpzLimits& limits) {
  if (zip.size() < kEndBytes) return Damaged("the file is cut short");
  // The end record is found from the back, behind it only a comment of at most 65535 bytes.
  size_t end = zip.size() - kEndBytes;
  const size_t lowest = end - std::min<size_t>(end, 65535);
  while (LoadAt<uint32_t>(zip, end) != kEndSignature) {
    if (end == lowest) return Damaged("no zip directory, not an npz or cut short");
    --end;
  }
  const int count = LoadAt<uint16_t>(zip, end + 10);
  size_t at = LoadAt<uint32_t>(zip, end + 16);
  if (count > limits.max_arrays)
    return absl::ResourceExhaustedError(
        absl::StrFormat("npz has %d arrays, at most %d are allowed", count, limits.max_arrays));
  std::vector<ZipEntry> entries;
  for (int i = 0; i < count; ++i) {
    if (at > end || end - at < kCentralBytes || LoadAt<uint32_t>(zip, at) != kCentralSignature)
      return Damaged("its directory is broken");
    const size_t name_bytes = LoadAt<uint16_t>(zip, at + 28);
    const size_t skip = name_bytes + LoadAt<uint16_t>(zip, at + 30) + LoadAt<uint16_t>(zip, at + 32);
    if (end - at - kCentralBytes < skip) return Damaged("its directory is broken");
    ZipEntry entry = {.name = zip.substr(at + kCentralBytes, name_bytes),
                      .method = LoadAt<uint16_t>(zip, at + 10),
                      .checksum = LoadAt<uint32_t>(zip, at + 16),
                      .size = LoadAt<uint32_t>(zip, at + 24)};
    const size_t packed_bytes = LoadAt<uint32_t>(zip, at + 20), local = LoadAt<uint32_t>(zip, at + 42);
    if ((LoadAt<uint16_t>(zip, at + 8) & kEncryptedFlag) != 0)
      return absl::InvalidArgumentError(absl::StrCat("npz: ", Quoted(entry.name), " is encrypted"));
    // Sizes in the local header are not used: writers that stream leave them open.
    if (local > zip.size() || zip.size() - local < kLocalBytes || LoadAt<uint32_t>(zip, local) != kLocalSignature)
      return Damaged("an entry points outside the file");
    const size_t data = local + kLocalBytes + LoadAt<uint16_t>(zip, local + 26) + LoadAt<uint16_t>(zip, local + 28);
    if (data > zip.size() || zip.size() - data < packed_bytes) return Damaged("an entry points outside the file");
    entry.packed = zip.substr(data, packed_bytes);
    entries.push_back(entry);
    at += kCentralBytes + skip;
  }
  return entries;
}

// Raw deflate of a known unpacked size; false when the stream is another size or damaged.
bool Inflate(std::string_view packed, std::string& out) {
  z_stream stream = {};
  if (::inflateInit2(&stream, -MAX_WBITS) != Z_OK) throw std::bad_alloc();
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int result = ::inflate(&stream, Z_FINISH);
  const bool whole = result == Z_STREAM_END && stream.avail_out == 0;
  ::inflateEnd(&stream);
  return whole;
}

std::string Deflate(std::string_view bytes, int level) {
  z_stream stream = {};
  if (::deflateInit2(&stream, level, Z_DEFLATED, -MAX_WBITS, /*memLevel=*/8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::bad_alloc();
  std::string packed(::deflateBound(&stream, bytes.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  const int result = ::deflate(&stream, Z_FINISH);
  assert(result == Z_STREAM_END);  // deflateBound is enough for one call
  static_cast<void>(result);
  packed.resize(stream.total_out);
  ::deflateEnd(&stream);
  return packed;
}

absl::StatusOr<std::string> Unpack(const ZipEntry& entry) {
  const auto packed_bytes = static_cast<int64_t>(entry.packed.size());
  std::string bytes;
  if (entry.method == kStored) {
    if (packed_bytes != entry.size) return Damaged(absl::StrCat(Quoted(entry.name), " disagrees with its size"));
    bytes = std::string(entry.packed);
  } else if (entry.method == kDeflated) {
    if (entry.size > kMaxDeflateRatio * packed_bytes)
      return Damaged(absl::StrCat(Quoted(entry.name), " cannot unpack to its size"));
    bytes.resize(static_cast<size_t>(entry.size));
    if (!Inflate(entry.packed, bytes)) return Damaged(absl::StrCat(Quoted(entry.name), " does not unpack to its size"));
  } else {
    return absl::InvalidArgumentError(absl::StrFormat("npz: %s is packed by method %d, must be stored or deflated",
                                                      Quoted(entry.name), entry.method));
  }
  if (Checksum(bytes) != entry.checksum) return Damaged(absl::StrCat(Quoted(entry.name), " has a wrong checksum"));
  return bytes;
}

// ---- npy
// -----------------------------------------------------------------------------------------------------------------

struct NpyHeader {
  std::string descr;
  bool fortran_order = false;
  std::vector<int64_t> shape;
};

// Reads the Python literal `{'descr': '<f2', 'fortran_order': False, 'shape': (424, 512, 3), }`, keys in any order.
class HeaderParser {
 public:
  explicit HeaderParser(std::string_view text) : rest_(text) {}

  std::optional<NpyHeader> Parse() {
    NpyHeader header;
    bool has_descr = false, has_order = false, has_shape = false;
    if (!Take('{')) return std::nullopt;
    while (!Take('}')) {
      const std::optional<std::string> key = TakeString();
      if (!key || !Take(':')) return std::nullopt;
      bool read = false;
      if (*key == "descr") {
        const std::optional<std::string> value = TakeString();
        if ((read = has_descr = value.has_value())) header.descr = *value;
      } else if (*key == "fortran_order") {
        if (TakeWord("True")) read = has_order = header.fortran_order = true;
        if (!read && TakeWord("False")) read = has_order = true;
      } else if (*key == "shape") {
        read = has_shape = TakeShape(header.shape);
      }
      if (!read) return std::nullopt;
      if (!Take(',') && Peek() != '}') return std::nullopt;
    }
    if (!has_descr || !has_order || !has_shape) return std::nullopt;
    return header;
  }

 private:
  char Peek() {
    while (!rest_.empty() && (rest_.front() == ' ' || rest_.front() == '\n')) rest_.remove_prefix(1);
    return rest_.empty() ? '\0' : rest_.front();
  }
  bool Take(char expected) {
    if (Peek() != expected || rest_.empty()) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool TakeWord(std::string_view word) {
    Peek();
    if (!rest_.starts_with(word)) return false;
    rest_.remove_prefix(word.size());
    return true;
  }
  std::optional<std::string> TakeString() {
    const char quote = Peek();
    if (quote != '\'' && quote != '"') return std::nullopt;
    const size_t end = rest_.find(quote, 1);
    if (end == std::string_view::npos) return std::nullopt;
    std::string value(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return value;
  }
  bool TakeShape(std::vector<int64_t>& shape) {
    shape.clear();
    if (!Take('(')) return false;
    while (!Take(')')) {
      int64_t size = 0;
      int digits = 0;
      for (Peek(); !rest_.empty() && rest_.front() >= '0' && rest_.front() <= '9'; ++digits, rest_.remove_prefix(1)) {
        if (digits == 18) return false;  // below overflow, far above any limit
        size = size * 10 + (rest_.front() - '0');
      }
      if (digits == 0 || shape.size() == kMaxDimensions) return false;
      shape.push_back(size);
      if (!Take(',') && Peek() != ')') return false;
    }
    return true;
  }

  std::string_view rest_;
};

// The product of a shape, or none past `limit`.
std::optional<int64_t> Product(const std::vector<int64_t>& shape, int64_t limit) {
  if (std::find(shape.begin(), shape.end(), 0) != shape.end()) return 0;
  int64_t product = 1;
  for (const int64_t size : shape) {
    if (size < 0 || size > limit / product) return std::nullopt;
    product *= size;
  }
  return product;
}

absl::StatusOr<NpyArray> DecodeNpy(std::string bytes) {
  constexpr size_t kVersionEnd = kNpyMagic.size() + 2;
  const std::string_view view = bytes;
  if (!view.starts_with(kNpyMagic) || view.size() < kVersionEnd + 4) return Damaged("an array has no npy header");
  const int version = view[kNpyMagic.size()];
  if (version < 1 || version > 3)
    return absl::InvalidArgumentError(absl::StrFormat("npz has npy version %d, must be 1 to 3", version));
  const size_t begin = kVersionEnd + (version == 1 ? 2 : 4);
  const size_t header_bytes = version == 1 ? LoadAt<uint16_t>(view, kVersionEnd) : LoadAt<uint32_t>(view, kVersionEnd);
  if (header_bytes > kMaxNpyHeaderBytes || header_bytes > view.size() - begin)
    return Damaged("an npy header is cut short");
  const std::optional<NpyHeader> header = HeaderParser(view.substr(begin, header_bytes)).Parse();
  if (!header) return Damaged(absl::StrCat("cannot read the npy header ", Quoted(view.substr(begin, header_bytes))));
  const TypeName* const type = std::find_if(std::begin(kTypeNames), std::end(kTypeNames),
                                            [&](const TypeName& n) { return header->descr == n.descr; });
  if (type == std::end(kTypeNames))
    return absl::InvalidArgumentError(absl::StrFormat(
        "npz has elements of type %s, must be one of %s", Quoted(header->descr),
        absl::StrJoin(kTypeNames, " ", [](std::string* out, const TypeName& n) { absl::StrAppend(out, n.descr); })));
  if (header->fortran_order && header->shape.size() > 1)
    return absl::InvalidArgumentError(
        "npz has an array in Fortran order, must be in C order: np.ascontiguousarray makes it so");
  const size_t data_bytes = view.size() - begin - header_bytes;
  const std::optional<int64_t> count = Product(header->shape, static_cast<int64_t>(data_bytes));
  if (!count || static_cast<size_t>(*count) * type->bytes != data_bytes)
    return Damaged(absl::StrFormat("an array of shape (%s) %s has %d bytes", absl::StrJoin(header->shape, ", "),
                                   type->descr, data_bytes));
  bytes.erase(0, begin + header_bytes);
  return NpyArray{.type = type->type, .shape = header->shape, .bytes = std::move(bytes)};
}

std::string EncodeNpy(const NpyArray& array) {
  std::string header = absl::StrFormat("{'descr': '%s', 'fortran_order': False, 'shape': (%s%s), }",
                                       NameOf(array.type).descr, absl::StrJoin(array.shape, ", "),
                                       array.shape.size() == 1 ? "," : "");  // (3,) is a tuple, (3) is a number
  const size_t prefix = kNpyMagic.size() + 2 + 2;
  header.append(63 - (prefix + header.size()) % 64, ' ');  // with the line feed, data begins at a multiple of 64
  header += '\n';
  std::string bytes(kNpyMagic);
  bytes += '\x01';
  bytes += '\x00';
  Append(bytes, static_cast<uint16_t>(header.size()));
  return bytes + header + array.bytes;
}

template <typename T, typename Convert>
void ConvertElements(const std::string& bytes, std::vector<float>& out, Convert convert) {
  for (size_t i = 0; i < out.size(); ++i) out[i] = convert(LoadAt<T>(bytes, i * sizeof(T)));
}

template <typename T>
void CastElements(const std::string& bytes, std::vector<float>& out) {
  ConvertElements<T>(bytes, out, [](T value) { return static_cast<float>(value); });
}

}  // namespace

float HalfToFloat(uint16_t half) {
  const uint32_t sign = uint32_t{half & 0x8000U} << 16;
  const uint32_t exponent = (half >> 10) & 0x1F, mantissa = half & 0x3FF;
  if (exponent == 0) {  // zero and subnormals: mantissa * 2^-24, exact in a float
    const float magnitude = std::ldexp(static_cast<float>(mantissa), -24);
    return sign != 0 ? -magnitude : magnitude;
  }
  const uint32_t float_exponent = exponent == 31 ? 255 : exponent + (127 - 15);
  return std::bit_cast<float>(sign | float_exponent << 23 | mantissa << 13);
}

uint16_t FloatToHalf(float value) {
  const auto bits = std::bit_cast<uint32_t>(value);
  const auto sign = static_cast<uint16_t>((bits >> 16) & 0x8000);
  const uint32_t magnitude = bits & 0x7FFFFFFF;
  if (magnitude > 0x7F800000) return sign | 0x7E00;   // NaN
  if (magnitude >= 0x477FF000) return sign | 0x7C00;  // from 65520 on, half of the way past 65504: infinity
  if (magnitude < 0x38800000) {                       // below 2^-14: a whole number of 2^-24
    // nearbyint rounds to even in the default mode; 1024 is the smallest normal half, as its bits are.
    return sign | static_cast<uint16_t>(std::nearbyint(std::ldexp(std::bit_cast<float>(magnitude), 24)));
  }
  const uint32_t odd = (magnitude >> 13) & 1;
  return sign | static_cast<uint16_t>((magnitude - (uint32_t{127 - 15} << 23) + 0xFFF + odd) >> 13);
}

size_t ElementBytes(ElementType type) { return NameOf(type).bytes; }

int64_t NpyArray::element_count() const { return Product(shape, std::numeric_limits<int64_t>::max()).value_or(0); }

std::vector<float> NpyArray::ToFloats() const {
  std::vector<float> values(bytes.size() / ElementBytes(type));
  switch (type) {
    case ElementType::kBool:
    case ElementType::kUint8:
      CastElements<uint8_t>(bytes, values);
      break;
    case ElementType::kInt16:
      CastElements<int16_t>(bytes, values);
      break;
    case ElementType::kUint16:
      CastElements<uint16_t>(bytes, values);
      break;
    case ElementType::kInt32:
      CastElements<int32_t>(bytes, values);
      break;
    case ElementType::kInt64:
      CastElements<int64_t>(bytes, values);
      break;
    case ElementType::kFloat16:
      ConvertElements<uint16_t>(bytes, values, HalfToFloat);
      break;
    case ElementType::kFloat32:
      CastElements<float>(bytes, values);
      break;
    case ElementType::kFloat64:
      CastElements<double>(bytes, values);
      break;
  }
  return values;
}

NpyArray NpyArray::FromFloats(std::vector<int64_t> shape, const std::vector<float>& values, ElementType type) {
  assert(type == ElementType::kFloat16 || type == ElementType::kFloat32);
  NpyArray array = {.type = type, .shape = std::move(shape)};
  assert(array.element_count() == static_cast<int64_t>(values.size()));
  array.bytes.reserve(values.size() * ElementBytes(type));
  for (const float value : values) {
    if (type == ElementType::kFloat16) {
      Append(array.bytes, FloatToHalf(value));
    } else {
      Append(array.bytes, value);
    }
  }
  return array;
}

absl::StatusOr<Npz> DecodeNpz(std::string_view bytes, const NpzLimits& limits) {
  ASSIGN_OR_RETURN(const std::vector<ZipEntry> entries, ListEntries(bytes, limits));
  int64_t total = 0;
  for (const ZipEntry& entry : entries) total += entry.size;
  if (total > limits.max_bytes)
    return absl::ResourceExhaustedError(
        absl::StrFormat("npz unpacks to %d bytes, at most %d are allowed", total, limits.max_bytes));
  Npz arrays;
  for (const ZipEntry& entry : entries) {
    if (!entry.name.ends_with(kNpySuffix))
      return absl::InvalidArgumentError(absl::StrCat("npz has ", Quoted(entry.name), ", must hold .npy arrays only"));
    ASSIGN_OR_RETURN(std::string unpacked, Unpack(entry));
    absl::StatusOr<NpyArray> array = DecodeNpy(std::move(unpacked));
    if (!array.ok()) return WithContext(array.status(), Quoted(entry.name));
    const std::string name(entry.name.substr(0, entry.name.size() - kNpySuffix.size()));
    if (!arrays.emplace(name, *std::move(array)).second)
      return Damaged(absl::StrCat(Quoted(entry.name), " is there twice"));
  }
  return arrays;
}

absl::StatusOr<Npz> ReadNpz(const std::string& path, const NpzLimits& limits) {
  ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path));
  absl::StatusOr<Npz> arrays = DecodeNpz(bytes, limits);
  if (!arrays.ok()) return WithContext(arrays.status(), path);
  return arrays;
}

absl::StatusOr<std::string> EncodeNpz(const Npz& arrays, NpzCompression compression) {
  if (arrays.size() > 65535) return absl::InvalidArgumentError("an npz holds at most 65535 arrays");
  const uint16_t method = compression == NpzCompression::kStored ? kStored : kDeflated;
  const int level = compression == NpzCompression::kFast ? Z_BEST_SPEED : Z_DEFAULT_COMPRESSION;
  std::string zip, directory;
  for (const auto& [name, array] : arrays) {
    const std::optional<int64_t> count = Product(array.shape, static_cast<int64_t>(array.bytes.size()));
    if (!count || static_cast<size_t>(*count) * ElementBytes(array.type) != array.bytes.size())
      return absl::InvalidArgumentError(
          absl::StrFormat("array %s of shape (%s) has %d bytes, must have %d each element", name,
                          absl::StrJoin(array.shape, ", "), array.bytes.size(), ElementBytes(array.type)));
    const std::string file = absl::StrCat(name, kNpySuffix.data());
    const std::string npy = EncodeNpy(array);
    const std::string packed = method == kStored ? npy : Deflate(npy, level);
    if (file.size() > 65535 || zip.size() + npy.size() + packed.size() > std::numeric_limits<uint32_t>::max() / 2)
      return absl::InvalidArgumentError(absl::StrFormat("array %s makes the npz larger than 2 GiB: split it", name));
    // From `version needed` to `length of extra field`, local and central headers agree.
    std::string common;
    Append(common, kZipVersion);
    Append(common, uint16_t{0});  // flags
    Append(common, method);
    Append(common, uint16_t{0});  // time of day
    Append(common, kFirstDosDate);
    Append(common, Checksum(npy));
    Append(common, static_cast<uint32_t>(packed.size()));
    Append(common, static_cast<uint32_t>(npy.size()));
    Append(common, static_cast<uint16_t>(file.size()));
    Append(common, uint16_t{0});  // extra field

    Append(directory, kCentralSignature);
    Append(directory, kZipVersion);  // made by
    directory += common;
    directory.append(2 + 2 + 2 + 4, '\0');  // comment, disk, internal and external attributes
    Append(directory, static_cast<uint32_t>(zip.size()));
    directory += file;

    Append(zip, kLocalSignature);
    zip += common + file + packed;
  }
  const size_t directory_at = zip.size();
  zip += directory;
  Append(zip, kEndSignature);
  Append(zip, uint32_t{0});  // disks
  Append(zip, static_cast<uint16_t>(arrays.size()));
  Append(zip, static_cast<uint16_t>(arrays.size()));
  Append(zip, static_cast<uint32_t>(directory.size()));
  Append(zip, static_cast<uint32_t>(directory_at));
  Append(zip, uint16_t{0});  // comment
  return zip;
}

absl::Status WriteNpz(const std::string& path, const Npz& arrays, NpzCompression compression) {
  ASSIGN_OR_RETURN(const std::string bytes, EncodeNpz(arrays, compression));
  return WriteFile(path, bytes);
}

}  // namespace depthtween
