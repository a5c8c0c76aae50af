# Build rules shared by every folder: language, warnings, sanitizers, ccache, and one function per kind of target.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # base_dir lets two checkouts share one cache; without the sloppiness nothing compiled with precompiled headers is kept.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${CMAKE_SOURCE_DIR} CCACHE_NOHASHDIR=1
    CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE_PROGRAM})
  set(CMAKE_C_COMPILER_LAUNCHER ${CMAKE_CXX_COMPILER_LAUNCHER})
endif()

# Line tables are enough for a stack trace, and halve the build's output.
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g1 -DNDEBUG")
if(DEPTHTWEEN_SANITIZE)
  # Instrumented code compiles in two thirds of the time at -O1, and runs hardly slower.
  string(REPLACE "-O2" "-O1" CMAKE_CXX_FLAGS_RELWITHDEBINFO "${CMAKE_CXX_FLAGS_RELWITHDEBINFO}")
endif()
if(DEPTHTWEEN_ASSERTIONS)
  string(REPLACE "-DNDEBUG" "" CMAKE_CXX_FLAGS_RELWITHDEBINFO "${CMAKE_CXX_FLAGS_RELWITHDEBINFO}")
endif()

add_library(depthtween_flags INTERFACE)
target_include_directories(depthtween_flags INTERFACE ${CMAKE_SOURCE_DIR})
target_compile_options(depthtween_flags INTERFACE -Wall -Wextra -Wno-unused-parameter -Wno-missing-field-initializers -Wnon-virtual-dtor -Woverloaded-virtual)
target_compile_options(depthtween_flags INTERFACE -fno-math-errno)
# At -O3, and under sanitizers, GCC 12 sees overlapping copies inside std::string and unset members of variants that
# cannot happen (GCC bugs 105651 and 105562). Development builds keep both warnings.
if(CMAKE_BUILD_TYPE STREQUAL "Release" OR DEPTHTWEEN_SANITIZE)
  target_compile_options(depthtween_flags INTERFACE
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict> $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
endif()
if(DEPTHTWEEN_CPU AND CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  target_compile_options(depthtween_flags INTERFACE -march=${DEPTHTWEEN_CPU})
endif()
# Debian's libraries are built for the baseline processor; Eigen objects that cross into one must have its alignment.
target_compile_definitions(depthtween_flags INTERFACE EIGEN_MAX_ALIGN_BYTES=16 EIGEN_MPL2_ONLY
  DEPTHTWEEN_VERSION="${PROJECT_VERSION}")
if(DEPTHTWEEN_SANITIZE)
  target_compile_options(depthtween_flags INTERFACE -fsanitize=${DEPTHTWEEN_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(depthtween_flags INTERFACE -fsanitize=${DEPTHTWEEN_SANITIZE})
  if(DEPTHTWEEN_SANITIZE MATCHES "thread")
    # With this macro Protobuf's headers give maps two members more than Debian's library knows of.
    target_compile_options(depthtween_flags INTERFACE -U__SANITIZE_THREAD__)
    # The sanitizer sees no fences, and GCC warns of each. Those of Boost.Asio stand beside locks, which it does see.
    target_compile_definitions(depthtween_flags INTERFACE BOOST_ASIO_DISABLE_FENCED_BLOCK)
  endif()
  if(DEPTHTWEEN_SANITIZE MATCHES "undefined")
    target_compile_options(depthtween_flags INTERFACE -fno-sanitize-recover=undefined)
  endif()
  if(DEPTHTWEEN_FUZZ)
    target_compile_options(depthtween_flags INTERFACE -fsanitize=fuzzer-no-link)
  endif()
endif()

find_package(Threads REQUIRED)
find_package(absl REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(TBB REQUIRED)
# Debian keeps OpenCVConfig.cmake in libopencv-dev, which pulls in Qt and a GIS stack; the modules alone are found by name.
find_path(OPENCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
foreach(MODULE core imgproc video)
  find_library(OPENCV_${MODULE}_LIBRARY opencv_${MODULE} REQUIRED)
  add_library(opencv_${MODULE} INTERFACE)
  target_include_directories(opencv_${MODULE} SYSTEM INTERFACE ${OPENCV_INCLUDE_DIR})
  target_link_libraries(opencv_${MODULE} INTERFACE ${OPENCV_${MODULE}_LIBRARY})
endforeach()
find_package(nlohmann_json REQUIRED)
find_package(PkgConfig REQUIRED)

# Headers that most sources include, parsed once for each kind of target instead of once for each source:
#   code   every library          tests      every test program
#   json   those that speak JSON  rpc_tests  tests of those that speak gRPC
#   rpc    those that speak gRPC
#   http   those that speak HTTP    http_tests  tests of those
# Sources still include what they use: the preset tidy compiles each by itself.
set(PRECOMPILED_code <algorithm> <array> <cmath> <cstdint> <cstdlib> <filesystem> <functional> <limits> <map> <memory>
  <optional> <set> <string> <string_view> <utility> <vector> <absl/status/status.h> <absl/status/statusor.h>
  <absl/strings/str_cat.h> <absl/strings/str_format.h> <absl/strings/str_join.h> <absl/strings/str_split.h>
  <Eigen/Core> <Eigen/Geometry>)
set(PRECOMPILED_json ${PRECOMPILED_code} <absl/time/time.h> <nlohmann/json.hpp>)
set(PRECOMPILED_rpc ${PRECOMPILED_json} <grpcpp/grpcpp.h>)
set(PRECOMPILED_http ${PRECOMPILED_rpc} <boost/asio.hpp> <boost/asio/ssl.hpp> <boost/beast/http.hpp>)
set(PRECOMPILED_tests ${PRECOMPILED_json} <gmock/gmock.h> <gtest/gtest.h>)
set(PRECOMPILED_rpc_tests ${PRECOMPILED_rpc} <gmock/gmock.h> <gtest/gtest.h>)
set(PRECOMPILED_http_tests ${PRECOMPILED_http} <gmock/gmock.h> <gtest/gtest.h>)

# depthtween_precompile(core_flow code): the target's sources are compiled with the headers of that kind.
function(depthtween_precompile TARGET KIND)
  if(NOT TARGET precompiled_${KIND})
    file(CONFIGURE OUTPUT ${CMAKE_BINARY_DIR}/precompiled_${KIND}.cc CONTENT "int main() {}\n")
    if(KIND MATCHES "tests")
      # A precompiled header serves code compiled with the very same flags, and programs have others than libraries.
      add_executable(precompiled_${KIND} EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/precompiled_${KIND}.cc)
    else()
      add_library(precompiled_${KIND} OBJECT EXCLUDE_FROM_ALL ${CMAKE_BINARY_DIR}/precompiled_${KIND}.cc)
    endif()
    # What its users link may define macros and set flags; the headers must be compiled with the same.
    target_link_libraries(precompiled_${KIND} PRIVATE depthtween_flags Eigen3::Eigen
      $<$<BOOL:$<FILTER:${KIND},INCLUDE,rpc|http>>:gRPC::grpc++> $<$<BOOL:$<FILTER:${KIND},INCLUDE,tests>>:GTest::gmock>)
    target_precompile_headers(precompiled_${KIND} PRIVATE ${PRECOMPILED_${KIND}})
  endif()
  target_include_directories(${TARGET} SYSTEM PRIVATE ${EIGEN3_INCLUDE_DIRS})
  target_precompile_headers(${TARGET} REUSE_FROM precompiled_${KIND})
endfunction()

# depthtween_library(core/flow DEPS core_sequence opencv_video ...): the static library core_flow of every .cc in this
# folder. One library per module, so that a wrong edge fails to link. PRECOMPILED names a kind other than code.
# FEW_UNITS compiles the sources several at a time, so that what they make of JSON, CLI11 and gRPC templates is made
# once. Names in anonymous namespaces must then differ within a module. Not for code that computes depth: what a compiler
# sees together decides how it rounds, and results keep their bits.
function(depthtween_library PATH)
  cmake_parse_arguments(ARG "FEW_UNITS" "PRECOMPILED" "DEPS" ${ARGN})
  string(REPLACE "/" "_" NAME ${PATH})
  file(GLOB SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  list(FILTER SOURCES EXCLUDE REGEX "main\\.cc$")
  if(NOT ARG_PRECOMPILED)
    set(ARG_PRECOMPILED code)
  endif()
  add_library(${NAME} STATIC ${SOURCES})
  target_link_libraries(${NAME} PUBLIC depthtween_flags ${ARG_DEPS})
  depthtween_precompile(${NAME} ${ARG_PRECOMPILED})
  if(ARG_FEW_UNITS)
    set_target_properties(${NAME} PROPERTIES UNITY_BUILD ${DEPTHTWEEN_FEW_UNITS})
  endif()
endfunction()

# depthtween_tests(core/flow DEPS core_flow ... [LABELS ...]): one test program core_flow_test of every *_test.cc in this
# folder. PRECOMPILED names a kind other than tests.
function(depthtween_tests PATH)
  cmake_parse_arguments(ARG "" "TIMEOUT;PRECOMPILED" "DEPS;LABELS" ${ARGN})
  string(REPLACE "/" "_" NAME ${PATH})
  file(GLOB SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*_test.cc)
  if(NOT SOURCES)
    return()
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  if(DEPTHTWEEN_SANITIZE)
    math(EXPR ARG_TIMEOUT "4 * ${ARG_TIMEOUT}")
  endif()
  if(NOT ARG_PRECOMPILED)
    set(ARG_PRECOMPILED tests)
  endif()
  add_executable(${NAME}_test ${SOURCES})
  target_link_libraries(${NAME}_test PRIVATE depthtween_flags ${ARG_DEPS} GTest::gmock_main)
  depthtween_precompile(${NAME}_test ${ARG_PRECOMPILED})
  set_target_properties(${NAME}_test PROPERTIES UNITY_BUILD ${DEPTHTWEEN_FEW_UNITS})
  add_test(NAME ${NAME}_test COMMAND ${NAME}_test)
  set_tests_properties(${NAME}_test PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}")
endfunction()
