"""Clearance: distances between a vehicle's body and the things of a scene."""
