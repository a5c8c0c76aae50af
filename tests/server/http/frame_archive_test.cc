// Frames into archives. The truth is the archive itself: what the pieces add up to is what ZipIndex, which Python
// checks in zip_index_test.cc, makes of the same files.
#include "server/http/frame_archive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace depthtween::server {
namespace {

v1::FrameChunk Chunk(int frame, int64_t offset, const std::string& data) {
  v1::FrameChunk chunk;
  chunk.set_frame(frame);
  chunk.set_offset(offset);
  chunk.set_data(data);
  return chunk;
}

v1::FrameChunk First(int frame, int64_t size_bytes, const std::string& data) {
  v1::FrameChunk chunk = Chunk(frame, 0, data);
  chunk.mutable_header()->set_stem("00" + std::to_string(frame));
  chunk.mutable_header()->set_encoding(v1::ENCODING_PNG);
  chunk.mutable_header()->set_size_bytes(size_bytes);
  return chunk;
}

v1::FrameChunk Last(v1::FrameChunk chunk) {
  chunk.set_next_frame(chunk.frame() + 1);
  return chunk;
}

TEST(ArchiveBuilder, MakesTheArchiveOfItsFrames) {
  ArchiveBuilder builder("kitti/flow");
  std::string bytes;
  for (const v1::FrameChunk& chunk : {Last(First(0, 3, "one")), First(1, 5, "th"), Chunk(1, 2, "r"),
                                      Last(Chunk(1, 3, "ee")), Last(First(2, 0, ""))}) {
    const auto piece = builder.Add(chunk);
    ASSERT_THAT(piece, IsOk());
    bytes += piece->before + std::string(piece->data) + piece->after;
  }
  ZipIndex expected;
  expected.Add("kitti/flow/000.png", 3, ExtendZipCrc32(0, "one"));
  expected.Add("kitti/flow/001.png", 5, ExtendZipCrc32(0, "three"));
  EXPECT_EQ(bytes, ZipIndex::LocalHeader("kitti/flow/000.png", 3) + "one" +
                       ZipIndex::Descriptor(3, ExtendZipCrc32(0, "one")) +
                       ZipIndex::LocalHeader("kitti/flow/001.png", 5) + "three" +
                       ZipIndex::Descriptor(5, ExtendZipCrc32(0, "three")));
  // The last frame has nothing to give.
  const ArchiveLayout layout = builder.TakeLayout();
  EXPECT_THAT(layout.frames, testing::ElementsAre(0, 1));
  EXPECT_EQ(layout.next_frame, 3);
  EXPECT_EQ(layout.index.size_bytes(), expected.size_bytes());
  EXPECT_EQ(layout.index.End(), expected.End());
}

TEST(ArchiveBuilder, RefusesChunksThatDoNotFit) {
  const auto fails = testing::Truly([](const auto& result) { return absl::IsDataLoss(result.status()); });
  {
    ArchiveBuilder builder("d");
    EXPECT_THAT(builder.Add(Chunk(0, 0, "x")), fails) << "no header";
  }
  {
    ArchiveBuilder builder("d");
    EXPECT_THAT(builder.Add(First(0, 4, "ab")), IsOk());
    EXPECT_THAT(builder.Add(Chunk(0, 3, "d")), fails) << "a gap";
  }
  {
    ArchiveBuilder builder("d");
    EXPECT_THAT(builder.Add(Last(First(0, 4, "ab"))), fails) << "too short";
  }
  {
    ArchiveBuilder builder("d");
    EXPECT_THAT(builder.Add(First(0, 4, "ab")), IsOk());
    EXPECT_THAT(builder.Add(First(1, 4, "ab")), fails) << "cut by the next frame";
  }
}

TEST(ByteWindow, LetsThroughWhatIsWanted) {
  const std::string all = "0123456789";
  for (int64_t skip = 0; skip <= 10; ++skip) {
    for (int64_t size = 0; size <= 10 - skip; ++size) {
      for (size_t step = 1; step <= 10; ++step) {
        ByteWindow window(skip, size);
        std::string got;
        for (size_t at = 0; at < all.size(); at += step) got += window.Cut(std::string_view(all).substr(at, step));
        EXPECT_EQ(got, all.substr(skip, size));
        EXPECT_TRUE(window.full());
      }
    }
  }
  ByteWindow open(0, 5);
  EXPECT_FALSE(open.full());
}

TEST(ArchiveLayouts, KeepsWhatWasUsedLast) {
  const auto layout = [] {
    auto made = std::make_shared<ArchiveLayout>();
    for (int i = 0; i < 100; ++i) {
      made->index.Add(std::to_string(i), 1, 0);
      made->frames.push_back(i);
    }
    return made;
  };
  ArchiveLayouts layouts(layout()->memory_bytes() * 2);
  layouts.Keep("a", layout());
  layouts.Keep("b", layout());
  EXPECT_NE(layouts.Find("a"), nullptr);
  layouts.Keep("c", layout());
  EXPECT_NE(layouts.Find("a"), nullptr);
  EXPECT_EQ(layouts.Find("b"), nullptr) << "it was used before the others";
  EXPECT_NE(layouts.Find("c"), nullptr);
  layouts.Keep("c", layout());
  EXPECT_NE(layouts.Find("a"), nullptr) << "the same again takes no more room";
  // One that has no room even alone is not kept.
  ArchiveLayouts tiny(10);
  tiny.Keep("a", layout());
  EXPECT_EQ(tiny.Find("a"), nullptr);
}

}  // namespace
}  // namespace depthtween::server
