// How a trajectory depends on time: the motion of a point at frame s is the sum of its coefficients times basis(s, k).
//
// Columns are orthonormal over the frames, so that what is quadratic in a motion and summed over frames falls apart
// into independent copies, one for each coefficient. The two parameterisations of the solver are two bases.
#ifndef DEPTHTWEEN_CORE_SOLVE_TIME_BASIS_H_
#define DEPTHTWEEN_CORE_SOLVE_TIME_BASIS_H_

#include <vector>

namespace depthtween {

class TimeBasis {
 public:
  // Orthonormalised {t, t (t - 1)}: constant velocity and acceleration. One frame leaves rank 1.
  // `times`: of the frames after the key, ascending, in intervals from the key (key 0, other key 1). At least one.
  static TimeBasis Trajectory(const std::vector<float>& times);
  // Every frame for itself.
  static TimeBasis PerFrame(int frames);

  int frames() const { return frames_; }
  int rank() const { return rank_; }
  float operator()(int frame, int k) const { return value_[frame * rank_ + k]; }
  // The coefficients that a frame depends on: [First, End).
  int First(int frame) const { return per_frame_ ? frame : 0; }
  int End(int frame) const { return per_frame_ ? frame + 1 : rank_; }
  bool per_frame() const { return per_frame_; }

 private:
  TimeBasis(int frames, int rank, bool per_frame)
      : frames_(frames),
        rank_(rank),
        per_frame_(per_frame),
        value_(static_cast<size_t>(frames) * static_cast<size_t>(rank)) {}
  int frames_, rank_;
  bool per_frame_;
  std::vector<float> value_;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_SOLVE_TIME_BASIS_H_
