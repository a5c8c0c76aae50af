// Descriptors of this process: the system says which of them are open.
#include "core/base/descriptor.h"

#include <fcntl.h>
#include <gtest/gtest.h>

namespace depthtween {
namespace {

bool IsOpen(int fd) { return fcntl(fd, F_GETFD) >= 0; }

TEST(Descriptor, IsClosedAtItsEndOrBefore) {
  int number = -1;
  {
    const Descriptor held(open("/dev/null", O_RDONLY | O_CLOEXEC));
    ASSERT_TRUE(held.valid());
    number = held.get();
    EXPECT_TRUE(IsOpen(number));
  }
  EXPECT_FALSE(IsOpen(number));

  Descriptor closed(open("/dev/null", O_RDONLY | O_CLOEXEC));
  number = closed.get();
  EXPECT_TRUE(closed.Close());
  EXPECT_FALSE(closed.valid());
  EXPECT_FALSE(IsOpen(number));
}

TEST(Descriptor, OfNothing) {
  Descriptor none(open("/no/such/file", O_RDONLY | O_CLOEXEC));
  EXPECT_FALSE(none.valid());
  EXPECT_FALSE(none.Close());
}

}  // namespace
}  // namespace depthtween
