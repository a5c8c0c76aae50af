# Build rules shared by every folder: language, warnings, sanitizers, ccache, and one function per kind of target.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # base_dir lets two checkouts share one cache.
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_BASEDIR=${CMAKE_SOURCE_DIR} CCACHE_NOHASHDIR=1 ${CCACHE_PROGRAM})
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

# depthtween_library(core/flow DEPS core_sequence opencv_video ...): the static library core_flow of every .cc in this
# folder. One library per module, so that a wrong edge fails to link.
function(depthtween_library PATH)
  cmake_parse_arguments(ARG "" "" "DEPS" ${ARGN})
  string(REPLACE "/" "_" NAME ${PATH})
  file(GLOB SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cc)
  list(FILTER SOURCES EXCLUDE REGEX "main\\.cc$")
  if(SOURCES)
    add_library(${NAME} STATIC ${SOURCES})
    target_link_libraries(${NAME} PUBLIC depthtween_flags ${ARG_DEPS})
  else()
    add_library(${NAME} INTERFACE)
    target_link_libraries(${NAME} INTERFACE depthtween_flags ${ARG_DEPS})
  endif()
endfunction()

# depthtween_tests(core/flow DEPS core_flow ... [LABELS ...]): one test program core_flow_test of every *_test.cc in this folder.
function(depthtween_tests PATH)
  cmake_parse_arguments(ARG "" "TIMEOUT" "DEPS;LABELS" ${ARGN})
  string(REPLACE "/" "_" NAME ${PATH})
  file(GLOB SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*_test.cc)
  if(NOT SOURCES)
    return()
  endif()
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  add_executable(${NAME}_test ${SOURCES})
  target_link_libraries(${NAME}_test PRIVATE depthtween_flags ${ARG_DEPS} GTest::gmock_main)
  add_test(NAME ${NAME}_test COMMAND ${NAME}_test)
  set_tests_properties(${NAME}_test PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}")
endfunction()
