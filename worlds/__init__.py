"""Places and things: frames, scenes, meshes, rendering, lidar and clearance. Imports nothing of ours."""
