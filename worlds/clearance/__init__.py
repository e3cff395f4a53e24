"""Clearance: distances between a vehicle's body and the objects of a scene."""
