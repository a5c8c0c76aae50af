#include "core/render/stereo_format.h"

#include <algorithm>
#include <array>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/render/linear_light.h"

namespace depthtween {
namespace {

const std::array<StereoFormatFacts, 8>& AllFacts() {
  using enum StereoFormat;
  // Suffixes: the convention of players for headsets, as Pigasus, SKYBOX and DeoVR read it.
  static const std::array<StereoFormatFacts, 8> facts = {{
      {kFullSbs, "full-sbs", {"_LRF_Full_SBS"}, StereoPacking::kSideBySide, false},
      {kHalfSbs, "half-sbs", {"_LR"}, StereoPacking::kSideBySide, false},
      {kFullTb, "full-tb", {"_TBF_fulltb"}, StereoPacking::kTopBottom, false},
      {kHalfTb, "half-tb", {"_TB"}, StereoPacking::kTopBottom, false},
      {kAnaglyphDubois, "anaglyph-dubois", {"_redcyan"}, StereoPacking::kNone, true},
      {kAnaglyphHalfColor, "anaglyph-half-colour", {"_redcyan"}, StereoPacking::kNone, true},
      {kAnaglyphGrey, "anaglyph-grey", {"_redcyan"}, StereoPacking::kNone, true},
      {kSeparate, "separate", {"_left", "_right"}, StereoPacking::kNone, false},
  }};
  return facts;
}

void Paste(const Image<Rgb8>& from, int x0, int y0, Image<Rgb8>& into) {
  for (int y = 0; y < from.height(); ++y) std::copy_n(from.row(y), from.width(), into.row(y0 + y) + x0);
}

// Each pixel the mean of (x, y) and its neighbour at (dx, dy), where (x, y) steps over that neighbour.
Image<Rgb8> Squeeze(const Image<Rgb8>& image, int dx, int dy) {
  const LinearLight& light = LinearLight::Tables();
  Image<Rgb8> out((image.width() + dx) / (1 + dx), (image.height() + dy) / (1 + dy));
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x) {
      const int ax = x * (1 + dx), ay = y * (1 + dy);
      const Rgb8 a = image(ax, ay), b = image.view().Clamped(ax + dx, ay + dy);
      const auto mean = [&](uint8_t u, uint8_t v) { return light.Encode(0.5F * (light.Decode(u) + light.Decode(v))); };
      out(x, y) = {mean(a.r, b.r), mean(a.g, b.g), mean(a.b, b.b)};
    }
  return out;
}

Image<Rgb8> Join(const Image<Rgb8>& first, const Image<Rgb8>& second, bool beside) {
  Image<Rgb8> out(first.width() * (beside ? 2 : 1), first.height() * (beside ? 1 : 2));
  Paste(first, 0, 0, out);
  Paste(second, beside ? first.width() : 0, beside ? 0 : first.height(), out);
  return out;
}

template <typename Mix>
Image<Rgb8> MixEyes(const StereoPair& pair, const Mix& mix) {
  Image<Rgb8> out(pair.left.width(), pair.left.height());
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x) out(x, y) = mix(pair.left(x, y), pair.right(x, y));
  return out;
}

// Source: Dubois, A projection method to generate anaglyph stereo images, ICASSP 2001, with his published coefficients
// for red-cyan glasses on sRGB displays. They mix linear light.
constexpr float kDuboisLeft[3][3] = {
    {0.4561F, 0.500484F, 0.176381F}, {-0.0400822F, -0.0378246F, -0.0157589F}, {-0.0152161F, -0.0205971F, -0.00546856F}};
constexpr float kDuboisRight[3][3] = {
    {-0.0434706F, -0.0879388F, -0.00155529F}, {0.378476F, 0.73364F, -0.0184503F}, {-0.0721527F, -0.112961F, 1.2264F}};

Rgb8 Dubois(Rgb8 left, Rgb8 right) {
  const LinearLight& light = LinearLight::Tables();
  const float l[3] = {light.Decode(left.r), light.Decode(left.g), light.Decode(left.b)};
  const float r[3] = {light.Decode(right.r), light.Decode(right.g), light.Decode(right.b)};
  const auto channel = [&](int i) {
    float sum = 0;
    for (int k = 0; k < 3; ++k) sum += kDuboisLeft[i][k] * l[k] + kDuboisRight[i][k] * r[k];
    return light.Encode(sum);
  };
  return {channel(0), channel(1), channel(2)};
}

// BT.601, on coded values.
uint8_t LumaOf(Rgb8 c) { return static_cast<uint8_t>((299 * c.r + 587 * c.g + 114 * c.b + 500) / 1000); }

}  // namespace

std::span<const StereoFormatFacts> StereoFormats() { return AllFacts(); }

const StereoFormatFacts& FactsOf(StereoFormat format) { return AllFacts()[static_cast<size_t>(format)]; }

absl::StatusOr<StereoFormat> ParseStereoFormat(std::string_view name) {
  std::string names;
  for (const StereoFormatFacts& facts : StereoFormats()) {
    if (facts.name == name) return facts.format;
    absl::StrAppend(&names, names.empty() ? "" : ", ", std::string(facts.name));
  }
  return absl::InvalidArgumentError(absl::StrCat("format = \"", std::string(name), "\", must be one of ", names));
}

std::vector<Image<Rgb8>> PackStereo(StereoFormat format, const StereoPair& pair) {
  std::vector<Image<Rgb8>> out;
  switch (format) {
    case StereoFormat::kFullSbs:
      out.push_back(Join(pair.left, pair.right, /*beside=*/true));
      break;
    case StereoFormat::kHalfSbs:
      out.push_back(Join(Squeeze(pair.left, 1, 0), Squeeze(pair.right, 1, 0), /*beside=*/true));
      break;
    case StereoFormat::kFullTb:
      out.push_back(Join(pair.left, pair.right, /*beside=*/false));
      break;
    case StereoFormat::kHalfTb:
      out.push_back(Join(Squeeze(pair.left, 0, 1), Squeeze(pair.right, 0, 1), /*beside=*/false));
      break;
    case StereoFormat::kAnaglyphDubois:
      out.push_back(MixEyes(pair, Dubois));
      break;
    case StereoFormat::kAnaglyphHalfColor:
      out.push_back(MixEyes(pair, [](Rgb8 l, Rgb8 r) { return Rgb8{LumaOf(l), r.g, r.b}; }));
      break;
    case StereoFormat::kAnaglyphGrey:
      out.push_back(MixEyes(pair, [](Rgb8 l, Rgb8 r) { return Rgb8{LumaOf(l), LumaOf(r), LumaOf(r)}; }));
      break;
    case StereoFormat::kSeparate:
      out.push_back(pair.left.Clone());
      out.push_back(pair.right.Clone());
      break;
  }
  return out;
}

}  // namespace depthtween
