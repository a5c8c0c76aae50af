// A point or a displacement as three floats: what images of points hold.
#ifndef DEPTHTWEEN_CORE_BASE_FLOAT3_H_
#define DEPTHTWEEN_CORE_BASE_FLOAT3_H_

namespace depthtween {

// In a camera's frame: x right, y down, z forward, metres.
struct Float3 {
  float x = 0.0F, y = 0.0F, z = 0.0F;
};

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_BASE_FLOAT3_H_
