# SPDX-License-Identifier: Apache-2.0
# find_package(imu_thermal) and target_link_libraries(... imu_thermal::imu_thermal) after
# cmake -B build -DCMAKE_INSTALL_PREFIX=... && cmake --build build --target install
# or, in the src folder of a ROS workspace, after colcon build.
cmake_minimum_required(VERSION 3.16)
project(imu_thermal LANGUAGES C)

option(IMU_THERMAL_DOUBLE "Compute in double precision" OFF)

add_library(imu_thermal STATIC imu_thermal.c)
set_target_properties(imu_thermal PROPERTIES C_STANDARD 99 C_EXTENSIONS OFF
                      POSITION_INDEPENDENT_CODE ON)
if(IMU_THERMAL_DOUBLE)
  target_compile_definitions(imu_thermal PUBLIC IMU_THERMAL_DOUBLE)
endif()
if(UNIX)
  target_link_libraries(imu_thermal PUBLIC m)
endif()
target_include_directories(imu_thermal PUBLIC
  "$<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}>" "$<INSTALL_INTERFACE:include>")

install(TARGETS imu_thermal EXPORT imu_thermal ARCHIVE DESTINATION lib)
install(FILES imu_thermal.h DESTINATION include)
install(EXPORT imu_thermal FILE imu_thermalConfig.cmake NAMESPACE imu_thermal::
        DESTINATION lib/cmake/imu_thermal)

# The mark by which ROS finds a package among those that are installed.
file(WRITE "${CMAKE_CURRENT_BINARY_DIR}/marker" "")
install(FILES "${CMAKE_CURRENT_BINARY_DIR}/marker" RENAME imu_thermal
        DESTINATION share/ament_index/resource_index/packages)
install(FILES package.xml DESTINATION share/imu_thermal)
