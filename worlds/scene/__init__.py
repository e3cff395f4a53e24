"""Scenes: shapes, meshes and surfaces of things, and how the things move."""
