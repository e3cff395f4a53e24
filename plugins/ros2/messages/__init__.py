"""Messages of ROS 2: made of readings and telemetry, and read as setpoints; their topics."""
