"""Rendered cameras, and what a camera does to an image."""
