#include "depthtween/depthtween.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <optional>
#include <stop_token>

#include "absl/strings/str_format.h"

#include "core/api/make_upsampler.h"
#include "core/base/parallel.h"
#include "core/flow/one_opencv_thread.h"
#include "core/options/field_error.h"
#include "core/sequence/clock.h"
#include "core/sequence/interval.h"
#include "core/sequence/retold_source.h"

namespace depthtween {
namespace {

using nlohmann::json;
using PublicProvenance = DepthStream::Provenance;

static_assert(static_cast<int>(PublicProvenance::kNone) == static_cast<int>(Provenance::kNone) &&
              static_cast<int>(PublicProvenance::kMeasured) == static_cast<int>(Provenance::kMeasured) &&
              static_cast<int>(PublicProvenance::kBoth) == static_cast<int>(Provenance::kBoth) &&
              static_cast<int>(PublicProvenance::kOne) == static_cast<int>(Provenance::kOne) &&
              static_cast<int>(PublicProvenance::kInferred) == static_cast<int>(Provenance::kInferred) &&
              static_cast<int>(PublicProvenance::kHeld) == static_cast<int>(Provenance::kHeld) &&
              sizeof(PublicProvenance) == sizeof(Provenance));

constexpr int kMostNoiseFrames = 1000;

Status ToPublic(const absl::Status& status) {
  using Code = Status::Code;
  const std::string message(status.message());
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return {};
    case absl::StatusCode::kCancelled:
      return {Code::kCancelled, message};
    case absl::StatusCode::kInvalidArgument:
      return {Code::kInvalidArgument, message};
    case absl::StatusCode::kFailedPrecondition:
      return {Code::kFailedPrecondition, message};
    case absl::StatusCode::kResourceExhausted:
      return {Code::kResourceExhausted, message};
    default:
      return {Code::kInternal, message};
  }
}

// What `body`, which returns an absl::Status, returns or throws.
template <typename Body>
absl::Status WithoutExceptions(const Body& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory: use fewer threads or smaller images");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

// Where red, green and blue stand in a pixel.
struct Samples {
  int count, r, g, b;
};
Samples SamplesOf(DepthStream::Layout layout) {
  switch (layout) {
    case DepthStream::Layout::kGray:
      return {1, 0, 0, 0};
    case DepthStream::Layout::kRgb:
      return {3, 0, 1, 2};
    case DepthStream::Layout::kBgr:
      return {3, 2, 1, 0};
    case DepthStream::Layout::kRgba:
      return {4, 0, 1, 2};
    case DepthStream::Layout::kBgra:
      return {4, 2, 1, 0};
  }
  return {3, 0, 1, 2};
}

// A row of pixels of type T; memory of others need not be aligned for it.
template <typename T>
T PixelAt(const std::byte* row, int x) {
  T value;
  std::memcpy(&value, row + static_cast<size_t>(x) * sizeof(T), sizeof(T));
  return value;
}

// The frames that are held, oldest first.
class Window : public FrameSource {
 public:
  Sequence frames;
  std::deque<Image<Rgb8>> color;
  std::deque<Image<float>> depth_m;

  const Sequence& sequence() const override { return frames; }
  absl::StatusOr<Image<Rgb8>> Color(int index) const override { return color.at(index).Clone(); }
  absl::StatusOr<Image<float>> Depth(int index) const override { return depth_m.at(index).Clone(); }

  void Forget(int color_count, int depth_count) {
    frames.color.erase(frames.color.begin(), frames.color.begin() + color_count);
    frames.depth.erase(frames.depth.begin(), frames.depth.begin() + depth_count);
    color.erase(color.begin(), color.begin() + color_count);
    depth_m.erase(depth_m.begin(), depth_m.begin() + depth_count);
  }
};

// The same with the first depth frames alone.
RetoldSource FirstDepthFrames(const FrameSource& source, int count) {
  Sequence sequence = source.sequence();
  sequence.depth.resize(std::min(sequence.depth.size(), static_cast<size_t>(count)));
  return {source, std::move(sequence)};
}

// The options of the program that a stream has, as the program knows them.
UpsampleOptions ProgramOptions(const DepthStream::Options& options) {
  UpsampleOptions program;
  program.method = options.method;
  program.preset = options.preset;
  program.causal = options.causal;
  program.without = options.without;
  program.fill = options.fill;
  program.clock = options.clock;
  return program;
}

absl::Status Check(const DepthStream::Options& options) {
  RETURN_IF_ERROR(Validate(ProgramOptions(options)));
  ASSIGN_OR_RETURN(const ClockChoice clock, ParseClockChoice(options.clock));
  if (clock.mode != ClockChoice::Mode::kStamps && clock.mode != ClockChoice::Mode::kGiven)
    return FieldError("options.clock", absl::StrFormat("= '%s', must be 'stamps' or OFFSET_MS[,DRIFT_PPM]: the others "
                                                       "need the whole recording",
                                                       options.clock));
  if (options.threads < 0 || options.threads > kMaxThreads)
    return FieldError("options.threads", absl::StrFormat("= %d, must be 0 to %d", options.threads, kMaxThreads));
  if (options.noise_frames < 0 || options.noise_frames > kMostNoiseFrames)
    return FieldError("options.noise_frames",
                      absl::StrFormat("= %d, must be 0 to %d", options.noise_frames, kMostNoiseFrames));
  return absl::OkStatus();
}

// A whole number that is the stream's own, taken out of `document`.
absl::Status TakeNumber(json& document, const char* field, int& out) {
  const auto found = document.find(field);
  if (found == document.end()) return absl::OkStatus();
  if (!found->is_number_integer() || found->get<json::number_integer_t>() != found->get<int>())
    return FieldError(absl::StrCat("options.", field), "must be a whole number");
  out = found->get<int>();
  document.erase(found);
  return absl::OkStatus();
}

absl::Status Parse(std::string_view text, DepthStream::Options& options) {
  json document = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!document.is_object()) return absl::InvalidArgumentError("options: must be a JSON object");
  DepthStream::Options parsed = options;
  RETURN_IF_ERROR(TakeNumber(document, "threads", parsed.threads));
  RETURN_IF_ERROR(TakeNumber(document, "noise_frames", parsed.noise_frames));
  json filled = ToJson(ProgramOptions(options));
  filled.update(document);
  ASSIGN_OR_RETURN(const UpsampleOptions program, ParseUpsampleOptions(filled));
  parsed.method = program.method;
  parsed.preset = program.preset;
  parsed.causal = program.causal;
  parsed.without = program.without;
  parsed.fill = program.fill;
  parsed.clock = program.clock;
  // What a stream does not have must not be asked for.
  const json asked = ToJson(program), taken = ToJson(ProgramOptions(parsed));
  for (const auto& [field, value] : asked.items())
    if (value != taken.at(field)) return FieldError("options." + field, "is not for streams");
  RETURN_IF_ERROR(Check(parsed));
  options = std::move(parsed);
  return absl::OkStatus();
}

}  // namespace

