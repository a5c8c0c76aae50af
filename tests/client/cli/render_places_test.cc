// Where renders are written. Names are written by hand.
#include "client/cli/render_places.h"

#include <gtest/gtest.h>

namespace depthtween::cli {
namespace {

v1::Output Named(const std::string& stream, const std::string& file) {
  v1::Output output;
  output.set_name("jobs/7/outputs/" + stream);
  output.set_file_name(file);
  return output;
}

// Players know pairs by what follows the name.
TEST(RenderPlaces, KeepTheEndingOfTheServer) {
  EXPECT_EQ(*VideoPlace("my/out.mp4", "dof", Named("dof-video", "dof.mp4")), "my/out.mp4");
  EXPECT_EQ(*VideoPlace("out.mp4", "stereo", Named("stereo-video", "stereo_LRF_Full_SBS.mp4")), "out_LRF_Full_SBS.mp4");
  EXPECT_EQ(*PictureFolder("out", "dof", Named("dof", "dof")), "out");
  EXPECT_EQ(*PictureFolder("out", "stereo", Named("stereo-left", "stereo-left")), "out/left");
}

// A server is not trusted with the names of files on this machine.
TEST(RenderPlaces, NeverLeadElsewhere) {
  for (const std::string file : {"", "dof/../../escaped.mp4", "../escaped.mp4", "/escaped.mp4"}) {
    EXPECT_TRUE(absl::IsDataLoss(VideoPlace("out.mp4", "dof", Named("dof-video", file)).status())) << file;
  }
  EXPECT_TRUE(absl::IsDataLoss(PictureFolder("out", "dof", Named("dof-..", "")).status()));
  EXPECT_EQ(*PictureFolder("out", "dof", Named("dof-a/../..", "")), "out");
}

}  // namespace
}  // namespace depthtween::cli
