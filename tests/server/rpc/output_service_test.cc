// Outputs over a real connection: every byte must be the stored file's.
#include <zstd.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <thread>

#include "core/base/image.h"
#include "core/io/jpeg.h"
#include "core/io/png.h"
#include "proto/depthtween/crc32c.h"
#include "server/rpc/frame_encoding.h"
#include "server/store/checksums.h"
#include "server/store/sqlite.h"
#include "tests/server/rpc/rpc_fixture.h"

namespace depthtween::server {
namespace {

// One frame as a client puts it together.
struct Frame {
  v1::FrameHeader header;
  int index = -1;
  int next_frame = -1;
  int chunks = 0;
  std::string bytes;
};

class OutputServiceTest : public RpcTest {
 protected:
  std::unique_ptr<grpc::ClientReader<v1::FrameChunk>> Open(grpc::ClientContext* context,
                                                           const v1::StreamFramesRequest& request) {
    return outputs_stub().StreamFrames(context, request);
  }

  // Reads the next frame and checks what every frame promises. False at the end of the stream.
  static bool ReadFrame(grpc::ClientReader<v1::FrameChunk>& reader, Frame* frame) {
    *frame = Frame();
    v1::FrameChunk chunk;
    while (reader.Read(&chunk)) {
      EXPECT_EQ(chunk.has_header(), frame->chunks == 0);
      if (chunk.has_header()) {
        frame->header = chunk.header();
        frame->index = chunk.frame();
      }
      EXPECT_EQ(chunk.frame(), frame->index);
      EXPECT_EQ(chunk.offset(), static_cast<int64_t>(frame->bytes.size()));
      EXPECT_EQ(chunk.crc32c(), Crc32c(chunk.data()));
      EXPECT_LE(chunk.ByteSizeLong(), 1U << 20);
      frame->bytes += chunk.data();
      ++frame->chunks;
      if (!chunk.has_next_frame()) continue;
      frame->next_frame = chunk.next_frame();
      EXPECT_EQ(frame->header.size_bytes(), static_cast<int64_t>(frame->bytes.size()));
      EXPECT_EQ(frame->header.crc32c(), Crc32c(frame->bytes));
      return true;
    }
    EXPECT_EQ(frame->chunks, 0) << "the stream ended within a frame";
    return false;
  }

  grpc::Status ReadAll(const v1::StreamFramesRequest& request, std::vector<Frame>* frames) {
    grpc::ClientContext context;
    const auto reader = Open(&context, request);
    for (Frame frame; ReadFrame(*reader, &frame);) frames->push_back(frame);
    return reader->Finish();
  }
  grpc::Status Read(const std::string& name, int64_t offset, int64_t limit, std::string* bytes) {
    grpc::ClientContext context;
    v1::ReadOutputRequest request;
    request.set_name(name);
    request.set_read_offset(offset);
    request.set_read_limit(limit);
    const auto reader = outputs_stub().ReadOutput(&context, request);
    v1::ReadOutputResponse chunk;
    while (reader->Read(&chunk)) {
      EXPECT_EQ(chunk.offset(), offset + static_cast<int64_t>(bytes->size()));
      EXPECT_EQ(chunk.crc32c(), Crc32c(chunk.data()));
      *bytes += chunk.data();
    }
    return reader->Finish();
  }

