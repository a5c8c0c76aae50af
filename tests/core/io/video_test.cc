// Videos, decoded by libav alone: what comes out is what went in.
#include "core/io/video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/stereo3d.h>
}

#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class VideoTest : public testing::Test {
 protected:
  TemporaryFolder dir_;
};

struct DecodedVideo {
  int frames = 0, width = 0, height = 0;
  double seconds = 0.0;
  AVRational rate = {0, 1};
  AVPixelFormat pixel_format = AV_PIX_FMT_NONE;
  int stereo_of_stream = -1, stereo_of_frame = -1;  // AVStereo3DType
  std::vector<double> shown_s;                      // when each frame is shown
  int first_luma = -1;                              // at the centre of the first frame
  std::vector<Rgb8> first_row;                      // of the first frame, where its pixels are stored as BGR0
};

// Decodes with libav alone, so that the writer is not its own judge.
DecodedVideo Decode(const std::string& path) {
  DecodedVideo decoded;
  AVFormatContext* format = nullptr;
  if (avformat_open_input(&format, path.c_str(), nullptr, nullptr) < 0) return decoded;
  avformat_find_stream_info(format, nullptr);
  const AVStream* stream = format->streams[0];
  const AVCodecParameters* parameters = stream->codecpar;
  AVCodecContext* codec = avcodec_alloc_context3(avcodec_find_decoder(parameters->codec_id));
  avcodec_parameters_to_context(codec, parameters);
  avcodec_open2(codec, nullptr, nullptr);
  decoded.width = parameters->width;
  decoded.height = parameters->height;
  decoded.seconds = static_cast<double>(format->duration) / AV_TIME_BASE;
  decoded.rate = stream->avg_frame_rate;
  if (const uint8_t* mark = av_stream_get_side_data(stream, AV_PKT_DATA_STEREO3D, nullptr))
    decoded.stereo_of_stream = reinterpret_cast<const AVStereo3D*>(mark)->type;
  AVPacket* packet = av_packet_alloc();
  AVFrame* frame = av_frame_alloc();
  const auto drain = [&] {
    while (avcodec_receive_frame(codec, frame) >= 0) {
      decoded.shown_s.push_back(static_cast<double>(frame->best_effort_timestamp) * av_q2d(stream->time_base));
      if (decoded.frames++ > 0) continue;
      decoded.pixel_format = static_cast<AVPixelFormat>(frame->format);
      decoded.first_luma = frame->data[0][frame->height / 2 * frame->linesize[0] + frame->width / 2];
      if (const AVFrameSideData* mark = av_frame_get_side_data(frame, AV_FRAME_DATA_STEREO3D))
        decoded.stereo_of_frame = reinterpret_cast<const AVStereo3D*>(mark->data)->type;
      if (frame->format != AV_PIX_FMT_0RGB32) continue;
      for (int x = 0; x < frame->width; ++x) {
        const uint8_t* pixel = frame->data[0] + 4 * x;
        decoded.first_row.push_back({.r = pixel[2], .g = pixel[1], .b = pixel[0]});
      }
    }
  };
  while (av_read_frame(format, packet) >= 0) {
    avcodec_send_packet(codec, packet);
    av_packet_unref(packet);
    drain();
  }
  avcodec_send_packet(codec, nullptr);
  drain();
  av_frame_free(&frame);
  av_packet_free(&packet);
  avcodec_free_context(&codec);
  avformat_close_input(&format);
  return decoded;
}

// A colour of its own for every pixel and frame.
Image<Rgb8> Pattern(int width, int height, int frame) {
  Image<Rgb8> image(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      image(x, y) = {static_cast<uint8_t>(7 * x + frame), static_cast<uint8_t>(5 * y), static_cast<uint8_t>(x * y)};
  return image;
}

void WriteVideo(const std::string& path, const VideoOptions& options, int frames) {
  auto writer = VideoWriter::Create(path, options);
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int i = 0; i < frames; ++i)
    ASSERT_EQ(writer->Write(Pattern(options.width, options.height, i)), absl::OkStatus());
  ASSERT_EQ(writer->Finish(), absl::OkStatus());
}

std::string Bytes(const std::string& path) {
  std::stringstream content;
  content << std::ifstream(path, std::ios::binary).rdbuf();
  return content.str();
}

// What goes in comes out: the number of frames, their size and the speed, by an independent decoder. White is luma 235
// in limited range.
TEST_F(VideoTest, DecodesToWhatWasWritten) {
  const std::string path = dir_ / "video.mp4";
  auto writer = VideoWriter::Create(path, {.width = 64, .height = 48, .frame_rate = {30, 1}});
  ASSERT_TRUE(writer.ok()) << writer.status();
  for (int i = 0; i < 45; ++i) {
    const auto level = static_cast<uint8_t>(255 - i);
    ASSERT_EQ(writer->Write(Image<Rgb8>(64, 48, Rgb8{level, level, level})), absl::OkStatus());
  }
  EXPECT_FALSE(std::filesystem::exists(path)) << "half a video is not shown as one";
  ASSERT_TRUE(writer->Finish().ok());

  const DecodedVideo decoded = Decode(path);
  EXPECT_EQ(decoded.frames, 45) << "encoder " << writer->encoder();
  EXPECT_EQ(decoded.width, 64);
  EXPECT_EQ(decoded.height, 48);
  EXPECT_NEAR(decoded.seconds, 1.5, 0.05);
  EXPECT_NEAR(decoded.first_luma, 235, 3);
}

