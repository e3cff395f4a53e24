"""Poses: a vehicle's local frame in the world, and its poses over time; pure."""
