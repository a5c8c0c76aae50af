// A wall at 2 m, filmed at 120 fps in colour and 30 fps in depth: depth for every colour frame.
#include <depthtween/depthtween.h>

#include <cstdio>
#include <vector>

int main() {
  using depthtween::DepthStream;
  const DepthStream::Camera camera = {.width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5};
  DepthStream stream(camera, DepthStream::Options(), [](const DepthStream::Frame& frame) {
    std::printf("%.3f s: %.3f m\n", 1e-9 * frame.time_ns, frame.depth_m[24 * frame.width + 32]);
    return true;
  });
  const std::vector<uint8_t> rgb(64 * 48 * 3, 128);
  const std::vector<uint16_t> depth_mm(64 * 48, 2000);
  for (int64_t i = 0; i < 9; ++i) {
    if (i % 4 == 0) (void)stream.PushDepth(i * 8333333, depth_mm.data(), 64 * 2);
    (void)stream.PushColor(i * 8333333, rgb.data(), 64 * 3);
  }
  const depthtween::Status status = stream.Finish();
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.message().c_str());
  return status.ok() ? 0 : 1;
}