class DepthStream::Impl {
 public:
  Impl(const Camera& camera, const Options& options, Callback callback)
      : options_(options), callback_(std::move(callback)) {
    window_.frames.camera = {.width = camera.width,
                             .height = camera.height,
                             .fx = camera.fx,
                             .fy = camera.fy,
                             .cx = camera.cx,
                             .cy = camera.cy,
                             .k1 = camera.k1,
                             .k2 = camera.k2,
                             .p1 = camera.p1,
                             .p2 = camera.p2,
                             .k3 = camera.k3};
    window_.frames.depth_scale = camera.depth_scale;
    ended_ = WithoutExceptions([&] { return Begin(); });
  }

  Status PushColor(int64_t time_ns, const uint8_t* pixels, ptrdiff_t row_bytes, Layout layout) {
    const Samples samples = SamplesOf(layout);
    return Guarded([&]() -> absl::Status {
      RETURN_IF_ERROR(CheckFrame("color", last_color_ns_, time_ns, pixels, row_bytes, samples.count));
      return Go([&] {
        Image<Rgb8> image(width(), height());
        for (int y = 0; y < height(); ++y) {
          const uint8_t* pixel = pixels + y * row_bytes;
          for (int x = 0; x < width(); ++x, pixel += samples.count)
            image(x, y) = {pixel[samples.r], pixel[samples.g], pixel[samples.b]};
        }
        if (!last_color_ns_) {
          // Clocks are compared at the first colour frame.
          clock_.reference_ns = time_ns;
          for (FrameRef& frame : window_.frames.depth) frame.time_ns = clock_.ColorTime(frame.time_ns);
        }
        last_color_ns_ = time_ns;
        window_.frames.color.push_back({time_ns, absl::StrFormat("colour frame at %s s", FormatSeconds(time_ns))});
        window_.color.push_back(std::move(image));
        return Advance(/*at_end=*/false);
      });
    });
  }

  template <typename T, typename ToMetres>
  Status PushDepth(int64_t time_ns, const T* pixels, ptrdiff_t row_bytes, const ToMetres& to_metres) {
    return Guarded([&]() -> absl::Status {
      RETURN_IF_ERROR(CheckFrame("depth", last_depth_ns_, time_ns, pixels, row_bytes, sizeof(T)));
      return Go([&] {
        Image<float> image(width(), height());
        for (int y = 0; y < height(); ++y) {
          const auto* const row = reinterpret_cast<const std::byte*>(pixels) + y * row_bytes;
          for (int x = 0; x < width(); ++x) image(x, y) = to_metres(PixelAt<T>(row, x));
        }
        last_depth_ns_ = time_ns;
        window_.frames.depth.push_back({last_color_ns_ ? clock_.ColorTime(time_ns) : time_ns,
                                        absl::StrFormat("depth frame at %s s", FormatSeconds(time_ns))});
        window_.depth_m.push_back(std::move(image));
        return Advance(/*at_end=*/false);
      });
    });
  }

