# The ROS half of phri_sim: the experiment node, the session runner, their launch files and rostests.
# Found apart from the core's dependencies: the library phri_sim does not link ROS.
set(ros_packages diagnostic_updater dynamic_reconfigure geometry_msgs interactive_markers nav_msgs phri_msgs rosbag_storage roscpp rosgraph_msgs sensor_msgs std_msgs
  std_srvs tf2_msgs tf2_ros visualization_msgs)
foreach(package ${ros_packages})
  find_package(${package} REQUIRED)
  list(APPEND ros_include_dirs ${${package}_INCLUDE_DIRS})
  list(APPEND ros_libraries ${${package}_LIBRARIES})
  list(APPEND ros_targets ${${package}_EXPORTED_TARGETS})
endforeach()
list(REMOVE_DUPLICATES ros_include_dirs)
find_package(nlohmann_json REQUIRED)
find_package(ZLIB REQUIRED)

include_directories(include)
include_directories(SYSTEM ${catkin_INCLUDE_DIRS} ${ros_include_dirs})
# everything of the node but its main, for the node and for tests
add_library(phri_sim_ros STATIC
  ros/bag_digest.cpp
  ros/carrying_markers.cpp
  ros/hand_source.cpp
  ros/instance_lock.cpp
  ros/joy_hand.cpp
  ros/lab_markers.cpp
  ros/live_view.cpp
  ros/marker_hand.cpp
  ros/marker_shapes.cpp
  ros/markers.cpp
  ros/metadata.cpp
  ros/node_settings.cpp
  ros/operator_text.cpp
  ros/planar_view.cpp
  ros/prediction_inbox.cpp
  ros/realtime_loop.cpp
  ros/recorder.cpp
  ros/replay_hand.cpp
  ros/robot_messages.cpp
  ros/robot_view.cpp
  ros/spring_source.cpp
  ros/stage_sample.cpp
  ros/stage_view.cpp
  ros/topic_hand.cpp
  ros/trial_host.cpp
  ros/trial_host_operator.cpp
  ros/trial_host_realtime.cpp
  ros/trial_messages.cpp
  ros/trial_output.cpp
  ros/tuning_server.cpp)
add_dependencies(phri_sim_ros ${ros_targets})
target_link_libraries(phri_sim_ros ${PROJECT_NAME} ${ros_libraries} nlohmann_json::nlohmann_json ZLIB::ZLIB)
add_executable(experiment_node ros/experiment_node.cpp)
target_link_libraries(experiment_node phri_sim_ros)

install(TARGETS experiment_node RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
catkin_install_python(PROGRAMS nodes/drag_marker.py nodes/joy_node.py nodes/session_runner.py DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  find_package(roslaunch REQUIRED)
  roslaunch_add_file_check(launch)
  foreach(test rostest_hands rostest_transport)
    add_executable(${test} EXCLUDE_FROM_ALL test/${test}.cpp)
    add_dependencies(tests ${test})
    target_link_libraries(${test} gtest)
  endforeach()
  # what the fault tests of the analysis kill and starve of disk
  add_executable(recorder_test_driver EXCLUDE_FROM_ALL test/recorder_driver.cpp)
  add_dependencies(tests recorder_test_driver)
  foreach(target rostest_hands rostest_transport recorder_test_driver ${PROJECT_NAME}_test_realtime_loop ${PROJECT_NAME}_test_recorder
      ${PROJECT_NAME}_test_replay_hand)
    add_dependencies(${target} ${ros_targets})
    target_link_libraries(${target} phri_sim_ros)
  endforeach()
endif()
