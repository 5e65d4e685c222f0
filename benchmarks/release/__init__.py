"""A version of ca_ros beside another: speed, measured by asv, and answers."""
