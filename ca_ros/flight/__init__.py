"""Flights without ROS: controller, rigid body, closed loop, and what was flown."""
