"""Flights without ROS: controller, rigid body, closed loop, recorded flight."""
