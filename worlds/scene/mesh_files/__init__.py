"""Meshes from files: read, checked for what they need, and refused where they would be misread."""
