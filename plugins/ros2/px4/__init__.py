"""Nodes of px4_msgs: what PX4's bridge to ROS 2 publishes for them and takes from them."""
