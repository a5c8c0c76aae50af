#include "core/io/video.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <utility>

#include "absl/strings/str_format.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libavutil/stereo3d.h>
#include <libswscale/swscale.h>
}

namespace depthtween {
namespace {

// In order of preference: every browser plays H.264. Which of them exist depends on how libavcodec was built.
constexpr const char* kMp4Encoders[] = {"libx264", "libopenh264", "mpeg4"};
constexpr const char* kLosslessEncoders[] = {"ffv1"};

constexpr double kNamedRateTolerance = 1e-3;  // a camera's clock is far better; the stamps of a short clip are not
// Stamps of a camera that keeps its rate wander by less than half a period. The others get a clock whose ticks are
// whole for all rates in use, and which MPEG-4 can still say.
constexpr double kMostWanderPeriods = 0.75;
constexpr int kFineRate = 60'000;
constexpr int kMaxRate = 100'000;  // of a clock faster than that the stamps say nothing

struct FreeFormat {
  void operator()(AVFormatContext* context) const {
    if (context->pb != nullptr) avio_closep(&context->pb);
    avformat_free_context(context);
  }
};
struct FreeCodec {
  void operator()(AVCodecContext* context) const { avcodec_free_context(&context); }
};
struct FreeFrame {
  void operator()(AVFrame* frame) const { av_frame_free(&frame); }
};
struct FreePacket {
  void operator()(AVPacket* packet) const { av_packet_free(&packet); }
};
struct FreeScaler {
  void operator()(SwsContext* context) const { sws_freeContext(context); }
};

// The rate that cameras have a name for, or else the nearest thousandth.
FrameRate NamedRate(double per_second) {
  const double whole = std::max(1.0, std::round(per_second));
  if (whole > kMaxRate) return {.numerator = kMaxRate, .denominator = 1};
  const FrameRate plain = {.numerator = static_cast<int>(whole), .denominator = 1};
  const FrameRate television = {.numerator = static_cast<int>(whole) * 1000, .denominator = 1001};
  const auto distance = [per_second](const FrameRate& rate) { return std::abs(rate.PerSecond() - per_second); };
  const FrameRate& nearest = distance(plain) <= distance(television) ? plain : television;
  if (distance(nearest) <= kNamedRateTolerance * per_second) return nearest;
  int numerator = 0, denominator = 1;
  av_reduce(&numerator, &denominator, std::max<int64_t>(1, std::llround(per_second * 1000)), 1000, 1 << 30);
  return {.numerator = numerator, .denominator = denominator};
}

// The tick of each stamp, and how far from it the worst one is, ns.
double CountTicks(const std::vector<int64_t>& time_ns, FrameClock& clock) {
  const double period_ns = 1e9 / clock.tick_rate.PerSecond();
  double worst_ns = 0;
  for (size_t i = 1; i < time_ns.size(); ++i) {
    const auto since_ns = static_cast<double>(time_ns[i] - time_ns[0]);
    clock.ticks[i] = std::max(clock.ticks[i - 1] + 1, static_cast<int64_t>(std::llround(since_ns / period_ns)));
    worst_ns = std::max(worst_ns, std::abs(static_cast<double>(clock.ticks[i]) * period_ns - since_ns));
  }
  return worst_ns;
}

AVRational TickRate(const VideoOptions& options) {
  const FrameRate& rate = options.tick_rate.numerator > 0 ? options.tick_rate : options.frame_rate;
  return {rate.numerator, rate.denominator};
}

AVStereo3DType StereoType(VideoStereo stereo) {
  return stereo == VideoStereo::kTopBottom ? AV_STEREO3D_TOPBOTTOM : AV_STEREO3D_SIDEBYSIDE;
}

absl::Status AvStatus(int error, std::string_view what) {
  if (error >= 0) return absl::OkStatus();
  const int system_error = AVUNERROR(error);
  if (system_error == ENOENT || system_error == ENOSPC || system_error == EACCES || system_error == EDQUOT)
    return ErrnoStatus(system_error, what);
  char text[AV_ERROR_MAX_STRING_SIZE] = {};
  av_strerror(error, text, sizeof(text));
  return absl::InternalError(absl::StrCat(absl::string_view(what.data(), what.size()), ": ", text));
}

}  // namespace

struct VideoWriter::Impl {
  std::string path, unfinished_path;
  std::unique_ptr<AVFormatContext, FreeFormat> format;
  std::unique_ptr<AVCodecContext, FreeCodec> codec;
  std::unique_ptr<AVFrame, FreeFrame> frame;
  std::unique_ptr<AVPacket, FreePacket> packet;
  std::unique_ptr<SwsContext, FreeScaler> scaler;
  AVStream* stream = nullptr;  // of format
  int64_t last_tick = -1;      // of the frame written last
  int64_t usual_ticks = 1;     // from frame to frame
  bool file_exists = false;    // unfinished_path is ours to remove