  Status Finish() {
    return Guarded([&]() -> absl::Status {
      if (!last_color_ns_ || !last_depth_ns_)
        return End(absl::FailedPreconditionError("no colour or no depth frame was pushed"));
      return Go([&]() -> absl::Status {
        if (options_.noise_frames == 0) {
          RETURN_IF_ERROR(Validate(window_.frames));
          window_.frames = PairDepthWithinJitter(window_.frames);
        }
        RETURN_IF_ERROR(Advance(/*at_end=*/true));
        finished_ = true;
        window_.Forget(static_cast<int>(window_.color.size()), static_cast<int>(window_.depth_m.size()));
        return absl::OkStatus();
      });
    });
  }

  void Cancel() { stop_.request_stop(); }
  const std::vector<std::string>& warnings() const { return warnings_; }
  double depth_scale() const { return window_.frames.depth_scale; }

 private:
  int width() const { return window_.frames.camera.width; }
  int height() const { return window_.frames.camera.height; }

  absl::Status Begin() {
    RETURN_IF_ERROR(window_.frames.camera.Validate());
    if (!std::isfinite(depth_scale()) || depth_scale() <= 0)
      return absl::InvalidArgumentError(
          absl::StrFormat("camera.depth_scale = %g, must be positive: units per metre", depth_scale()));
    RETURN_IF_ERROR(Check(options_));
    if (!callback_) return absl::InvalidArgumentError("callback is empty, must be a function");
    ASSIGN_OR_RETURN(const ClockChoice clock, ParseClockChoice(options_.clock));
    clock_ = {.offset_ns = 1e6 * clock.offset_ms, .drift_ppm = clock.drift_ppm};
    if (options_.threads == 0) options_.threads = std::min(AvailableThreads(), kMaxThreads);
    ASSIGN_OR_RETURN(upsampler_, MakeUpsampler(ProgramOptions(options_)));
    return absl::OkStatus();
  }

  // Answers a call: with the error that ended the stream, or with what `body` returns.
  template <typename Body>
  Status Guarded(const Body& body) {
    if (!ended_.ok()) return ToPublic(ended_);
    if (finished_) return {Status::Code::kFailedPrecondition, "the stream was finished"};
    return ToPublic(WithoutExceptions(body));
  }
  absl::Status End(absl::Status error) { return ended_ = std::move(error); }
  // An error of `body` ends the stream.
  template <typename Body>
  absl::Status Go(const Body& body) {
    absl::Status status = WithoutExceptions(body);
    return status.ok() ? status : End(std::move(status));
  }

  absl::Status CheckFrame(const char* what, std::optional<int64_t> last_ns, int64_t time_ns, const void* pixels,
                          ptrdiff_t row_bytes, ptrdiff_t pixel_bytes) const {
    if (last_ns && time_ns <= *last_ns)
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: time_ns = %d, must be later than %d of the frame before", what, time_ns, *last_ns));
    if (pixels == nullptr) return absl::InvalidArgumentError(absl::StrFormat("%s: pixels is null", what));
    if (std::abs(row_bytes) < width() * pixel_bytes)
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: row_bytes = %d, must be at least %d (width x bytes a pixel)", what, row_bytes, width() * pixel_bytes));
    return absl::OkStatus();
  }

  // Delivers every interval that all is there for.
  absl::Status Advance(bool at_end) {
    if (!at_end && options_.noise_frames == 0) return absl::OkStatus();
    while (const std::optional<Interval> interval = NextInterval(at_end)) {
      const OneOpenCvThread one_thread;
      if (!constants_) {
        const int frames = options_.noise_frames == 0 ? static_cast<int>(window_.frames.depth.size())
                           : options_.causal          ? 1
                                                      : options_.noise_frames;
        ASSIGN_OR_RETURN(constants_, EstimateClipConstants(FirstDepthFrames(window_, frames), options_.causal));
        warnings_ = constants_->warnings;
      }
      RETURN_IF_ERROR(upsampler_
                          ->Run(window_, *constants_, *interval,
                                {.threads = options_.threads, .stop = stop_.get_token()},
                                [&](const DepthResult& result) { return Deliver(result); })
                          .status());
      next_frame_ = interval->first_frame + interval->frame_count;
      ForgetBefore(*interval);
    }
    return absl::OkStatus();
  }

