"""World models: frames, scenes, rendering, lidar, clearance; imports no other package."""