  v1::Job SucceededJob() { return WaitUntilEnded(CreateJob(ReadySequence()).name()); }
  std::string StoredFile(const v1::Job& job, const std::string& path) {
    return directory().OutFolder(IdOf(job.name())) + "/" + path;
  }
};

v1::StreamFramesRequest Request(const v1::Job& job, const std::string& output) {
  v1::StreamFramesRequest request;
  request.set_name(job.name() + "/outputs/" + output);
  return request;
}

std::vector<int> Indices(const std::vector<Frame>& frames) {
  std::vector<int> indices;
  for (const Frame& frame : frames) indices.push_back(frame.index);
  return indices;
}

std::string Decompress(const std::string& bytes) {
  std::string content(ZSTD_getFrameContentSize(bytes.data(), bytes.size()), '\0');
  EXPECT_EQ(ZSTD_decompress(content.data(), content.size(), bytes.data(), bytes.size()), content.size());
  return content;
}

TEST_F(OutputServiceTest, ListsWhatAJobHas) {
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  const v1::Job job = CreateJob(sequence);
  while (GetJob(job.name()).progress().frames_done() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  v1::ListOutputsRequest request;
  request.set_parent(job.name());
  v1::ListOutputsResponse running, done;
  grpc::ClientContext running_context, done_context;
  ASSERT_THAT(outputs_stub().ListOutputs(&running_context, request, &running), Succeeds());
  ASSERT_EQ(running.outputs_size(), 6);
  EXPECT_EQ(running.outputs(0).name(), job.name() + "/outputs/depth");
  EXPECT_EQ(running.outputs(0).kind(), v1::Output::KIND_FRAMES);
  EXPECT_EQ(running.outputs(0).frames_ready(), 2);
  EXPECT_EQ(running.outputs(0).frame_count(), 6);
  EXPECT_EQ(running.outputs(0).encodings_size(), 5);
  EXPECT_EQ(running.outputs(2).encodings_size(), 3);  // provenance is not metres
  EXPECT_EQ(running.outputs(3).file_name(), "report.json");
  EXPECT_FALSE(running.outputs(3).ready());
  Go(sequence);
  WaitUntilEnded(job.name());
  ASSERT_THAT(outputs_stub().ListOutputs(&done_context, request, &done), Succeeds());
  EXPECT_EQ(done.outputs(1).frames_ready(), 6);
  EXPECT_TRUE(done.outputs(3).ready());
  EXPECT_EQ(done.outputs(3).size_bytes(), static_cast<int64_t>(ReadText(StoredFile(job, "report.json")).size()));
}

// As a job makes it at its end, from which the last frame has none: nothing before, then a message for every frame.
TEST_F(OutputServiceTest, SceneFlowLeavesWhenTheJobHasSucceeded) {
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  v1::CreateJobRequest order;
  order.mutable_job()->set_sequence(sequence.name());
  order.mutable_job()->mutable_options()->set_scene_flow(true);
  grpc::ClientContext create_context;
  v1::Job job;
  ASSERT_THAT(jobs_stub().CreateJob(&create_context, order, &job), Succeeds());
  EXPECT_TRUE(job.options().scene_flow());
  while (GetJob(job.name()).progress().frames_done() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  v1::ListOutputsRequest request;
  request.set_parent(job.name());
  const auto listed = [&] {
    grpc::ClientContext context;
    v1::ListOutputsResponse response;
    EXPECT_THAT(outputs_stub().ListOutputs(&context, request, &response), Succeeds());
    return response.outputs(response.outputs_size() - 1);
  };
  EXPECT_EQ(listed().name(), job.name() + "/outputs/sceneflow");
  EXPECT_EQ(listed().frames_ready(), 0);
  EXPECT_EQ(listed().frame_count(), 6);
  v1::StreamFramesRequest stream;
  stream.set_name(job.name() + "/outputs/sceneflow");
  stream.set_follow(true);
  grpc::ClientContext stream_context;
  const auto reader = outputs_stub().StreamFrames(&stream_context, stream);
  Go(sequence);
  v1::FrameChunk chunk;
  for (int frame = 0; frame < 6; ++frame) {
    ASSERT_TRUE(reader->Read(&chunk)) << frame;
    EXPECT_EQ(chunk.frame(), frame);
    EXPECT_EQ(chunk.header().encoding(), v1::ENCODING_NPZ);
    EXPECT_EQ(chunk.data(), frame < 5 ? "scene flow " + std::to_string(frame) : "");
    EXPECT_EQ(chunk.next_frame(), frame + 1);
  }
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_THAT(reader->Finish(), Succeeds());
  EXPECT_EQ(GetJob(job.name()).state(), v1::Job::STATE_SUCCEEDED);
  EXPECT_EQ(listed().frames_ready(), 6);
}

// What was made and is gone is lost, not absent: a frame of any output, and a file. The last frame never had scene
// flow.
TEST_F(OutputServiceTest, WhatIsLostIsSaidToBeLost) {
  v1::CreateJobRequest order;
  order.mutable_job()->set_sequence(ReadySequence().name());
  order.mutable_job()->mutable_options()->set_scene_flow(true);
  grpc::ClientContext create_context, list_context, read_context;
  v1::Job job;
  ASSERT_THAT(jobs_stub().CreateJob(&create_context, order, &job), Succeeds());
  ASSERT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);
  for (const std::string file : {"sceneflow/000003.npz", "depth/000002.png", "report.json"}) {
    ASSERT_TRUE(std::filesystem::remove(StoredFile(job, file))) << file;
  }
  const auto lost_at = [&](const std::string& output, int start_frame) {
    v1::StreamFramesRequest stream;
    stream.set_name(job.name() + "/outputs/" + output);
    stream.set_start_frame(start_frame);
    grpc::ClientContext context;
    const auto reader = outputs_stub().StreamFrames(&context, stream);
    int next = start_frame;
    for (v1::FrameChunk chunk; reader->Read(&chunk);) next = chunk.next_frame();
    const grpc::Status ended = reader->Finish();
    if (ended.ok()) return -next;
    EXPECT_THAT(ended, Fails(grpc::DATA_LOSS, "FILE_LOST"));
    EXPECT_EQ(Detail<google::rpc::ErrorInfo>(ended)->metadata().at("resource"), stream.name());
    EXPECT_EQ(Detail<google::rpc::ErrorInfo>(ended)->metadata().at("frame"), std::to_string(next));
    return next;
  };
  EXPECT_EQ(lost_at("sceneflow", 0), 3);
  EXPECT_EQ(lost_at("sceneflow", 4), -6) << "the last frame has none, and that is no loss";
  EXPECT_EQ(lost_at("depth", 0), 2);

  v1::ListOutputsRequest list;
  list.set_parent(job.name());
  v1::ListOutputsResponse outputs;
  ASSERT_THAT(outputs_stub().ListOutputs(&list_context, list, &outputs), Succeeds());
  EXPECT_TRUE(outputs.outputs(3).lost());
  EXPECT_FALSE(outputs.outputs(3).ready());
  EXPECT_FALSE(outputs.outputs(4).lost());
  v1::ReadOutputRequest read;
  read.set_name(outputs.outputs(3).name());
  const auto reader = outputs_stub().ReadOutput(&read_context, read);
  v1::ReadOutputResponse part;
  EXPECT_FALSE(reader->Read(&part));
  const grpc::Status ended = reader->Finish();
  EXPECT_THAT(ended, Fails(grpc::DATA_LOSS, "FILE_LOST"));
  EXPECT_EQ(ended.error_message().find(StoredFile(job, "")), std::string::npos) << "it says no path of the server's";
}

// One flipped bit of a frame and of a file: what is whole before and after it is served, what is not never is.
TEST_F(OutputServiceTest, DamagedFilesAreNamedAndNeverServed) {
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  const std::string depth = StoredFile(job, "depth/000002.png"), report = StoredFile(job, "report.json");
  for (const std::string& file : {depth, report}) {
    std::string bytes = ReadText(file);
    bytes.back() = static_cast<char>(bytes.back() ^ 2);
    WriteText(file, bytes);
  }
  const auto ends = [&](int start_frame) {
    v1::StreamFramesRequest stream;
    stream.set_name(job.name() + "/outputs/depth");
    stream.set_start_frame(start_frame);
    grpc::ClientContext context;
    const auto reader = outputs_stub().StreamFrames(&context, stream);
    int next = start_frame;
    for (v1::FrameChunk chunk; reader->Read(&chunk);) next = chunk.next_frame();
    return std::pair(next, reader->Finish());
  };
  for (int again = 0; again < 3; ++again) {
    const auto [next, ended] = ends(0);
    EXPECT_EQ(next, 2);
    EXPECT_THAT(ended, Fails(grpc::DATA_LOSS, "FILE_DAMAGED"));
    const auto info = Detail<google::rpc::ErrorInfo>(ended);
    EXPECT_EQ(info->metadata().at("resource"), job.name() + "/outputs/depth");
    EXPECT_EQ(info->metadata().at("frame"), "2");
    EXPECT_EQ(info->metadata().at("file"), job.name() + "/out/depth/000002.png");
    EXPECT_EQ(ended.error_message().find(directory().path()), std::string::npos) << "it says no path of the server's";
  }
  EXPECT_EQ(ends(3).first, 6);
  EXPECT_THAT(ends(3).second, Succeeds());

  v1::ReadOutputRequest read;
  read.set_name(job.name() + "/outputs/report");
  grpc::ClientContext context;
  const auto reader = outputs_stub().ReadOutput(&context, read);
  v1::ReadOutputResponse part;
  EXPECT_FALSE(reader->Read(&part));
  EXPECT_THAT(reader->Finish(), Fails(grpc::DATA_LOSS, "FILE_DAMAGED"));
  EXPECT_EQ(jobs().damage().files(), 2) << "each is logged once";
}

// A video of several blocks, one of which is damaged: ranges beside it are served, by whatever bytes they begin and
// end.
TEST_F(OutputServiceTest, OnlyTheDamagedPartOfALargeFileIsRefused) {
  const v1::Job job = WaitUntilEnded(CreateJob(ReadySequence()).name());
  const std::string video = RandomBytes(3 * kChecksumBlockBytes + 1000, 7), file = StoredFile(job, "report.json");
  WriteText(file, video);
  const FileChecksum checksum = Take(ChecksumOf(file, "out/report.json"));
  EXPECT_THAT(Take(Database::Open(directory().DatabaseFile()))
                  ->Run("UPDATE job_files SET size_bytes = ?, checksums = ? WHERE path = ?",
                        {checksum.size_bytes, SqlValue::Blob{checksum.blocks}, checksum.path}),
              IsOk());
  const auto read = [&](int64_t offset, int64_t limit) {
    v1::ReadOutputRequest request;
    request.set_name(job.name() + "/outputs/report");
    request.set_read_offset(offset);
    request.set_read_limit(limit);
    grpc::ClientContext context;
    const auto reader = outputs_stub().ReadOutput(&context, request);
    std::string bytes;
    for (v1::ReadOutputResponse part; reader->Read(&part);) bytes += part.data();
    return std::pair(bytes, reader->Finish());
  };
  EXPECT_EQ(read(0, 0).first, video);
  for (const int64_t offset : {int64_t{0}, int64_t{5}, kChecksumBlockBytes - 1, 2 * kChecksumBlockBytes}) {
    EXPECT_EQ(read(offset, 700).first, video.substr(static_cast<size_t>(offset), 700)) << offset;
  }
  std::string damaged = video;
  damaged[static_cast<size_t>(kChecksumBlockBytes) + 9] ^= 1;
  WriteText(file, damaged);
  EXPECT_EQ(read(0, kChecksumBlockBytes).first, video.substr(0, static_cast<size_t>(kChecksumBlockBytes)));
  EXPECT_EQ(read(2 * kChecksumBlockBytes, 0).first, video.substr(2 * static_cast<size_t>(kChecksumBlockBytes)));
  const auto [bytes, ended] = read(0, 0);
  EXPECT_EQ(static_cast<int64_t>(bytes.size()), kChecksumBlockBytes);
  EXPECT_THAT(ended, Fails(grpc::DATA_LOSS, "FILE_DAMAGED"));
}

// What a job of scene flow offers, and that a frame of it leaves as it is stored.
TEST_F(OutputServiceTest, SceneFlowJobsOfferTheirFormats) {
  v1::CreateJobRequest order;
  order.mutable_job()->set_sequence(ReadySequence().name());
  order.mutable_job()->mutable_scene_flow_options()->add_formats("kitti");
  grpc::ClientContext create_context, list_context, stream_context;
  v1::Job job;
  ASSERT_THAT(jobs_stub().CreateJob(&create_context, order, &job), Succeeds());
  ASSERT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);
  v1::ListOutputsRequest request;
  request.set_parent(job.name());
  v1::ListOutputsResponse response;
  ASSERT_THAT(outputs_stub().ListOutputs(&list_context, request, &response), Succeeds());
  std::vector<std::string> places;
  for (const v1::Output& output : response.outputs()) {
    places.push_back(output.file_name());
    if (output.kind() == v1::Output::KIND_FRAMES) {
      EXPECT_EQ(output.frames_ready(), 6) << output.name();
    } else {
      EXPECT_TRUE(output.ready()) << output.name();
    }
  }
  EXPECT_THAT(places, testing::ElementsAre("sceneflow", "kitti/flow", "kitti/disp_0", "kitti/disp_1", "report.json",
                                           "preview.png"));
  v1::StreamFramesRequest stream;
  stream.set_name(job.name() + "/outputs/kitti-flow");
  const auto reader = outputs_stub().StreamFrames(&stream_context, stream);
  v1::FrameChunk chunk;
  ASSERT_TRUE(reader->Read(&chunk));
  EXPECT_EQ(chunk.header().encoding(), v1::ENCODING_PNG);
  EXPECT_EQ(chunk.data(), "kitti/flow 0");
}

TEST(FrameEncoding, SceneFlowLeavesAsItIsStored) {
  const auto encodings = [](const std::string& extension) {
    return EncodingsOf({.kind = OutputKind::kSceneFlow, .extension = extension});
  };
  EXPECT_THAT(encodings("npz"), testing::ElementsAre(v1::ENCODING_NPZ));
  EXPECT_THAT(encodings("flo"), testing::ElementsAre(v1::ENCODING_FLO));
  EXPECT_THAT(encodings("pfm"), testing::ElementsAre(v1::ENCODING_PFM));
  EXPECT_THAT(encodings("png"), testing::ElementsAre(v1::ENCODING_PNG));
}

// PNG is the stored file byte for byte, in as many chunks as it takes.
TEST_F(OutputServiceTest, StreamsStoredFilesInChunks) {
  const v1::Job job = SucceededJob();
  const std::string large = RandomBytes(1'300'000, 7);
  ForgetChecksums(job);
  WriteText(StoredFile(job, "depth/000001.png"), large);
  std::vector<Frame> frames;
  ASSERT_THAT(ReadAll(Request(job, "depth"), &frames), Succeeds());
  ASSERT_EQ(Indices(frames), (std::vector<int>{0, 1, 2, 3, 4, 5}));
  EXPECT_EQ(frames[0].bytes, "depth 0");
  EXPECT_EQ(frames[1].bytes, large);
  EXPECT_GT(frames[1].chunks, 4);
  const v1::FrameHeader& header = frames[3].header;
  EXPECT_EQ(header.time_ns(), 3000);
  EXPECT_EQ(header.stem(), "000003");
  EXPECT_EQ(header.encoding(), v1::ENCODING_PNG);
  EXPECT_EQ(header.units_per_metre(), 5000.0);
  EXPECT_EQ(header.invalid_value(), 0U);
  EXPECT_EQ(header.camera().fx(), 5.0);
  frames.clear();
  ASSERT_THAT(ReadAll(Request(job, "uncertainty"), &frames), Succeeds());
  EXPECT_EQ(frames[2].bytes, "uncertainty 2");
  EXPECT_EQ(frames[2].header.invalid_value(), 65535U);
}

// All encodings are the same numbers: raw integers are the pixels, floats are integers over units_per_metre, zstd is
// either of them compressed.
TEST_F(OutputServiceTest, EncodingsAgreeBitForBit) {
  const v1::Job job = SucceededJob();
  Image<uint16_t> stored(4, 3);
  for (int i = 0; i < 12; ++i) stored.data()[i] = static_cast<uint16_t>(i * 5461);
  stored(3, 2) = 65535;
  Image<uint8_t> provenance(4, 3);
  for (int i = 0; i < 12; ++i) provenance.data()[i] = static_cast<uint8_t>(i % 6);
  ForgetChecksums(job);
  for (int frame = 0; frame < 6; ++frame) {
    const std::string name = "/00000" + std::to_string(frame) + ".png";
    ASSERT_THAT(WritePng16(StoredFile(job, "depth" + name), stored), IsOk());
    ASSERT_THAT(WritePng16(StoredFile(job, "uncertainty" + name), stored), IsOk());
    ASSERT_THAT(WritePng8(StoredFile(job, "provenance" + name), provenance), IsOk());
  }
  const auto bytes = [&](const std::string& output, v1::Encoding encoding) {
    v1::StreamFramesRequest request = Request(job, output);
    request.set_encoding(encoding);
    request.set_end_frame(1);
    std::vector<Frame> frames;
    EXPECT_THAT(ReadAll(request, &frames), Succeeds());
    EXPECT_EQ(frames.size(), 1U);
    EXPECT_EQ(frames[0].header.encoding(), encoding);
    return frames[0].bytes;
  };
  const std::string pixels(reinterpret_cast<const char*>(stored.data()), 24);
  for (const std::string output : {"depth", "uncertainty"}) {
    EXPECT_EQ(bytes(output, v1::ENCODING_RAW), pixels);
    EXPECT_EQ(Decompress(bytes(output, v1::ENCODING_RAW_ZSTD)), pixels);
    const std::string metres = bytes(output, v1::ENCODING_F32);
    ASSERT_EQ(metres.size(), 48U);
    EXPECT_EQ(Decompress(bytes(output, v1::ENCODING_F32_ZSTD)), metres);
    for (int i = 0; i < 12; ++i) {
      float value = 0;
      std::memcpy(&value, metres.data() + 4 * i, 4);
      const uint16_t units = stored.data()[i];
      if (output == "uncertainty" && units == 65535) {
        EXPECT_EQ(value, std::numeric_limits<float>::infinity());
      } else {
        EXPECT_EQ(std::lround(double{value} * 5000.0), units);
      }
    }
  }
  EXPECT_EQ(bytes("provenance", v1::ENCODING_RAW), std::string(reinterpret_cast<const char*>(provenance.data()), 12));
}

TEST_F(OutputServiceTest, StartEndAndStrideSelectFrames) {
  const v1::Job job = SucceededJob();
  v1::StreamFramesRequest request = Request(job, "depth");
  request.set_start_frame(1);
  request.set_end_frame(5);
  request.set_stride(3);
  std::vector<Frame> frames;
  ASSERT_THAT(ReadAll(request, &frames), Succeeds());
  EXPECT_EQ(Indices(frames), (std::vector<int>{1, 4}));
  request.set_end_frame(1);
  frames.clear();
  EXPECT_THAT(ReadAll(request, &frames), Succeeds());
  EXPECT_TRUE(frames.empty());
  request = Request(job, "depth");
  request.set_start_frame(6);
  EXPECT_THAT(ReadAll(request, &frames), Succeeds());
  request.set_start_frame(7);
  EXPECT_THAT(ReadAll(request, &frames), Fails(grpc::OUT_OF_RANGE, "NO_SUCH_FRAME"));
  request.set_start_frame(0);
  request.set_stride(std::numeric_limits<int>::max());
  ASSERT_THAT(ReadAll(request, &frames), Succeeds());
  EXPECT_EQ(Indices(frames), (std::vector<int>{0}));
}

// next_frame of the last frame seen is all a client needs: the two streams together are the whole, with its stride.
TEST_F(OutputServiceTest, AStreamResumesAfterAnyFrame) {
  const v1::Job job = SucceededJob();
  v1::StreamFramesRequest request = Request(job, "depth");
  request.set_stride(2);
  Frame first;
  {
    grpc::ClientContext context;
    const auto reader = Open(&context, request);
    ASSERT_TRUE(ReadFrame(*reader, &first));
    context.TryCancel();
  }
  request.set_start_frame(first.next_frame);
  std::vector<Frame> rest;
  ASSERT_THAT(ReadAll(request, &rest), Succeeds());
  EXPECT_EQ(Indices(rest), (std::vector<int>{2, 4}));
}

TEST_F(OutputServiceTest, FollowDeliversFramesWhileTheJobRuns) {
  const v1::Sequence sequence = ReadySequence("intervals 4\nwait_at 2");
  const v1::Job job = CreateJob(sequence);
  v1::StreamFramesRequest request = Request(job, "depth");
  request.set_follow(true);
  grpc::ClientContext context;
  const auto reader = Open(&context, request);
  Frame frame;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(ReadFrame(*reader, &frame));
    EXPECT_EQ(frame.index, i);
  }
  EXPECT_EQ(GetJob(job.name()).state(), v1::Job::STATE_RUNNING);
  // Without follow a stream ends where the frames do; with an end it need not wait for the job.
  std::vector<Frame> ready;
  EXPECT_THAT(ReadAll(Request(job, "depth"), &ready), Succeeds());
  EXPECT_EQ(ready.size(), 4U);
  request.set_end_frame(3);
  ready.clear();
  EXPECT_THAT(ReadAll(request, &ready), Succeeds());
  EXPECT_EQ(ready.size(), 3U);
  Go(sequence);
  for (int i = 4; i < 8; ++i) {
    ASSERT_TRUE(ReadFrame(*reader, &frame));
    EXPECT_EQ(frame.index, i);
  }
  EXPECT_FALSE(ReadFrame(*reader, &frame));
  EXPECT_THAT(reader->Finish(), Succeeds());
  EXPECT_EQ(GetJob(job.name()).state(), v1::Job::STATE_SUCCEEDED);
}

TEST_F(OutputServiceTest, FollowEndsWithAJobThatDoesNotSucceed) {
  const v1::Job failing = CreateJob(ReadySequence("error_at 1 DATA_LOSS"));
  v1::StreamFramesRequest request = Request(failing, "depth");
  request.set_follow(true);
  std::vector<Frame> frames;
  const grpc::Status failed = ReadAll(request, &frames);
  EXPECT_THAT(failed, Fails(grpc::ABORTED, "JOB_FAILED"));
  EXPECT_THAT(failed.error_message(), testing::HasSubstr("as the script says"));
  EXPECT_EQ(Detail<google::rpc::ErrorInfo>(failed)->metadata().at("next_frame"), "2");
  EXPECT_EQ(frames.size(), 2U);

  const v1::Job job = CreateJob(ReadySequence("wait_at 1"));
  request = Request(job, "depth");
  request.set_follow(true);
  grpc::ClientContext context;
  const auto reader = Open(&context, request);
  Frame frame;
  ASSERT_TRUE(ReadFrame(*reader, &frame));
  grpc::ClientContext cancel_context;
  v1::CancelJobRequest cancel;
  cancel.set_name(job.name());
  v1::Job cancelled;
  ASSERT_THAT(jobs_stub().CancelJob(&cancel_context, cancel, &cancelled), Succeeds());
  while (ReadFrame(*reader, &frame)) {
  }
  EXPECT_THAT(reader->Finish(), Fails(grpc::ABORTED, "JOB_CANCELLED"));
}

TEST_F(OutputServiceTest, BadRequestsNameTheirField) {
  const v1::Job job = SucceededJob();
  std::vector<Frame> frames;
  v1::StreamFramesRequest request;
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("name"));
  request = Request(job, "depth");
  request.set_start_frame(-1);
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("start_frame"));
  request.set_start_frame(3);
  request.set_end_frame(2);
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("end_frame"));
  request = Request(job, "depth");
  request.set_stride(-1);
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("stride"));
  request = Request(job, "provenance");
  request.set_encoding(v1::ENCODING_F32);
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("encoding"));
  std::string bytes;
  EXPECT_THAT(Read("x", 0, 0, &bytes), FailsAtField("name"));
  EXPECT_THAT(Read(job.name() + "/outputs/report", -1, 0, &bytes), FailsAtField("read_offset"));
  EXPECT_THAT(Read(job.name() + "/outputs/report", 0, -1, &bytes), FailsAtField("read_limit"));
  grpc::ClientContext context;
  v1::ListOutputsResponse list;
  EXPECT_THAT(outputs_stub().ListOutputs(&context, v1::ListOutputsRequest(), &list), FailsAtField("parent"));
}

