// Truth: what the upsampler itself says of the whole clip, whose frames lie in memory side by side (upsample_test and
// causal_test know how good that is). A stream must say the same to the last bit, however its frames arrive.
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "core/api/make_upsampler.h"
#include "core/sequence/clock.h"
#include "core/sequence/retold_source.h"
#include "core/synthetic/synthetic_sequence.h"
#include "depthtween/depthtween.h"
#include "depthtween/opencv.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace depthtween {
namespace {

using ::testing::HasSubstr;
using Code = Status::Code;

constexpr int kKeys = 12;

// Twelve depth frames, three colour frames for each; between them if `phase_s` is not whole frames of 1/90 s.
const MemorySource& Clip(double phase_s = 0) {
  static auto* const clips = new std::map<double, std::unique_ptr<MemorySource>>();
  std::unique_ptr<MemorySource>& clip = (*clips)[phase_s];
  if (clip) return *clip;
  const auto scene = SyntheticSequence::Create({.scene = "kick",
                                                .frames = 3 * (kKeys - 1) + 2,
                                                .color_fps = 90,
                                                .depth_fps = 30,
                                                .depth_phase_s = phase_s,
                                                .width = 96,
                                                .height = 72});
  EXPECT_TRUE(scene.ok()) << scene.status();
  std::vector<Image<Rgb8>> color;
  std::vector<Image<float>> depth_m;
  for (size_t i = 0; i < (*scene)->sequence().color.size(); ++i) color.push_back(*(*scene)->Color(i));
  for (size_t k = 0; k < (*scene)->sequence().depth.size(); ++k) depth_m.push_back(*(*scene)->Depth(k));
  clip = std::make_unique<MemorySource>((*scene)->sequence(), std::move(color), std::move(depth_m));
  return *clip;
}

// One frame's answer, as bytes.
struct Answer {
  int64_t time_ns = 0;
  std::vector<float> depth_m, sigma_m;
  std::vector<uint8_t> provenance;
  int pushed = 0;  // colour frames by then
  bool operator==(const Answer& other) const {
    return time_ns == other.time_ns && depth_m == other.depth_m && sigma_m == other.sigma_m &&
           provenance == other.provenance;
  }
};

std::vector<Answer> Truth(const FrameSource& source, const UpsampleOptions& options, int noise_frames) {
  Sequence first = source.sequence();
  if (noise_frames > 0) first.depth.resize(noise_frames);
  const auto constants = EstimateClipConstants(RetoldSource(source, first), options.causal);
  EXPECT_TRUE(constants.ok()) << constants.status();
  const auto upsampler = MakeUpsampler(options);
  EXPECT_TRUE(upsampler.ok()) << upsampler.status();
  std::vector<Answer> answers;
  for (const Interval& interval : PlanIntervals(source.sequence())) {
    const auto ran = (*upsampler)->Run(source, *constants, interval, {.threads = 2}, [&](const DepthResult& result) {
      const size_t n = result.depth_m.pixel_count();
      Answer answer{.time_ns = source.sequence().color[result.color_index].time_ns,
                    .depth_m = {result.depth_m.data(), result.depth_m.data() + n},
                    .sigma_m = {result.sigma_m.data(), result.sigma_m.data() + n}};
      for (size_t p = 0; p < n; ++p) answer.provenance.push_back(static_cast<uint8_t>(result.provenance.data()[p]));
      answers.push_back(std::move(answer));
      return absl::OkStatus();
    });
    EXPECT_TRUE(ran.ok()) << ran.status();
  }
  return answers;
}

DepthStream::Camera CameraOf(const Sequence& sequence) {
  const Camera& c = sequence.camera;
  return {c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3, sequence.depth_scale};
}

// Pushes the clip as a recorder would, depth frames `late_ns` after they were taken.
std::vector<Answer> Streamed(const FrameSource& source, const DepthStream::Options& options, int64_t late_ns = 0) {
  std::vector<Answer> answers;
  const Sequence& frames = source.sequence();
  int pushed = 0;
  DepthStream stream(CameraOf(frames), options, [&](const DepthStream::Frame& frame) {
    const size_t n = static_cast<size_t>(frame.width) * static_cast<size_t>(frame.height);
    const auto* const provenance = reinterpret_cast<const uint8_t*>(frame.provenance);
    answers.push_back({frame.time_ns,
                       {frame.depth_m, frame.depth_m + n},
                       {frame.sigma_m, frame.sigma_m + n},
                       {provenance, provenance + n},
                       pushed});
    return true;
  });
  size_t depth = 0;
  const auto push_depth_until = [&](int64_t time_ns) {
    for (; depth < frames.depth.size() && frames.depth[depth].time_ns + late_ns <= time_ns; ++depth) {
      const Image<float> image = *source.Depth(depth);
      const Status status =
          stream.PushDepth(frames.depth[depth].time_ns, image.data(), image.width() * ptrdiff_t{sizeof(float)});
      EXPECT_TRUE(status.ok()) << status.message();
    }
  };
  for (size_t i = 0; i < frames.color.size(); ++i) {
    push_depth_until(frames.color[i].time_ns);
    const Image<Rgb8> image = *source.Color(i);
    ++pushed;
    const Status status = stream.PushColor(frames.color[i].time_ns, &image.data()->r, ptrdiff_t{3} * image.width());
    EXPECT_TRUE(status.ok()) << status.message();
  }
  push_depth_until(std::numeric_limits<int64_t>::max() - late_ns);
  const Status status = stream.Finish();
  EXPECT_TRUE(status.ok()) << status.message();
  EXPECT_FALSE(stream.Finish().ok());
  return answers;
}

struct Case {
  std::string name;
  DepthStream::Options options;
  double phase_s = 0;
  int64_t late_ns = 0;
  int wait = 0;  // colour frames that may be pushed between a frame and its answer, once the stream runs
};

class EveryWay : public ::testing::TestWithParam<Case> {};

// Same bits as the whole clip, in time order, and as early as the header promises.
TEST_P(EveryWay, SaysWhatTheUpsamplerSays) {
  const auto& [name, options, phase_s, late_ns, wait] = GetParam();
  const FrameSource& clip = Clip(phase_s);
  UpsampleOptions program;
  program.method = options.method;
  program.preset = options.preset;
  program.causal = options.causal;
  const Sequence paired = PairDepthWithinJitter(clip.sequence());
  const RetoldSource whole(clip, options.noise_frames == 0 ? paired : clip.sequence());
  const std::vector<Answer> truth = Truth(whole, program, options.noise_frames);
  const std::vector<Answer> answers = Streamed(clip, options, late_ns);
  ASSERT_EQ(answers.size(), clip.sequence().color.size());
  ASSERT_EQ(answers.size(), truth.size());
  int latest = 0;
  for (size_t i = 0; i < answers.size(); ++i) {
    EXPECT_TRUE(answers[i] == truth[i]) << "frame " << i;
    if (i >= 4 * 3) latest = std::max(latest, answers[i].pushed - static_cast<int>(i) - 1);
  }
  EXPECT_LE(latest, wait);
}

constexpr double kBetween = 0.4 / 90;
constexpr int kAll = 1000;
INSTANTIATE_TEST_SUITE_P(
    Streams, EveryWay,
    ::testing::Values(Case{.name = "Balanced", .wait = 3 * 4},
                      Case{.name = "BalancedBetweenFrames", .phase_s = kBetween, .wait = 3 * 4 + 1},
                      Case{.name = "BalancedDepthLate", .late_ns = 50'000'000, .wait = 3 * 4 + 5},
                      Case{.name = "WholeClip", .options = {.noise_frames = 0}, .wait = kAll},
                      Case{.name = "WholeClipBetweenFrames",
                           .options = {.preset = "fast", .noise_frames = 0},
                           .phase_s = kBetween,
                           .wait = kAll},
                      Case{.name = "Fast", .options = {.preset = "fast"}, .wait = 3 * 2},
                      Case{.name = "Linear", .options = {.method = "linear"}, .phase_s = kBetween, .wait = 3 * 2 + 1},
                      Case{.name = "Causal", .options = {.causal = true, .noise_frames = 1}, .wait = 3},
                      Case{.name = "CausalBetweenFrames",
                           .options = {.causal = true, .noise_frames = 1},
                           .phase_s = kBetween,
                           .wait = 3 + 1}),
    [](const auto& info) { return info.param.name; });

const DepthStream::Camera kCamera = {.width = 32, .height = 24, .fx = 30, .fy = 30, .cx = 15.5, .cy = 11.5};
bool Ignore(const DepthStream::Frame&) { return true; }

// By hand: a still scene at 2 m, so that every frame's depth is what was put in.
struct Still {
  std::vector<uint8_t> bgr = std::vector<uint8_t>(32 * 24 * 3, 90);
  std::vector<uint16_t> depth = std::vector<uint16_t>(32 * 24, 2000);