  ~Impl() {
    format.reset();
    if (file_exists) std::remove(unfinished_path.c_str());
  }

  absl::Status OpenEncoder(const VideoOptions& options) {
    const bool lossless = options.container == VideoContainer::kMatroska;
    const auto& [names, count] = lossless ? std::pair(kLosslessEncoders, std::size(kLosslessEncoders))
                                          : std::pair(kMp4Encoders, std::size(kMp4Encoders));
    for (size_t i = 0; i < count; ++i) {
      const AVCodec* encoder = avcodec_find_encoder_by_name(names[i]);
      if (encoder == nullptr) continue;
      codec.reset(avcodec_alloc_context3(encoder));
      codec->width = options.width;
      codec->height = options.height;
      codec->pix_fmt = lossless ? AV_PIX_FMT_0RGB32 : options.full_chroma ? AV_PIX_FMT_YUV444P : AV_PIX_FMT_YUV420P;
      codec->framerate = {options.frame_rate.numerator, options.frame_rate.denominator};
      codec->time_base = av_inv_q(TickRate(options));
      // A player can jump to every second.
      codec->gop_size = lossless ? 1 : std::max(1, static_cast<int>(std::lround(options.frame_rate.PerSecond())));
      codec->thread_count = 1;  // x264 decides otherwise on another number of threads, and FFV1 cuts other slices
      if (!lossless) {
        codec->color_range = AVCOL_RANGE_MPEG;
        codec->colorspace = AVCOL_SPC_BT709;
        codec->color_primaries = AVCOL_PRI_BT709;
        codec->color_trc = AVCOL_TRC_BT709;
        // For encoders that ignore crf.
        codec->bit_rate = static_cast<int64_t>(options.frame_rate.PerSecond() * options.width * options.height / 4);
      }
      if (format->oformat->flags & AVFMT_GLOBALHEADER) codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
      av_opt_set(codec->priv_data, "crf", "18", 0);  // visually lossless; unknown to other encoders, which is fine
      if (avcodec_open2(codec.get(), encoder, nullptr) >= 0) return absl::OkStatus();
    }
    return absl::UnimplementedError(
        lossless ? "the installed libavcodec has no FFV1 encoder for Matroska: write images instead"
        : options.full_chroma
            ? "the installed libavcodec has no H.264 encoder with full chroma (libx264): write .mkv or images instead"
            : "the installed libavcodec has no encoder for MP4 (looked for libx264, libopenh264 and mpeg4): write .mkv "
              "or images instead");
  }

  // Before the header is written: Matroska's StereoMode and MP4's st3d come from the stream.
  absl::Status DescribeStereo(VideoStereo stereo) {
    size_t size = 0;
    AVStereo3D* const description = av_stereo3d_alloc();
    if (description != nullptr) {
      description->type = StereoType(stereo);
      size = sizeof(*description);
      if (av_stream_add_side_data(stream, AV_PKT_DATA_STEREO3D, reinterpret_cast<uint8_t*>(description), size) >= 0) {
        // The encoder's own mark, for players that look at H.264 only; others ignore it.
        AVStereo3D* const packing = av_stereo3d_create_side_data(frame.get());
        if (packing != nullptr) {
          packing->type = StereoType(stereo);
          return absl::OkStatus();
        }
      } else {
        av_free(description);
      }
    }
    return absl::ResourceExhaustedError("out of memory while opening " + path);
  }

