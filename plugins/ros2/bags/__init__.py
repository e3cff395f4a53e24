"""Bags of ROS 2 of recorded runs."""
