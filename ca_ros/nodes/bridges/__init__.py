"""Bridges to PX4, Gazebo, ros2_control and actuator_msgs; the conversions need no ROS."""
