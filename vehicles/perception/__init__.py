"""Perception: what stands in a picture, found by colour."""