TEST_F(OutputServiceTest, UnknownJobsAndOutputsAreNotFound) {
  const v1::Job job = SucceededJob();
  std::vector<Frame> frames;
  std::string bytes;
  const std::string unknown_job = "jobs/0123456789abcdef";
  v1::StreamFramesRequest request;
  request.set_name(unknown_job + "/outputs/depth");
  for (const grpc::Status& status : {ReadAll(request, &frames), Read(unknown_job + "/outputs/report", 0, 0, &bytes)}) {
    EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
    EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_name(), unknown_job);
  }
  const grpc::Status status = ReadAll(Request(job, "colour"), &frames);
  EXPECT_THAT(status, Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
  EXPECT_EQ(Detail<google::rpc::ResourceInfo>(status)->resource_type(), "depthtween/Output");
  EXPECT_THAT(ReadAll(Request(job, "report"), &frames), Fails(grpc::FAILED_PRECONDITION, "NOT_FRAMES"));
  EXPECT_THAT(Read(job.name() + "/outputs/depth", 0, 0, &bytes), Fails(grpc::FAILED_PRECONDITION, "NOT_A_FILE"));
}

// A recorded frame whose file is gone or damaged is our loss, and the stream says which one.
TEST_F(OutputServiceTest, DamagedResultsAreDataLoss) {
  const v1::Job job = SucceededJob();
  v1::StreamFramesRequest request = Request(job, "depth");
  request.set_encoding(v1::ENCODING_RAW);  // fake_core's files are no PNGs
  std::vector<Frame> frames;
  grpc::Status status = ReadAll(request, &frames);
  EXPECT_EQ(status.error_code(), grpc::DATA_LOSS);
  EXPECT_THAT(status.error_message(), testing::HasSubstr("frame 0"));
  std::filesystem::remove(StoredFile(job, "depth/000002.png"));
  status = ReadAll(Request(job, "depth"), &frames);
  EXPECT_EQ(status.error_code(), grpc::DATA_LOSS);
  EXPECT_EQ(frames.size(), 2U);
}

