# What every package of this stack does the same way. Reaches the other packages through find_package(phri_core).
#   phri_library(SOURCES ... LINK ...)    the package's C++ library, named as the package
#   phri_python(LINK ...)                 every python/*.cpp as the flat module `import <package>`
#   phri_tests(LINK ...)                  every test/test_*.cpp as a gtest program
#   phri_benchmarks(LINK ...)             every bench/bench_*.cpp as a program of its own
include_guard(GLOBAL)

set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
# no -ffast-math and no contraction: NaN checks must stay, and one seed must give the same numbers everywhere
add_compile_options(-Wall -Wextra -ffp-contract=off -fno-fast-math)

# catkin has already chosen PYTHON_EXECUTABLE (FindPythonInterp); FindPython, which pybind11 uses, must agree.
set(Python_EXECUTABLE "${PYTHON_EXECUTABLE}")
set(Python3_EXECUTABLE "${PYTHON_EXECUTABLE}")

macro(phri_library)
  cmake_parse_arguments(LIB "" "" "SOURCES;LINK" ${ARGN})
  add_library(${PROJECT_NAME} SHARED ${LIB_SOURCES})
  target_include_directories(${PROJECT_NAME} PUBLIC
    $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:include>)
  target_include_directories(${PROJECT_NAME} SYSTEM PUBLIC ${catkin_INCLUDE_DIRS})
  target_link_libraries(${PROJECT_NAME} PUBLIC ${catkin_LIBRARIES} Eigen3::Eigen ${LIB_LINK})
  install(TARGETS ${PROJECT_NAME}
    ARCHIVE DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    LIBRARY DESTINATION ${CATKIN_PACKAGE_LIB_DESTINATION}
    RUNTIME DESTINATION ${CATKIN_GLOBAL_BIN_DESTINATION})
  install(DIRECTORY include/${PROJECT_NAME}/ DESTINATION ${CATKIN_PACKAGE_INCLUDE_DESTINATION})
endmacro()

macro(phri_python)
  find_package(Python COMPONENTS Interpreter Development.Module REQUIRED)
  find_package(pybind11 2.10 REQUIRED CONFIG)
  file(GLOB python_sources CONFIGURE_DEPENDS python/*.cpp)
  pybind11_add_module(${PROJECT_NAME}_python MODULE NO_EXTRAS ${python_sources})
  target_link_libraries(${PROJECT_NAME}_python PRIVATE ${PROJECT_NAME} ${ARGN})
  set_target_properties(${PROJECT_NAME}_python PROPERTIES
    OUTPUT_NAME ${PROJECT_NAME}
    LIBRARY_OUTPUT_DIRECTORY ${CATKIN_DEVEL_PREFIX}/${CATKIN_GLOBAL_PYTHON_DESTINATION})
  install(TARGETS ${PROJECT_NAME}_python LIBRARY DESTINATION ${CATKIN_GLOBAL_PYTHON_DESTINATION})
endmacro()

macro(phri_tests)
  if(CATKIN_ENABLE_TESTING)
    file(GLOB test_sources CONFIGURE_DEPENDS test/test_*.cpp)
    foreach(source ${test_sources})
      get_filename_component(name ${source} NAME_WE)
      catkin_add_gtest(${PROJECT_NAME}_${name} ${source})
      target_link_libraries(${PROJECT_NAME}_${name} ${PROJECT_NAME} gtest_main ${ARGN})
    endforeach()
  endif()
endmacro()

# The programs go to <build space>/<package>/bench/ and are made by the target `benchmarks` alone: neither `all` nor
# `tests` compiles them. Other .cpp files of bench/ are shared by all of them.
macro(phri_benchmarks)
  find_package(benchmark QUIET)
  if(benchmark_FOUND)
    if(NOT TARGET benchmarks)
      add_custom_target(benchmarks)
    endif()
    file(GLOB benchmark_common CONFIGURE_DEPENDS bench/*.cpp)
    file(GLOB benchmark_sources CONFIGURE_DEPENDS bench/bench_*.cpp)
    list(REMOVE_ITEM benchmark_common ${benchmark_sources})
    foreach(source ${benchmark_sources})
      get_filename_component(name ${source} NAME_WE)
      add_executable(${name} EXCLUDE_FROM_ALL ${source} ${benchmark_common})
      target_link_libraries(${name} ${PROJECT_NAME} benchmark::benchmark ${ARGN})
      set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/bench)
      add_dependencies(benchmarks ${name})
    endforeach()
  endif()
endmacro()
