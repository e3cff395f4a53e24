"""Perception of a run: sensors, mixing, and calls of the autonomy under test."""