// The rate in the file is the rate that was asked for, as a fraction, and a dropped frame leaves its place empty.
TEST_F(VideoTest, KeepsTimeExactly) {
  for (const FrameRate rate : {FrameRate{240, 1}, FrameRate{30000, 1001}, FrameRate{25, 1}}) {
    for (const VideoContainer container : {VideoContainer::kMp4, VideoContainer::kMatroska}) {
      const std::string path = dir_ / "video";
      auto writer = VideoWriter::Create(path, {.container = container, .width = 32, .height = 32, .frame_rate = rate});
      ASSERT_TRUE(writer.ok()) << writer.status();
      for (const int64_t tick : {0, 1, 2, 4, 5}) ASSERT_EQ(writer->Write(Pattern(32, 32, 0), tick), absl::OkStatus());
      EXPECT_EQ(writer->Write(Pattern(32, 32, 0), 5).code(), absl::StatusCode::kInvalidArgument);
      ASSERT_EQ(writer->Finish(), absl::OkStatus());
      const DecodedVideo decoded = Decode(path);
      ASSERT_EQ(decoded.frames, 5);
      // Matroska's stamps are whole milliseconds, by its specification.
      const double tolerance_s = container == VideoContainer::kMp4 ? 1e-9 : 0.51e-3;
      for (int i = 0; i < 5; ++i)
        EXPECT_NEAR(decoded.shown_s[i] - decoded.shown_s[0], (i < 3 ? i : i + 1) / rate.PerSecond(), tolerance_s)
            << rate.numerator << "/" << rate.denominator;
    }
    WriteVideo(dir_ / "regular.mp4", {.width = 32, .height = 32, .frame_rate = rate}, 4);
    EXPECT_EQ(av_cmp_q(Decode(dir_ / "regular.mp4").rate, {rate.numerator, rate.denominator}), 0);
  }
}

// FFV1 on RGB has every pixel as it was, whatever the size.
TEST_F(VideoTest, MatroskaLosesNothing) {
  const std::string path = dir_ / "video.mkv";
  WriteVideo(path, {.container = VideoContainer::kMatroska, .width = 37, .height = 23}, 3);
  const DecodedVideo decoded = Decode(path);
  EXPECT_EQ(decoded.frames, 3);
  ASSERT_EQ(decoded.first_row.size(), 37U);
  const Image<Rgb8> first = Pattern(37, 23, 0);
  for (int x = 0; x < 37; ++x) EXPECT_EQ(decoded.first_row[x], first(x, 0)) << x;
}

TEST_F(VideoTest, FullChromaWhereAsked) {
  WriteVideo(dir_ / "half.mp4", {.width = 32, .height = 32}, 2);
  EXPECT_EQ(Decode(dir_ / "half.mp4").pixel_format, AV_PIX_FMT_YUV420P);
  WriteVideo(dir_ / "full.mp4", {.width = 31, .height = 33, .full_chroma = true}, 2);
  EXPECT_EQ(Decode(dir_ / "full.mp4").pixel_format, AV_PIX_FMT_YUV444P);
}

// Whoever reads the file learns how the eyes are packed: from the container, and from H.264 itself.
TEST_F(VideoTest, TellsHowTheEyesArePacked) {
  for (const VideoContainer container : {VideoContainer::kMp4, VideoContainer::kMatroska}) {
    const std::string path = dir_ / "stereo";
    WriteVideo(path, {.container = container, .width = 64, .height = 32, .stereo = VideoStereo::kSideBySide}, 2);
    EXPECT_EQ(Decode(path).stereo_of_stream, AV_STEREO3D_SIDEBYSIDE);
    if (container == VideoContainer::kMp4) {
      EXPECT_EQ(Decode(path).stereo_of_frame, AV_STEREO3D_SIDEBYSIDE);
    }
    WriteVideo(path, {.container = container, .width = 32, .height = 64, .stereo = VideoStereo::kTopBottom}, 2);
    EXPECT_EQ(Decode(path).stereo_of_stream, AV_STEREO3D_TOPBOTTOM);
    WriteVideo(path, {.container = container, .width = 64, .height = 32}, 2);
    EXPECT_EQ(Decode(path).stereo_of_stream, -1);
  }
}

