# The ROS half of phri_control: interaction_node, its launch file and configuration. Found apart from the core's
# dependencies: the library phri_control does not link ROS.
set(ros_packages diagnostic_updater geometry_msgs nav_msgs phri_msgs roscpp sensor_msgs std_msgs std_srvs tf2_msgs)
foreach(package ${ros_packages})
  find_package(${package} REQUIRED)
  list(APPEND ros_include_dirs ${${package}_INCLUDE_DIRS})
  list(APPEND ros_libraries ${${package}_LIBRARIES})
  list(APPEND ros_targets ${${package}_EXPORTED_TARGETS})
endforeach()
list(REMOVE_DUPLICATES ros_include_dirs)

include_directories(include)
include_directories(SYSTEM ${catkin_INCLUDE_DIRS} ${ros_include_dirs})
# everything of the node but its main, for the node and for tests
add_library(phri_control_ros STATIC
  ros/interaction_host.cpp
  ros/interaction_settings.cpp
  ros/interaction_text.cpp
  ros/robot_outputs.cpp
  ros/robot_tick.cpp
  ros/robot_topics.cpp
  ros/tick_thread.cpp)
add_dependencies(phri_control_ros ${ros_targets})
target_link_libraries(phri_control_ros ${PROJECT_NAME} ${ros_libraries})
add_executable(interaction_node ros/interaction_node.cpp)
target_link_libraries(interaction_node phri_control_ros)

install(TARGETS interaction_node RUNTIME DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION})
install(DIRECTORY config launch DESTINATION ${CATKIN_PACKAGE_SHARE_DESTINATION})

if(CATKIN_ENABLE_TESTING)
  find_package(roslaunch REQUIRED)
  roslaunch_add_file_check(launch)
  target_link_libraries(${PROJECT_NAME}_test_robot_tick phri_control_ros)
endif()
