// OpenCV on one thread while we use it: our own loops share the threads out, and OpenCV dividing again inside each
// would only contend and add up in another order.
#ifndef DEPTHTWEEN_CORE_FLOW_ONE_OPENCV_THREAD_H_
#define DEPTHTWEEN_CORE_FLOW_ONE_OPENCV_THREAD_H_

namespace depthtween {

// While at least one of these exists, cv::setNumThreads(1) holds; the last one to go puts back what the first one
// found. OpenCV has one such number for the whole process. Whoever runs many calls holds one around them all, so that
// it changes twice. Threads: may be held by any number of threads at a time.
class OneOpenCvThread {
 public:
  OneOpenCvThread();
  ~OneOpenCvThread();
  OneOpenCvThread(const OneOpenCvThread&) = delete;
  OneOpenCvThread& operator=(const OneOpenCvThread&) = delete;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_FLOW_ONE_OPENCV_THREAD_H_