  // Sends a frame, or null for the end, and writes what the encoder gives back.
  absl::Status Encode(const AVFrame* input) {
    RETURN_IF_ERROR(AvStatus(avcodec_send_frame(codec.get(), input), "encoding " + path));
    while (true) {
      const int received = avcodec_receive_packet(codec.get(), packet.get());
      if (received == AVERROR(EAGAIN) || received == AVERROR_EOF) return absl::OkStatus();
      RETURN_IF_ERROR(AvStatus(received, "encoding " + path));
      packet->duration = usual_ticks;  // without it the last frame has no length
      av_packet_rescale_ts(packet.get(), codec->time_base, stream->time_base);
      packet->stream_index = stream->index;
      RETURN_IF_ERROR(AvStatus(av_interleaved_write_frame(format.get(), packet.get()), "writing " + path));
    }
  }
};

VideoWriter::VideoWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
VideoWriter::~VideoWriter() = default;
VideoWriter::VideoWriter(VideoWriter&&) noexcept = default;
VideoWriter& VideoWriter::operator=(VideoWriter&&) noexcept = default;

FrameClock ClockOf(const std::vector<int64_t>& time_ns) {
  FrameClock clock;
  clock.ticks.assign(time_ns.size(), 0);
  if (time_ns.size() < 2) return clock;
  // The median counts the periods, because a dropped frame makes one long; the line through all stamps measures them,
  // because a stamp of 1 us that wanders says little about one period and much about many.
  std::vector<int64_t> periods;
  for (size_t i = 1; i < time_ns.size(); ++i) periods.push_back(std::max<int64_t>(1, time_ns[i] - time_ns[i - 1]));
  const auto middle = periods.begin() + static_cast<ptrdiff_t>(periods.size() / 2);
  std::nth_element(periods.begin(), middle, periods.end());
  const auto median_ns = static_cast<double>(*middle);
  std::vector<double> count = {0.0};
  for (size_t i = 1; i < time_ns.size(); ++i)
    count.push_back(count.back() +
                    std::max(1.0, std::round(static_cast<double>(time_ns[i] - time_ns[i - 1]) / median_ns)));
  double mean_count = 0, mean_ns = 0, covariance = 0, variance = 0;
  const auto since_first = [&](size_t i) { return static_cast<double>(time_ns[i] - time_ns[0]); };
  for (size_t i = 0; i < count.size(); ++i) {
    mean_count += count[i] / static_cast<double>(count.size());
    mean_ns += since_first(i) / static_cast<double>(count.size());
  }
  for (size_t i = 0; i < count.size(); ++i) {
    covariance += (count[i] - mean_count) * (since_first(i) - mean_ns);
    variance += (count[i] - mean_count) * (count[i] - mean_count);
  }
  clock.rate = clock.tick_rate = NamedRate(1e9 * variance / covariance);
  if (CountTicks(time_ns, clock) <= kMostWanderPeriods * 1e9 / clock.rate.PerSecond()) return clock;
  clock.rate = NamedRate(1e9 * static_cast<double>(time_ns.size() - 1) / since_first(time_ns.size() - 1));
  clock.tick_rate = {.numerator = kFineRate, .denominator = 1};
  CountTicks(time_ns, clock);
  return clock;
}

absl::Status VideoOptions::Validate() const {
  const bool halved = container == VideoContainer::kMp4 && !full_chroma;
  if (width <= 0 || height <= 0 || (halved && (width % 2 != 0 || height % 2 != 0)))
    return absl::InvalidArgumentError(absl::StrFormat("video size = %d x %d, must be positive%s", width, height,
                                                      halved ? " and even (or write .mkv)" : ""));
  if (frame_rate.numerator <= 0 || frame_rate.denominator <= 0)
    return absl::InvalidArgumentError(absl::StrFormat("frame_rate = %d/%d frames per second, must be positive",
                                                      frame_rate.numerator, frame_rate.denominator));
  return absl::OkStatus();
}

absl::StatusOr<VideoWriter> VideoWriter::Create(const std::string& path, const VideoOptions& options) {
  RETURN_IF_ERROR(options.Validate());
  av_log_set_level(AV_LOG_ERROR);  // encoders chat on stderr, between the lines of the program

  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->unfinished_path = absl::StrCat(path, ".", getpid(), ".tmp");
  const bool mp4 = options.container == VideoContainer::kMp4;
  AVFormatContext* format = nullptr;
  RETURN_IF_ERROR(AvStatus(
      avformat_alloc_output_context2(&format, nullptr, mp4 ? "mp4" : "matroska", impl->unfinished_path.c_str()),
      "opening " + path));
  impl->format.reset(format);
  format->flags |= AVFMT_FLAG_BITEXACT;  // no random identity in Matroska
  RETURN_IF_ERROR(impl->OpenEncoder(options));
  impl->usual_ticks = std::max<int64_t>(1, std::llround(av_q2d(TickRate(options)) / options.frame_rate.PerSecond()));

  impl->stream = avformat_new_stream(format, nullptr);
  impl->frame.reset(av_frame_alloc());
  impl->packet.reset(av_packet_alloc());
  impl->scaler.reset(sws_getContext(options.width, options.height, AV_PIX_FMT_RGB24, options.width, options.height,
                                    impl->codec->pix_fmt, SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP, nullptr,
                                    nullptr, nullptr));
  if (!impl->stream || !impl->frame || !impl->packet || !impl->scaler)
    return absl::ResourceExhaustedError("out of memory while opening " + path);
  // RGB is full range; the video is BT.709 in limited range, as players expect.
  const int* bt709 = sws_getCoefficients(SWS_CS_ITU709);
  sws_setColorspaceDetails(impl->scaler.get(), bt709, 1, bt709, 0, 0, 1 << 16, 1 << 16);
  impl->stream->time_base = impl->codec->time_base;
  impl->stream->avg_frame_rate = impl->codec->framerate;
  RETURN_IF_ERROR(
      AvStatus(avcodec_parameters_from_context(impl->stream->codecpar, impl->codec.get()), "opening " + path));
  impl->frame->format = impl->codec->pix_fmt;
  impl->frame->width = options.width;
  impl->frame->height = options.height;
  RETURN_IF_ERROR(AvStatus(av_frame_get_buffer(impl->frame.get(), 0), "opening " + path));
  if (options.stereo != VideoStereo::kNone) RETURN_IF_ERROR(impl->DescribeStereo(options.stereo));

  RETURN_IF_ERROR(AvStatus(avio_open(&format->pb, impl->unfinished_path.c_str(), AVIO_FLAG_WRITE), "creating " + path));
  impl->file_exists = true;
  AVDictionary* muxer = nullptr;
  if (mp4) {
    av_dict_set(&muxer, "movflags", "+faststart", 0);  // the index first: plays while it loads
    // Wide enough for every rate there is: MP4 rounds stamps to its own clock.
    av_dict_set_int(&muxer, "video_track_timescale", TickRate(options).num, 0);
    av_dict_set(&muxer, "strict", "unofficial", 0);  // st3d, the stereo mark, is Google's and no part of the standard
  }
  const int header = avformat_write_header(format, &muxer);
  av_dict_free(&muxer);
  RETURN_IF_ERROR(AvStatus(header, "writing " + path));
  return VideoWriter(std::move(impl));
}

absl::Status VideoWriter::Write(ImageView<const Rgb8> image) {
  return Write(image, impl_->last_tick < 0 ? 0 : impl_->last_tick + impl_->usual_ticks);
}

absl::Status VideoWriter::Write(ImageView<const Rgb8> image, int64_t tick) {
  AVFrame* const frame = impl_->frame.get();
  if (image.width() != frame->width || image.height() != frame->height)
    return absl::InvalidArgumentError(absl::StrFormat("frame is %d x %d, must be %d x %d as the video", image.width(),
                                                      image.height(), frame->width, frame->height));
  if (tick <= impl_->last_tick)
    return absl::InvalidArgumentError(
        absl::StrFormat("tick = %d, must be after the frame before, which has %d", tick, impl_->last_tick));
  RETURN_IF_ERROR(AvStatus(av_frame_make_writable(frame), "encoding " + impl_->path));
  const uint8_t* const source[] = {reinterpret_cast<const uint8_t*>(image.data())};
  const int source_stride[] = {static_cast<int>(image.stride() * static_cast<ptrdiff_t>(sizeof(Rgb8)))};
  sws_scale(impl_->scaler.get(), source, source_stride, 0, frame->height, frame->data, frame->linesize);
  frame->pts = tick;
  impl_->last_tick = tick;
  return impl_->Encode(frame);
}

absl::Status VideoWriter::Finish() {
  RETURN_IF_ERROR(impl_->Encode(nullptr));
  RETURN_IF_ERROR(AvStatus(av_write_trailer(impl_->format.get()), "writing " + impl_->path));
  RETURN_IF_ERROR(AvStatus(avio_closep(&impl_->format->pb), "writing " + impl_->path));
  if (std::rename(impl_->unfinished_path.c_str(), impl_->path.c_str()) != 0)
    return ErrnoStatus(errno, "renaming " + impl_->unfinished_path + " to " + impl_->path);
  impl_->file_exists = false;
  return absl::OkStatus();
}

std::string_view VideoWriter::encoder() const { return impl_->codec->codec->name; }

}  // namespace depthtween