  // Whether depth frame `index` came, and the colour frames around it.
  bool Came(int index) const {
    return index < static_cast<int>(window_.frames.depth.size()) && !window_.frames.color.empty() &&
           window_.frames.color.back().time_ns >= window_.frames.depth[index].time_ns;
  }

  // The frames to answer next, if nothing that comes later could change their answer.
  std::optional<Interval> NextInterval(bool at_end) const {
    if (next_frame_ >= static_cast<int>(window_.frames.color.size())) return std::nullopt;
    if (!at_end && !constants_ && !Came(options_.causal ? 0 : options_.noise_frames - 1)) return std::nullopt;
    const std::vector<Interval> intervals = PlanIntervals(window_.frames);
    Interval next = *std::find_if(intervals.begin(), intervals.end(), [&](const Interval& interval) {
      return next_frame_ < interval.first_frame + interval.frame_count;
    });
    next.frame_count -= next_frame_ - next.first_frame;
    next.first_frame = next_frame_;
    if (at_end) return next;
    if (next.key_after < 0) return std::nullopt;
    // The last depth frame's own colour frame belongs to the interval before it (PlanIntervals), which shows only when
    // another follows or the stream ends. In causal mode that does not matter: it is answered with what follows it.
    if (!Came(next.key_after + (options_.causal ? 0 : std::max(1, upsampler_->reach().after)))) return std::nullopt;
    if (window_.frames.color[next.first_frame + next.frame_count - 1].time_ns >=
        window_.frames.depth[next.key_after].time_ns)
      --next.frame_count;
    return next.frame_count > 0 ? std::optional(next) : std::nullopt;
  }

  absl::Status Deliver(const DepthResult& result) {
    const Frame frame{.time_ns = window_.frames.color[result.color_index].time_ns,
                      .width = result.depth_m.width(),
                      .height = result.depth_m.height(),
                      .depth_m = result.depth_m.data(),
                      .sigma_m = result.sigma_m.data(),
                      .provenance = reinterpret_cast<const PublicProvenance*>(result.provenance.data())};
    if (stop_.stop_requested() || !callback_(frame)) return absl::CancelledError("cancelled by the caller");
    return absl::OkStatus();
  }

  // Lets go of what no interval after `done` looks at.
  void ForgetBefore(const Interval& done) {
    const int oldest = std::max(0, done.key_before - upsampler_->reach().before);
    // One frame more than the nearest: towards it a depth frame between the two is moved.
    const int color =
        std::min(next_frame_, NearestColorFrame(window_.frames, window_.frames.depth[oldest].time_ns) - 1);
    window_.Forget(std::max(0, color), oldest);
    next_frame_ -= std::max(0, color);
  }

  Options options_;
  const Callback callback_;
  ClockModel clock_;
  std::unique_ptr<const Upsampler> upsampler_;
  std::stop_source stop_;

  Window window_;
  int next_frame_ = 0;  // into the window's colour frames: the first without an answer
  std::optional<int64_t> last_color_ns_, last_depth_ns_;  // as pushed
  std::optional<ClipConstants> constants_;
  std::vector<std::string> warnings_;
  bool finished_ = false;
  absl::Status ended_;
};

Status DepthStream::ParseOptions(std::string_view json, Options& options) {
  return ToPublic(WithoutExceptions([&] { return Parse(json, options); }));
}

DepthStream::DepthStream(const Camera& camera, const Options& options, Callback callback)
    : impl_(std::make_unique<Impl>(camera, options, std::move(callback))) {}
DepthStream::~DepthStream() = default;
DepthStream::DepthStream(DepthStream&&) noexcept = default;
DepthStream& DepthStream::operator=(DepthStream&&) noexcept = default;

Status DepthStream::PushColor(int64_t time_ns, const uint8_t* pixels, ptrdiff_t row_bytes, Layout layout) {
  return impl_->PushColor(time_ns, pixels, row_bytes, layout);
}

Status DepthStream::PushDepth(int64_t time_ns, const uint16_t* units, ptrdiff_t row_bytes) {
  return impl_->PushDepth(time_ns, units, row_bytes,
                          [scale = impl_->depth_scale()](uint16_t value) { return static_cast<float>(value / scale); });
}

Status DepthStream::PushDepth(int64_t time_ns, const float* metres, ptrdiff_t row_bytes) {
  return impl_->PushDepth(time_ns, metres, row_bytes,
                          [](float value) { return std::isfinite(value) && value > 0 ? value : 0.0F; });
}

Status DepthStream::Finish() { return impl_->Finish(); }
void DepthStream::Cancel() { impl_->Cancel(); }
const std::vector<std::string>& DepthStream::warnings() const { return impl_->warnings(); }

}  // namespace depthtween
