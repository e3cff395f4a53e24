"""Scenes: shapes, meshes and surfaces of objects, and their motion."""
