// The rules of local_address.h, with folders and sockets that are there or not.
#include "proto/depthtween/local_address.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "tests/support/temporary_folder.h"

namespace depthtween {
namespace {

TEST(LocalAddress, ASocketOfTheSessionElseThePort) {
  const TemporaryFolder folder;
  const std::string socket = folder / "depthtween.sock";
  setenv("XDG_RUNTIME_DIR", folder.path().c_str(), 1);
  EXPECT_EQ(LocalListenAddress(), "unix:" + socket);
  EXPECT_EQ(LocalServerAddress(), kLocalPort) << "nobody listens there";
  std::ofstream(socket) << "";
  EXPECT_EQ(LocalServerAddress(), "unix:" + socket);
  for (const std::string& none : {std::string(), std::string("relative"), folder / "missing", socket}) {
    setenv("XDG_RUNTIME_DIR", none.c_str(), 1);
    EXPECT_EQ(LocalListenAddress(), kLocalPort) << none;
    EXPECT_EQ(LocalServerAddress(), kLocalPort) << none;
  }
  unsetenv("XDG_RUNTIME_DIR");
  EXPECT_EQ(LocalListenAddress(), kLocalPort);
}

}  // namespace
}  // namespace depthtween