TEST_F(OutputServiceTest, FilesAreReadFromAnyPosition) {
  const v1::Job job = SucceededJob();
  const std::string report = RandomBytes(700'000, 5);
  ForgetChecksums(job);
  WriteText(StoredFile(job, "report.json"), report);
  const std::string name = job.name() + "/outputs/report";
  std::string bytes;
  ASSERT_THAT(Read(name, 0, 0, &bytes), Succeeds());
  EXPECT_EQ(bytes, report);
  bytes.clear();
  ASSERT_THAT(Read(name, 300'001, 5, &bytes), Succeeds());
  EXPECT_EQ(bytes, report.substr(300'001, 5));
  bytes.clear();
  ASSERT_THAT(Read(name, 699'999, std::numeric_limits<int64_t>::max(), &bytes), Succeeds());
  EXPECT_EQ(bytes, report.substr(699'999));
  bytes.clear();
  EXPECT_THAT(Read(name, 700'000, 0, &bytes), Succeeds());
  EXPECT_EQ(bytes, "");
  EXPECT_THAT(Read(name, 700'001, 0, &bytes), Fails(grpc::OUT_OF_RANGE, "BEYOND_END"));

  const v1::Job failed = WaitUntilEnded(CreateJob(ReadySequence("error_at 0 DATA_LOSS")).name());
  EXPECT_THAT(Read(failed.name() + "/outputs/report", 0, 0, &bytes), Fails(grpc::FAILED_PRECONDITION, "WRONG_STATE"));
}

// More readers than threads, none of which reads: other calls are answered as if they were not there.
TEST_F(OutputServiceTest, ReadersThatDoNotReadHoldNoThread) {
  rpc_options.call_threads = 2;
  const v1::Job job = SucceededJob();
  // Larger than what the transport buffers, so that the writes really wait.
  ForgetChecksums(job);
  for (int frame = 0; frame < 6; ++frame) {
    WriteText(StoredFile(job, "depth/00000" + std::to_string(frame) + ".png"), RandomBytes(1 << 20, frame));
  }
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::FrameChunk>>> readers;
  for (int i = 0; i < 8; ++i) {
    contexts.push_back(std::make_unique<grpc::ClientContext>());
    readers.push_back(Open(contexts.back().get(), Request(job, "depth")));
    v1::FrameChunk chunk;
    ASSERT_TRUE(readers.back()->Read(&chunk));
  }
  EXPECT_EQ(GetJob(job.name()).state(), v1::Job::STATE_SUCCEEDED);
  std::vector<Frame> frames;
  EXPECT_THAT(ReadAll(Request(job, "uncertainty"), &frames), Succeeds());
  EXPECT_EQ(frames.size(), 6U);
  for (const auto& context : contexts) context->TryCancel();
}

// The memory of all streams together is bounded: the one too many is asked to come back.
TEST_F(OutputServiceTest, StreamsBeyondTheMemoryAreRefused) {
  rpc_options.frame_memory_bytes = 2 * FrameMemoryBytes({.kind = OutputKind::kDepth}, 4 * 3);
  const v1::Sequence sequence = ReadySequence("wait_at 1");
  const v1::Job job = CreateJob(sequence);
  v1::StreamFramesRequest request = Request(job, "depth");
  request.set_follow(true);
  Frame frame;
  {
    grpc::ClientContext context, other_context;
    const auto reader = Open(&context, request), other = Open(&other_context, request);
    ASSERT_TRUE(ReadFrame(*reader, &frame));
    ASSERT_TRUE(ReadFrame(*other, &frame));
    std::vector<Frame> frames;
    const grpc::Status status = ReadAll(request, &frames);
    EXPECT_THAT(status, Fails(grpc::RESOURCE_EXHAUSTED, "SERVER_BUSY"));
    EXPECT_TRUE(Detail<google::rpc::RetryInfo>(status).has_value());
    context.TryCancel();
    other_context.TryCancel();
  }
  // Streams that are gone give their memory back.
  Go(sequence);
  WaitUntilEnded(job.name());
  grpc::Status status;
  std::vector<Frame> frames;
  do {
    frames.clear();
    status = ReadAll(request, &frames);
  } while (status.error_code() == grpc::RESOURCE_EXHAUSTED);
  EXPECT_THAT(status, Succeeds());
  EXPECT_EQ(frames.size(), 6U);
}

// ---- renders ----

v1::RenderOptions Render(const std::string& name) {
  v1::RenderOptions render;
  render.set_name(name);
  render.mutable_depth_of_field()->set_fstop(1.4);
  return render;
}

TEST_F(OutputServiceTest, PicturesAreOutputsLikeOthers) {
  const v1::Sequence sequence = ReadySequence();
  v1::CreateJobRequest create;
  create.mutable_job()->set_sequence(sequence.name());
  *create.mutable_job()->add_renders() = Render("dof");
  create.mutable_job()->mutable_renders(0)->set_container("mp4");
  grpc::ClientContext context;
  v1::Job job;
  ASSERT_THAT(jobs_stub().CreateJob(&context, create, &job), Succeeds());
  EXPECT_EQ(job.renders(0).depth_of_field().fstop(), 1.4);
  EXPECT_EQ(job.renders(0).container(), "mp4");
  v1::StreamFramesRequest request = Request(job, "dof");
  request.set_follow(true);
  std::vector<Frame> frames;
  EXPECT_THAT(ReadAll(request, &frames), Succeeds());
  ASSERT_EQ(frames.size(), 6U);
  EXPECT_EQ(frames[5].bytes, "dof 5");
  EXPECT_EQ(frames[5].header.encoding(), v1::ENCODING_PNG);
  EXPECT_EQ(frames[5].header.units_per_metre(), 0);
  request.set_encoding(v1::ENCODING_F32);
  EXPECT_THAT(ReadAll(request, &frames), FailsAtField("encoding"));
  EXPECT_EQ(WaitUntilEnded(job.name()).state(), v1::Job::STATE_SUCCEEDED);
  std::string video;
  EXPECT_THAT(Read(job.name() + "/outputs/dof-video", 0, 0, &video), Succeeds());
  EXPECT_EQ(video, "video of dof");
  EXPECT_EQ(GetJob(job.name()).progress().rendered_frames_done(), 6);
}

TEST(FrameEncoding, PicturesLeaveAsTheyAreStoredOrAsJpeg) {
  const std::string png = Take(EncodePngRgb8(Image<Rgb8>(16, 8, Rgb8{200, 100, 50})));
  const OutputSpec stored_png = {.kind = OutputKind::kPictures, .extension = "png"};
  EXPECT_EQ(Take(EncodeFrame(png, stored_png, v1::ENCODING_PNG, 0)), png);
  const std::string jpeg = Take(EncodeFrame(png, stored_png, v1::ENCODING_JPEG, 0));
  const Image<Rgb8> decoded = Take(DecodeJpeg(jpeg));
  EXPECT_NEAR(decoded(8, 4).r, 200, 3);
  EXPECT_NEAR(decoded(8, 4).b, 50, 3);
  const OutputSpec stored_jpeg = {.kind = OutputKind::kPictures, .extension = "jpg"};
  EXPECT_THAT(EncodingsOf(stored_jpeg), testing::ElementsAre(v1::ENCODING_JPEG));
  EXPECT_EQ(Take(EncodeFrame(jpeg, stored_jpeg, v1::ENCODING_JPEG, 0)), jpeg);
  EXPECT_THAT(EncodeFrame("no picture", stored_png, v1::ENCODING_JPEG, 0), HasCode(absl::StatusCode::kDataLoss));
}

// What fake_core refuses, and what the server itself does.
TEST_F(OutputServiceTest, WrongRendersNameTheirField) {
  const v1::Sequence sequence = ReadySequence();
  const auto create = [&](const v1::RenderOptions& render) {
    v1::CreateJobRequest request;
    request.mutable_job()->set_sequence(sequence.name());
    *request.mutable_job()->add_renders() = render;
    grpc::ClientContext context;
    v1::Job job;
    return jobs_stub().CreateJob(&context, request, &job);
  };
  EXPECT_THAT(create(Render("bad")), FailsAtField("job.renders[0].name"));
  v1::RenderOptions render = Render("x");
  render.mutable_depth_of_field()->set_sensor(std::string(100'000, 'x'));
  EXPECT_THAT(create(render), FailsAtField("job.renders[0]")) << "more than is kept with a job";
  v1::CreateJobRequest many;
  many.mutable_job()->set_sequence(sequence.name());
  for (int i = 0; i < 17; ++i) *many.mutable_job()->add_renders() = Render("x");
  grpc::ClientContext context;
  v1::Job job;
  EXPECT_THAT(jobs_stub().CreateJob(&context, many, &job), FailsAtField("job.renders"));
}

TEST_F(OutputServiceTest, OneFrameIsRenderedOnDemand) {
  const v1::Job job = CreateJob(ReadySequence());
  WaitUntilEnded(job.name());
  const auto render = [&](const v1::RenderFrameRequest& request, Frame* frame) {
    grpc::ClientContext context;
    const auto reader = outputs_stub().RenderFrame(&context, request);
    const bool whole = ReadFrame(*reader, frame);
    EXPECT_EQ(whole, frame->chunks > 0);
    return reader->Finish();
  };
  v1::RenderFrameRequest request;
  request.set_job(job.name());
  request.set_frame(3);
  *request.mutable_render() = Render("dof");
  Frame frame;
  EXPECT_THAT(render(request, &frame), Succeeds());
  EXPECT_EQ(frame.index, 3);
  EXPECT_EQ(frame.header.stem(), "000003");
  EXPECT_EQ(frame.header.encoding(), v1::ENCODING_PNG);
  EXPECT_NE(frame.bytes.find("picture 3"), std::string::npos);
  EXPECT_NE(frame.bytes.find(R"("fstop":1.4)"), std::string::npos);
  request.set_frame(6);
  EXPECT_THAT(render(request, &frame), Fails(grpc::OUT_OF_RANGE, "NO_SUCH_FRAME"));
  request.set_frame(-1);
  EXPECT_THAT(render(request, &frame), FailsAtField("frame"));
  request.set_frame(3);
  request.set_encoding(v1::ENCODING_RAW);
  EXPECT_THAT(render(request, &frame), FailsAtField("encoding"));
  request.set_encoding(v1::ENCODING_JPEG);
  *request.mutable_render() = Render("bad");
  EXPECT_THAT(render(request, &frame), FailsAtField("render.name"));
  request.set_job("jobs/0000000000000000");
  EXPECT_THAT(render(request, &frame), Fails(grpc::NOT_FOUND, "NO_SUCH_RESOURCE"));
}

}  // namespace
}  // namespace depthtween::server
