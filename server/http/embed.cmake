# cmake -D IN=api.binpb -D OUT=api_descriptors.cc -P embed.cmake: the bytes of a file as a C++ source.
file(READ ${IN} HEX HEX)
string(REGEX REPLACE "(..)" "0x\\1," BYTES "${HEX}")
string(REGEX REPLACE "(................................................................................)" "\\1\n" BYTES "${BYTES}")
file(WRITE ${OUT} "// Made by embed.cmake.
#include \"server/http/api_descriptors.h\"

namespace depthtween::server {

const unsigned char kApiDescriptors[] = {
${BYTES}
};
const size_t kApiDescriptorsSize = sizeof(kApiDescriptors);

}  // namespace depthtween::server
")
