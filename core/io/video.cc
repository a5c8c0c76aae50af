#include "core/io/video.h"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "absl/strings/str_format.h"

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
}

namespace depthtween {
namespace {

// In order of preference: every browser plays H.264. Which of them exist depends on how libavcodec was built.
constexpr const char* kEncoders[] = {"libx264", "libopenh264", "mpeg4"};

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
  bool file_exists = false;    // unfinished_path is ours to remove

  ~Impl() {
    format.reset();
    if (file_exists) std::remove(unfinished_path.c_str());
  }

  absl::Status OpenEncoder(int width, int height, int frames_per_second) {
    for (const char* name : kEncoders) {
      const AVCodec* encoder = avcodec_find_encoder_by_name(name);
      if (encoder == nullptr) continue;
      codec.reset(avcodec_alloc_context3(encoder));
      codec->width = width;
      codec->height = height;
      codec->pix_fmt = AV_PIX_FMT_YUV420P;
      codec->time_base = {1, frames_per_second};
      codec->framerate = {frames_per_second, 1};
      codec->gop_size = frames_per_second;  // a player can jump to every second
      codec->color_range = AVCOL_RANGE_MPEG;
      codec->colorspace = AVCOL_SPC_BT709;
      codec->color_primaries = AVCOL_PRI_BT709;
      codec->color_trc = AVCOL_TRC_BT709;
      codec->bit_rate = static_cast<int64_t>(width) * height * frames_per_second / 4;  // for encoders that ignore crf
      if (format->oformat->flags & AVFMT_GLOBALHEADER) codec->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
      av_opt_set(codec->priv_data, "crf", "18", 0);  // visually lossless; unknown to other encoders, which is fine
      if (avcodec_open2(codec.get(), encoder, nullptr) >= 0) return absl::OkStatus();
    }
    return absl::UnimplementedError(
        "the installed libavcodec has no encoder for MP4 (looked for libx264, libopenh264 and mpeg4): write a .png "
        "instead");
  }

  // Sends a frame, or null for the end, and writes what the encoder gives back.
  absl::Status Encode(const AVFrame* input) {
    RETURN_IF_ERROR(AvStatus(avcodec_send_frame(codec.get(), input), "encoding " + path));
    while (true) {
      const int received = avcodec_receive_packet(codec.get(), packet.get());
      if (received == AVERROR(EAGAIN) || received == AVERROR_EOF) return absl::OkStatus();
      RETURN_IF_ERROR(AvStatus(received, "encoding " + path));
      packet->duration = 1;  // in the encoder's time base; without it the last frame has no length
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

absl::StatusOr<VideoWriter> VideoWriter::Create(const std::string& path, int width, int height, int frames_per_second) {
  if (width <= 0 || height <= 0 || width % 2 != 0 || height % 2 != 0)
    return absl::InvalidArgumentError(
        absl::StrFormat("video size = %d x %d, must be positive and even", width, height));
  if (frames_per_second <= 0)
    return absl::InvalidArgumentError(absl::StrFormat("frames_per_second = %d, must be positive", frames_per_second));
  av_log_set_level(AV_LOG_ERROR);  // encoders chat on stderr, between the lines of the program

  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->unfinished_path = absl::StrCat(path, ".", getpid(), ".tmp");
  AVFormatContext* format = nullptr;
  RETURN_IF_ERROR(AvStatus(avformat_alloc_output_context2(&format, nullptr, "mp4", impl->unfinished_path.c_str()),
                           "opening " + path));
  impl->format.reset(format);
  RETURN_IF_ERROR(impl->OpenEncoder(width, height, frames_per_second));

  impl->stream = avformat_new_stream(format, nullptr);
  impl->frame.reset(av_frame_alloc());
  impl->packet.reset(av_packet_alloc());
  impl->scaler.reset(sws_getContext(width, height, AV_PIX_FMT_RGB24, width, height, AV_PIX_FMT_YUV420P,
                                    SWS_BICUBIC | SWS_ACCURATE_RND, nullptr, nullptr, nullptr));
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
  impl->frame->width = width;
  impl->frame->height = height;
  impl->frame->pts = 0;
  RETURN_IF_ERROR(AvStatus(av_frame_get_buffer(impl->frame.get(), 0), "opening " + path));

  RETURN_IF_ERROR(AvStatus(avio_open(&format->pb, impl->unfinished_path.c_str(), AVIO_FLAG_WRITE), "creating " + path));
  impl->file_exists = true;
  AVDictionary* options = nullptr;
  av_dict_set(&options, "movflags", "+faststart", 0);  // the index first: plays while it loads
  const int header = avformat_write_header(format, &options);
  av_dict_free(&options);
  RETURN_IF_ERROR(AvStatus(header, "writing " + path));
  return VideoWriter(std::move(impl));
}

absl::Status VideoWriter::Write(ImageView<const Rgb8> image) {
  AVFrame* const frame = impl_->frame.get();
  if (image.width() != frame->width || image.height() != frame->height)
    return absl::InvalidArgumentError(absl::StrFormat("frame is %d x %d, must be %d x %d as the video", image.width(),
                                                      image.height(), frame->width, frame->height));
  RETURN_IF_ERROR(AvStatus(av_frame_make_writable(frame), "encoding " + impl_->path));
  const uint8_t* const source[] = {reinterpret_cast<const uint8_t*>(image.data())};
  const int source_stride[] = {static_cast<int>(image.stride() * static_cast<ptrdiff_t>(sizeof(Rgb8)))};
  sws_scale(impl_->scaler.get(), source, source_stride, 0, frame->height, frame->data, frame->linesize);
  const absl::Status encoded = impl_->Encode(frame);
  ++frame->pts;
  return encoded;
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
