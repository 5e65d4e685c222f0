"""The ROS nodes: thin shells of the core that convert messages and check time."""
