"""Rendering on the CPU: colour, depth and object id images of an exact pinhole camera."""
