"""Rays: exact ray casting over a scene, for lidar and for checks of the renderer."""
