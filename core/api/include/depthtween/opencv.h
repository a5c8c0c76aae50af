// Frames of a DepthStream as OpenCV matrices. Needs OpenCV's headers; nothing is compiled into the library.
#ifndef DEPTHTWEEN_OPENCV_H_
#define DEPTHTWEEN_OPENCV_H_

#include <cstdint>
#include <opencv2/core.hpp>

#include "depthtween/depthtween.h"

namespace depthtween {

// 8-bit with 1 (gray), 3 (BGR) or 4 (BGRA) channels, as cv::imread gives them, of the camera's size.
inline Status PushColor(DepthStream& stream, const DepthStream::Camera& camera, int64_t time_ns, const cv::Mat& color) {
  using Layout = DepthStream::Layout;
  if (color.cols != camera.width || color.rows != camera.height || color.depth() != CV_8U ||
      (color.channels() != 1 && color.channels() != 3 && color.channels() != 4))
    return {Status::Code::kInvalidArgument, "color must be 8-bit of 1, 3 or 4 channels and of the camera's size"};
  const Layout layout = color.channels() == 1 ? Layout::kGray : color.channels() == 3 ? Layout::kBgr : Layout::kBgra;
  return stream.PushColor(time_ns, color.ptr<uint8_t>(), static_cast<ptrdiff_t>(color.step[0]), layout);
}

// CV_16UC1 (units of camera.depth_scale) or CV_32FC1 (metres), of the camera's size.
inline Status PushDepth(DepthStream& stream, const DepthStream::Camera& camera, int64_t time_ns, const cv::Mat& depth) {
  const bool units = depth.type() == CV_16UC1;
  if (depth.cols != camera.width || depth.rows != camera.height || (!units && depth.type() != CV_32FC1))
    return {Status::Code::kInvalidArgument, "depth must be CV_16UC1 or CV_32FC1 and of the camera's size"};
  const auto row_bytes = static_cast<ptrdiff_t>(depth.step[0]);
  return units ? stream.PushDepth(time_ns, depth.ptr<uint16_t>(), row_bytes)
               : stream.PushDepth(time_ns, depth.ptr<float>(), row_bytes);
}

// What a callback receives, without copying: valid as long as the frame is.
inline cv::Mat DepthMat(const DepthStream::Frame& frame) {
  return {frame.height, frame.width, CV_32FC1, const_cast<float*>(frame.depth_m)};
}
inline cv::Mat SigmaMat(const DepthStream::Frame& frame) {
  return {frame.height, frame.width, CV_32FC1, const_cast<float*>(frame.sigma_m)};
}

}  // namespace depthtween

#endif  // DEPTHTWEEN_OPENCV_H_
