"""What `ca_ros.bringup` and `ca_ros.testing` share: processes, stamps, parameters, diagnostics."""