  Status Push(DepthStream& stream, int frames) const {
    for (int i = 0; i < frames; ++i) {
      if (i % 2 == 0)
        if (const Status status = stream.PushDepth(i, depth.data(), 64); !status.ok()) return status;
      if (const Status status = stream.PushColor(i, bgr.data(), 96, DepthStream::Layout::kBgr); !status.ok())
        return status;
    }
    return {};
  }
};

// A wrong frame is refused and the stream goes on; a wrong order of calls says so.
TEST(DepthStream, RefusesWrongFramesAndGoesOn) {
  int frames = 0;
  DepthStream stream(kCamera, {.method = "hold"}, [&](const DepthStream::Frame& frame) {
    ++frames;
    EXPECT_FLOAT_EQ(frame.depth_m[0], 2.0F);
    return true;
  });
  const Still still;
  ASSERT_TRUE(still.Push(stream, 3).ok());
  EXPECT_THAT(stream.PushColor(2, still.bgr.data(), 96).message(), HasSubstr("time_ns = 2, must be later than 2"));
  EXPECT_THAT(stream.PushDepth(0, still.depth.data(), 64).message(), HasSubstr("time_ns = 0, must be later than 2"));
  EXPECT_THAT(stream.PushColor(3, still.bgr.data(), 95).message(), HasSubstr("row_bytes = 95, must be at least 96"));
  EXPECT_THAT(stream.PushColor(3, nullptr, 96).message(), HasSubstr("pixels is null"));
  EXPECT_TRUE(stream.Finish().ok());
  EXPECT_EQ(frames, 3);
  EXPECT_EQ(stream.PushColor(3, still.bgr.data(), 96).code(), Code::kFailedPrecondition);
}

// What is wrong from the beginning is returned by every call, and names the field.
TEST(DepthStream, SaysWhichOptionIsWrong) {
  const auto error_of = [](const DepthStream::Camera& camera, const DepthStream::Options& options) {
    DepthStream stream(camera, options, Ignore);
    const Status status = stream.Finish();
    EXPECT_EQ(status.code(), Code::kInvalidArgument) << status.message();
    EXPECT_EQ(Still().Push(stream, 1).message(), status.message());
    return status.message();
  };
  EXPECT_THAT(error_of({}, {}), HasSubstr("camera.width"));
  DepthStream::Camera no_scale = kCamera;
  no_scale.depth_scale = 0;
  EXPECT_THAT(error_of(no_scale, {}), HasSubstr("camera.depth_scale"));
  EXPECT_THAT(error_of(kCamera, {.preset = "slow"}), HasSubstr("options.preset"));
  EXPECT_THAT(error_of(kCamera, {.clock = "estimate"}), HasSubstr("options.clock"));
  EXPECT_THAT(error_of(kCamera, {.threads = -1}), HasSubstr("options.threads"));
  EXPECT_THAT(error_of(kCamera, {.noise_frames = -1}), HasSubstr("options.noise_frames"));
  DepthStream empty(kCamera, {}, Ignore);
  EXPECT_EQ(empty.Finish().code(), Code::kFailedPrecondition);
}

// The JSON names are those of the struct; what only a whole recording can have is refused.
TEST(DepthStream, ReadsOptionsFromJson) {
  DepthStream::Options options{.preset = "fast"};
  const Status read = DepthStream::ParseOptions(R"({"causal": true, "without": ["thin"], "threads": 3})", options);
  ASSERT_TRUE(read.ok()) << read.message();
  EXPECT_EQ(options.preset, "fast");
  EXPECT_TRUE(options.causal);
  EXPECT_THAT(options.without, ::testing::ElementsAre("thin"));
  EXPECT_EQ(options.threads, 3);
  const auto refusal = [&](const char* json) {
    const Status status = DepthStream::ParseOptions(json, options);
    EXPECT_EQ(status.code(), Code::kInvalidArgument);
    return status.message();
  };
  EXPECT_THAT(refusal(R"({"key_every": 2})"), HasSubstr("options.key_every is not for streams"));
  EXPECT_THAT(refusal(R"({"presets": "fast"})"), HasSubstr("options.presets is not known"));
  EXPECT_THAT(refusal(R"({"threads": 1.5})"), HasSubstr("options.threads"));
  EXPECT_THAT(refusal("[]"), HasSubstr("must be a JSON object"));
  EXPECT_EQ(options.preset, "fast");
}

// Whoever does not want more ends the stream for good.
TEST(DepthStream, EndsWhenTheCallbackSaysSo) {
  DepthStream stream(kCamera, {.method = "hold", .noise_frames = 1}, [](const DepthStream::Frame&) { return false; });
  EXPECT_EQ(Still().Push(stream, 9).code(), Code::kCancelled);
  EXPECT_EQ(stream.Finish().code(), Code::kCancelled);
  DepthStream cancelled(kCamera, {.noise_frames = 1}, Ignore);
  cancelled.Cancel();
  EXPECT_EQ(Still().Push(cancelled, 9).code(), Code::kCancelled);
}

// A BGR matrix with room beside its rows is the RGB image, and OpenCV has as many threads afterwards as before.
TEST(OpenCv, MatricesAreFrames) {
  const FrameSource& clip = Clip();
  const DepthStream::Camera camera = CameraOf(clip.sequence());
  const DepthStream::Options options{.preset = "fast", .noise_frames = 0};
  const int threads_before = cv::getNumThreads();
  cv::setNumThreads(2);
  std::vector<Answer> answers;
  DepthStream stream(camera, options, [&](const DepthStream::Frame& frame) {
    const cv::Mat depth = DepthMat(frame);
    EXPECT_EQ(cv::getNumThreads(), 1);
    answers.push_back({.time_ns = frame.time_ns, .depth_m = {depth.begin<float>(), depth.end<float>()}});
    return true;
  });
  for (size_t i = 0; i < clip.sequence().color.size(); ++i) {
    const Image<Rgb8> image = *clip.Color(i);
    cv::Mat wide(camera.height, camera.width + 5, CV_8UC3);
    cv::Mat color = wide.colRange(2, 2 + camera.width);
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) color.at<cv::Vec3b>(y, x) = {image(x, y).b, image(x, y).g, image(x, y).r};
    ASSERT_TRUE(PushColor(stream, camera, clip.sequence().color[i].time_ns, color).ok());
  }
  for (int k = 0; k < kKeys; ++k) {
    Image<float> image = *clip.Depth(k);
    ASSERT_TRUE(PushDepth(stream, camera, clip.sequence().depth[k].time_ns,
                          cv::Mat(camera.height, camera.width, CV_32FC1, image.data()))
                    .ok());
  }
  EXPECT_FALSE(PushColor(stream, camera, int64_t{1} << 60, cv::Mat(2, 2, CV_8UC3)).ok());
  EXPECT_FALSE(PushDepth(stream, camera, int64_t{1} << 60, cv::Mat(camera.height, camera.width, CV_8UC1)).ok());
  ASSERT_TRUE(stream.Finish().ok());
  EXPECT_EQ(cv::getNumThreads(), 2);
  cv::setNumThreads(threads_before);
  const std::vector<Answer> plain = Streamed(clip, options);
  ASSERT_EQ(answers.size(), plain.size());
  for (size_t i = 0; i < plain.size(); ++i) EXPECT_EQ(answers[i].depth_m, plain[i].depth_m) << "frame " << i;
}

}  // namespace
}  // namespace depthtween
