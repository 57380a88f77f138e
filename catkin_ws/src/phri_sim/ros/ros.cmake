# The ROS half of phri_sim: the experiment node, the session runner, their launch files and rostests.
# Found apart from the core's dependencies: the library phri_sim does not link ROS.
set(ros_packages diagnostic_updater geometry_msgs nav_msgs phri_msgs rosbag_storage roscpp rosgraph_msgs sensor_msgs std_msgs
  std_srvs tf2_msgs tf2_ros visualization_msgs)
foreach(package ${ros_packages})
  find_package(${package} REQUIRED)
  list(APPEND ros_include_dirs ${${package}_INCLUDE_DIRS})
  list(APPEND ros_libraries ${${package}_LIBRARIES})
  list(APPEND ros_targets ${${package}_EXPORTED_TARGETS})
endforeach()
list(REMOVE_DUPLICATES ros_include_dirs)
find_package(nlohmann_json REQUIRED)

set(experiment_node_sources
  ros/experiment_node.cpp
  ros/instance_lock.cpp
  ros/live_view.cpp
  ros/markers.cpp
  ros/metadata.cpp
  ros/node_settings.cpp
  ros/prediction_inbox.cpp
  ros/realtime_loop.cpp
  ros/recorder.cpp
  ros/trial_host.cpp
  ros/trial_host_realtime.cpp
  ros/trial_messages.cpp
  ros/trial_output.cpp)
add_executable(experiment_node ${experiment_node_sources})
add_dependencies(experiment_node ${ros_targets})
include_directories(include)
include_directories(SYSTEM ${catkin_INCLUDE_DIRS} ${ros_include_dirs})
target_link_libraries(experiment_node ${PROJECT_NAME} ${ros_libraries} nlohmann_json::nlohmann_json)

install(TARGETS experiment_node RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
catkin_install_python(PROGRAMS nodes/session_runner.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  find_package(roslaunch REQUIRED)
  roslaunch_add_file_check(launch)
  # has no ROS in it
  target_sources(${PROJECT_NAME}_test_realtime_loop PRIVATE ros/realtime_loop.cpp)
endif()
