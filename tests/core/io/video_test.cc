#include "core/io/video.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

namespace depthtween {
namespace {

class VideoTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = testing::TempDir() + "video_test_XXXXXX";
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    dir_ = pattern;
  }
  void TearDown() override { std::filesystem::remove_all(dir_); }

  std::filesystem::path dir_;
};

struct DecodedVideo {
  int frames = 0, width = 0, height = 0;
  double seconds = 0.0;
  int first_luma = -1;  // at the centre of the first frame
};

// Decodes with libav alone, so that the writer is not its own judge.
DecodedVideo Decode(const std::string& path) {
  DecodedVideo decoded;
  AVFormatContext* format = nullptr;
  if (avformat_open_input(&format, path.c_str(), nullptr, nullptr) < 0) return decoded;
  avformat_find_stream_info(format, nullptr);
  const AVCodecParameters* parameters = format->streams[0]->codecpar;
  AVCodecContext* codec = avcodec_alloc_context3(avcodec_find_decoder(parameters->codec_id));
  avcodec_parameters_to_context(codec, parameters);
  avcodec_open2(codec, nullptr, nullptr);
  decoded.width = parameters->width;
  decoded.height = parameters->height;
  decoded.seconds = static_cast<double>(format->duration) / AV_TIME_BASE;
  AVPacket* packet = av_packet_alloc();
  AVFrame* frame = av_frame_alloc();
  const auto drain = [&] {
    while (avcodec_receive_frame(codec, frame) >= 0) {
      if (decoded.frames++ == 0)
        decoded.first_luma = frame->data[0][frame->height / 2 * frame->linesize[0] + frame->width / 2];
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

// What goes in comes out: the number of frames, their size and the speed, by an independent decoder. White is luma 235
// in limited range.
TEST_F(VideoTest, DecodesToWhatWasWritten) {
  const std::string path = dir_ / "video.mp4";
  auto writer = VideoWriter::Create(path, 64, 48, 30);
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

TEST_F(VideoTest, LeavesNothingBehindWhenAbandoned) {
  {
    auto writer = VideoWriter::Create(dir_ / "video.mp4", 64, 48, 30);
    ASSERT_TRUE(writer.ok()) << writer.status();
    ASSERT_EQ(writer->Write(Image<Rgb8>(64, 48)), absl::OkStatus());
  }
  EXPECT_TRUE(std::filesystem::is_empty(dir_));
}

TEST_F(VideoTest, NamesWhatIsWrong) {
  EXPECT_THAT(VideoWriter::Create(dir_ / "video.mp4", 63, 48, 30).status().message(), testing::HasSubstr("63 x 48"));
  EXPECT_THAT(VideoWriter::Create(dir_ / "video.mp4", 64, 48, 0).status().message(),
              testing::HasSubstr("frames_per_second = 0"));
  EXPECT_EQ(VideoWriter::Create(dir_ / "no/such/folder.mp4", 64, 48, 30).status().code(), absl::StatusCode::kNotFound);
  auto writer = VideoWriter::Create(dir_ / "video.mp4", 64, 48, 30);
  ASSERT_TRUE(writer.ok()) << writer.status();
  EXPECT_EQ(writer->Write(Image<Rgb8>(32, 48)).code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace depthtween
