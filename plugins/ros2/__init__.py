"""ROS 2: nodes as the autonomy under test, by zenoh or by the user's own rclpy."""