// No clock, no random number, no number of threads gets into a file.
TEST_F(VideoTest, SameFramesGiveTheSameBytes) {
  for (const VideoContainer container : {VideoContainer::kMp4, VideoContainer::kMatroska}) {
    const VideoOptions options = {.container = container, .width = 64, .height = 48};
    WriteVideo(dir_ / "a", options, 12);
    WriteVideo(dir_ / "b", options, 12);
    EXPECT_EQ(Bytes(dir_ / "a"), Bytes(dir_ / "b"));
  }
}

TEST_F(VideoTest, LeavesNothingBehindWhenAbandoned) {
  {
    auto writer = VideoWriter::Create(dir_ / "video.mp4", {.width = 64, .height = 48});
    ASSERT_TRUE(writer.ok()) << writer.status();
    ASSERT_EQ(writer->Write(Image<Rgb8>(64, 48)), absl::OkStatus());
  }
  EXPECT_TRUE(std::filesystem::is_empty(dir_.path()));
}

TEST_F(VideoTest, NamesWhatIsWrong) {
  EXPECT_THAT(VideoWriter::Create(dir_ / "video.mp4", {.width = 63, .height = 48}).status().message(),
              HasSubstr("63 x 48"));
  EXPECT_THAT(
      VideoWriter::Create(dir_ / "video.mp4", {.width = 64, .height = 48, .frame_rate = {0, 1}}).status().message(),
      HasSubstr("frame_rate = 0/1"));
  EXPECT_EQ(VideoWriter::Create(dir_ / "no/such/folder.mp4", {.width = 64, .height = 48}).status().code(),
            absl::StatusCode::kNotFound);
  auto writer = VideoWriter::Create(dir_ / "video.mp4", {.width = 64, .height = 48});
  ASSERT_TRUE(writer.ok()) << writer.status();
  EXPECT_EQ(writer->Write(Image<Rgb8>(32, 48)).code(), absl::StatusCode::kInvalidArgument);
}

// 240 frames a second and then 30, as phones record: every frame is shown at its stamp, in the clock and in the file.
TEST_F(VideoTest, ShowsFramesAtTheirStampsWhereTheRateChanges) {
  std::vector<int64_t> stamps;
  for (int i = 0; i < 8; ++i) stamps.push_back(i * 1'000'000'000LL / 240);
  for (int i = 1; i < 13; ++i) stamps.push_back(7 * 1'000'000'000LL / 240 + i * 1'000'000'000LL / 30);
  const FrameClock clock = ClockOf(stamps);
  for (const VideoContainer container : {VideoContainer::kMp4, VideoContainer::kMatroska}) {
    const std::string path = dir_ / (container == VideoContainer::kMp4 ? "changes.mp4" : "changes.mkv");
    auto writer = VideoWriter::Create(
        path,
        {.container = container, .width = 32, .height = 32, .frame_rate = clock.rate, .tick_rate = clock.tick_rate});
    ASSERT_TRUE(writer.ok()) << writer.status();
    for (size_t i = 0; i < stamps.size(); ++i)
      ASSERT_TRUE(writer->Write(Image<Rgb8>(32, 32, {static_cast<uint8_t>(10 * i), 0, 0}), clock.ticks[i]).ok());
    ASSERT_TRUE(writer->Finish().ok());
    const auto decoded = Decode(path);
    ASSERT_EQ(decoded.shown_s.size(), stamps.size());
    // Matroska keeps milliseconds.
    const double tolerance_s = container == VideoContainer::kMp4 ? 2e-5 : 1.1e-3;
    for (size_t i = 0; i < stamps.size(); ++i)
      EXPECT_NEAR(decoded.shown_s[i] - decoded.shown_s[0], 1e-9 * static_cast<double>(stamps[i]), tolerance_s) << i;
  }
}

// Stamps as cameras give them: rounded to microseconds, wandering, with a frame missing.
TEST(FrameClock, IsTheCamerasOwn) {
  std::vector<int64_t> stamps;
  for (int i = 0; i < 100; ++i) stamps.push_back(5'000'000 + i * 1'000'000'000LL / 240 / 1000 * 1000);
  EXPECT_EQ(ClockOf(stamps).rate, (FrameRate{240, 1}));
  EXPECT_EQ(ClockOf(stamps).ticks[99], 99);
  stamps.erase(stamps.begin() + 50);
  EXPECT_EQ(ClockOf(stamps).rate, (FrameRate{240, 1}));
  EXPECT_EQ(ClockOf(stamps).ticks[50], 51);

  stamps.clear();
  for (int i = 0; i < 60; ++i) stamps.push_back(i * 33'366'667LL + (i % 3 - 1) * 2'000'000);
  EXPECT_EQ(ClockOf(stamps).rate, (FrameRate{30000, 1001}));
  EXPECT_EQ(ClockOf({0, 80'000'000, 160'000'000}).rate, (FrameRate{25, 2}));
  EXPECT_THAT(ClockOf({7}).ticks, ElementsAre(0));
  EXPECT_THAT(ClockOf({0, 1, 1'000'000'000}).ticks, testing::SizeIs(3));
}

}  // namespace
}  // namespace depthtween
