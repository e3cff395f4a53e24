"""Places and things: frames, scenes, rendering, lidar and clearance. Imports nothing of ours."""
