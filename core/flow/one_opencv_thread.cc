#include "core/flow/one_opencv_thread.h"

#include <mutex>

#include "opencv2/core.hpp"

namespace depthtween {
namespace {

std::mutex mutex;
int holders = 0;         // guarded by `mutex`
int threads_before = 0;  // guarded by `mutex`: what the first holder found

}  // namespace

OneOpenCvThread::OneOpenCvThread() {
  const std::scoped_lock lock(mutex);
  if (holders++ > 0) return;
  threads_before = cv::getNumThreads();
  cv::setNumThreads(1);
}

OneOpenCvThread::~OneOpenCvThread() {
  const std::scoped_lock lock(mutex);
  if (--holders == 0) cv::setNumThreads(threads_before);
}

}  // namespace depthtween
